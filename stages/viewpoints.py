"""Models of bird-views and test sequences → how well places are known again from other headings
(DOM and PFL, IROS 2018)."""

import json
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import store
from pipeline.evaluation.viewpoints import ViewpointMatches, line, means
from pipeline.matching.ranking import Rows
from pipeline.running.building import build, plain
from pipeline.studies.known import studies
from pipeline.studies.layout import Layout
from stages import ROOT, ProgressBar, stage

METHODS = ("pipeline.methods.",)
"""Where the classes of models lie."""


@stage("viewpoints")
def main(cfg: DictConfig) -> str:
    study = studies(ROOT / "conf")[cfg.study]
    numbers = dict[str, list[dict[str, dict[str, float | None]]]]()
    layout = Layout(Path(cfg.artifacts))
    methods = study.bird_view_methods
    sequences = study.tests[: cfg.tests]
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        for method in ProgressBar().track(methods, len(methods), "judge turned robots"):
            for sequence in sequences:
                views = Rows.read(layout.path("views", study.name, method.view, sequence))
                for family, models in method.families.items():
                    seeds_judged = [
                        judge(cfg, model.name, views, folder / model.name / f"{sequence}.zarr")
                        for model in models
                    ]
                    numbers[f"{family} {sequence}"] = [seed.by_heading() for seed in seeds_judged]
    with store.replace(cfg.metrics) as metrics_path:
        metrics_path.mkdir()
        for name, seeds in numbers.items():
            text = json.dumps(means(seeds), indent=2, allow_nan=False)
            (metrics_path / f"{name.replace(' ', '-')}.json").write_text(
                f"{text}\n", encoding="utf-8"
            )
    return "; ".join(f"{key}: {line(seeds)}" for key, seeds in numbers.items())


def judge(cfg: DictConfig, model: str, views: Rows, out: Path) -> ViewpointMatches:
    """One model on one sequence, asked as it was trained and kept as an artifact."""
    path = Layout(Path(cfg.artifacts)).path("train", cfg.study, cfg.cells, model)
    recipe = {name: plain(value) for name, value in store.read_recipe(path).items()}
    method = build(recipe, METHODS)
    matches: ViewpointMatches = instantiate(cfg.viewpoints).judge(
        method, store.read_model(path), views
    )
    store.write(out, matches)
    return matches


if __name__ == "__main__":
    main()
