"""Artifacts → MLflow, which can be thrown away and published anew at any time."""

from dataclasses import replace
from pathlib import Path

from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.evaluation.viewpoints import NUMBERS, Judged
from pipeline.reports.style import colour
from pipeline.running.telemetry import Trace, costs
from pipeline.studies.expansion import asks_about_the_year, turned
from pipeline.tracking import page
from pipeline.tracking import runs as tracking
from pipeline.tracking.served import Served
from stages import stage
from stages.report import gather


@stage("publish")
def main(cfg: DictConfig) -> str:
    if not asks_about_the_year(cfg.benchmark.studies[cfg.study]):
        return f"{cfg.study} asks about viewpoints alone, see {cfg.artifacts}/viewpoints/{cfg.study}"
    runs = []
    for grid in cfg.benchmark.studies[cfg.study].grids:
        study = gather(cfg, grid)
        figures = Path(cfg.artifacts, "report", cfg.study, grid)
        colours = {method: colour(method) for method in study.recipes}
        runs += [turned_too(cfg, grid, with_model(cfg, grid, run)) for run in study.runs(figures, colours)]
    name = tracking.experiment_of(cfg.study, cfg.dataset.simulated)
    done = tracking.publish(Path(cfg.tracking.database), name, runs)
    where = page.url(done.experiment_id, cfg.tracking.host, cfg.tracking.port)
    return f"{done.written} runs written, {done.kept} there already; `make dashboard` serves them at {where}"


def with_model(cfg: DictConfig, grid: str, run: tracking.RunRecord) -> tracking.RunRecord:
    """A method's run, and with it the model, how its training went, and what its stages cost where they ran here."""
    words, method = cfg.benchmark.studies[cfg.study], run.tags["method"]
    (view,) = (listed.view for listed in words.methods if listed.name == method)
    at = {stage: Path(cfg.artifacts, stage, cfg.study) for stage in ("views", "train", "localize", "evaluate")}
    model = at["train"] / grid / f"{method}.safetensors"
    artifacts = {"views": [at["views"] / view], "train": [model]}
    artifacts |= {stage: [at[stage] / grid / method] for stage in ("localize", "evaluate")}
    trace = Trace.read(model)
    series = {f"cost/{name}": [(0, value)] for name, value in costs(artifacts).items()}
    return replace(run, series={**run.series, **series, **(trace.series() if trace else {})}, model=Served.read(model))


def turned_too(cfg: DictConfig, grid: str, run: tracking.RunRecord) -> tracking.RunRecord:
    """A method's run, and with it how it bears being turned, over whole degrees of heading, if it was asked."""
    method, folder = run.tags["method"], Path(cfg.artifacts, "viewpoints", cfg.study, grid)
    if method not in [listed["name"] for listed in turned(cfg.benchmark.studies[cfg.study].methods)]:
        return run
    series = dict(run.series)
    for path in sorted((folder / method).glob("*.zarr")):
        judged = Judged.read(store.read(path, schemas.VIEWPOINTS))
        at = judged.numbers()
        for name in NUMBERS:
            values = [(int(degrees), at[f"{degrees:g}_deg"][name]) for degrees in judged.headings_deg]
            series[f"viewpoints/{name} {path.stem}"] = [(degrees, value) for degrees, value in values if value is not None]
    return replace(run, series=series, figures=[*run.figures, *sorted(folder.glob("*.svg"))])


if __name__ == "__main__":
    main()
