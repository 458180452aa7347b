"""Models of bird-views and test sequences → how well places are known again from other headings (DOM and PFL, IROS 2018)."""

import json
from itertools import islice
from pathlib import Path

import numpy as np
from hydra.utils import instantiate
from matplotlib.figure import Figure
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.evaluation.viewpoints import MEAN, Judged
from pipeline.matching.ranking import Rows
from pipeline.methods.pfl.features import REFERENCE, FeatureMethod
from pipeline.reports import mapping, viewpoints
from pipeline.reports.learned import Learned
from pipeline.studies.expansion import seeded, spelled_out, turned
from pipeline.views.mapped import Mapped
from stages import Bars, made, stage

SAID = ("roc_auc", "accuracy")


@stage("viewpoints")
def main(cfg: DictConfig) -> str:
    words = spelled_out(cfg.benchmark)[cfg.study]
    methods, sequences = turned(words.methods), words.tests[: cfg.tests]
    judged: dict[tuple[str, str], list[Judged]] = {(one["name"], sequence): [] for one in methods for sequence in sequences}
    learned: dict[str, list[Learned]] = {}
    pictures: dict[str, viewpoints.Pictures] = {}
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        for listed in Bars().track(methods, len(methods), "turn"):
            name, paths = listed["name"], [train(cfg) / f"{model}.safetensors" for model in seeded(listed)]
            learned[name] = [Learned.read(path) for path in paths]
            for sequence in sequences:
                views = Rows.read(Path(cfg.artifacts, "views", cfg.study, listed["view"], f"{sequence}.zarr"))
                judged[name, sequence] = [ask(cfg, name, path, views, folder / path.stem / f"{sequence}.zarr") for path in paths]
            pictures |= shown(name, paths[0], views)
        look = mapped(cfg, methods[0]["view"], sequences[0])
        viewpoints.write(folder, cfg.study, cfg.dataset.simulated, judged, learned, pictures, look)
    numbers = {f"{name} {sequence}": [one.numbers() for one in seeds] for (name, sequence), seeds in judged.items()}
    with store.replace(cfg.metrics) as metrics:
        metrics.write_text(json.dumps(numbers, indent=2, allow_nan=False) + "\n")
    return "; ".join(f"{key}: {told(seeds)}" for key, seeds in numbers.items())


def mapped(cfg: DictConfig, name: str, sequence: str) -> Figure:
    """How the middle one of a sequence's submaps becomes a bird-view."""
    scans, submaps = (Path(cfg.artifacts, kind, cfg.study, f"{sequence}.zarr") for kind in ("scans", "submaps"))
    view = made("view", name)
    drawing = Mapped(store.read(scans, schemas.SCANS), store.read(submaps, schemas.SUBMAPS), view)
    middle = next(islice(drawing.maps(), len(drawing) // 2, None))
    return mapping.bird_view(*middle, view, cfg.dataset.simulated)


def train(cfg: DictConfig) -> Path:
    """Where the study's models are."""
    return Path(cfg.artifacts, "train", cfg.study, cfg.cells)


def ask(cfg: DictConfig, name: str, model: Path, views: Rows, out: Path) -> Judged:
    """What one model knows of one sequence, kept as an artifact."""
    judged: Judged = instantiate(cfg.viewpoints).judge(made("method", name), store.read_model(model), views)
    with store.write(out, schemas.VIEWPOINTS, **judged.attrs()) as artifact:
        for column, values in judged.columns().items():
            artifact.put(column, values)
    return judged


def shown(name: str, model: Path, views: Rows) -> dict[str, viewpoints.Pictures]:
    """The middle place of a sequence at the headings of a reference, and what a method's network makes of it, if it has one."""
    method, seen = made("method", name), np.asarray(views.images[len(views.world_T_anchor) // 2])[REFERENCE]
    return {name: (seen, method.reconstructed(store.read_model(model), seen))} if isinstance(method, FeatureMethod) else {}


def told(seeds: list[dict[str, dict[str, float | None]]]) -> str:
    """The mean over headings and seeds of the numbers that a line has room for."""
    means = {name: np.mean([np.nan if one[MEAN][name] is None else one[MEAN][name] for one in seeds]) for name in SAID}
    return ", ".join(f"{name} {value:.3f}" if np.isfinite(value) else f"{name} none" for name, value in means.items())


if __name__ == "__main__":
    main()
