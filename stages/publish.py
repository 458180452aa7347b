"""Artifacts → MLflow, which can be thrown away and published anew at any time."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline import tracking
from pipeline.reports.style import colour
from stages import stage
from stages.report import gather


@stage("publish")
def main(cfg: DictConfig) -> str:
    runs = []
    for grid in cfg.benchmark.grids:
        study = gather(cfg, grid)
        runs += study.runs(
            Path(cfg.artifacts, "report", study.dataset, grid), {method: colour(method) for method in study.recipes}
        )
    done = tracking.publish(Path(cfg.tracking.database), f"yearloc {cfg.benchmark.dataset}", runs)
    where = tracking.dashboard_url(done.experiment_id, cfg.tracking.port)
    return f"{done.written} runs written, {done.kept} there already; `make dashboard` serves them at {where}"


if __name__ == "__main__":
    main()
