"""Models and test sequences → how the answers bear what is done to the queries (SCI paper, section V; METHODS 2.8)."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from pipeline import schemas, store
from pipeline.alterations import Case
from pipeline.evaluation.robustness import Robustness, judge
from pipeline.matching.places import Labels
from pipeline.matching.ranking import Rows
from pipeline.reports import robustness
from pipeline.studies.expansion import families, models, spelled_out
from pipeline.views.altered import altered
from stages import ROOT, Bars, made, stage

Drawn = Mapping[str, Mapping[Case, Rows]]
"""Of each sequence the rows in each case."""


@stage("robustness")
def main(cfg: DictConfig) -> str:
    words, name = spelled_out(cfg.benchmark)[cfg.study], Path(cfg.out).name
    methods = [method if cfg.models == "all" else own(method) for method in words.methods]
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        judged = asked(cfg, methods, folder)
        section = robustness.section(
            folder,
            f"{cfg.study}-{cfg.cells}-{name}",
            cfg.study,
            cfg.cells,
            name,
            {family: [judged[model] for model in seeds] for family, seeds in families(methods).items()},
            cfg.dataset.simulated,
            (cfg.out, str(trained(cfg))),
            parameters(cfg, words),
        )
        section.write(folder)
    numbers = {model: {sequence: one.told() for sequence, one in found.items()} for model, found in judged.items()}
    with store.replace(cfg.metrics) as metrics:
        metrics.write_text(json.dumps(numbers, indent=1, allow_nan=False) + "\n")
    return section.answer[0]


def asked(cfg: DictConfig, methods: Any, folder: Path) -> dict[str, dict[str, Robustness]]:
    """What every model answers about every sequence; each view is drawn once for all methods that look at it."""
    views = dict.fromkeys(method.view for method in methods)
    listed = [(view, method) for view in views for method in methods if method.view == view]
    judged: dict[str, dict[str, Robustness]] = {}
    seen, drawn = "", dict[str, Mapping[Case, Rows]]()
    for view, method in Bars().track(listed, len(listed), f"ask about {folder.name.split('.')[0]}"):
        drawn, seen = drawn if view == seen else draw(cfg, view), view
        for model, changed in models(method).items():
            judged[model] = ask(cfg, method.name, model, changed, drawn, folder / model)
    return judged


def own(method: Any) -> DictConfig:
    """A method of a study without its variants and further seeds."""
    return DictConfig({**method, "variants": {}, "seeds": 1})


def draw(cfg: DictConfig, view: str) -> dict[str, Mapping[Case, Rows]]:
    """The rows of all sequences in all cases, as one view."""
    alteration, look, sequences = instantiate(cfg.alteration), made("view", view), cfg.sequences.split()

    def one(sequence: str) -> Mapping[Case, Rows]:
        scans, submaps = (Path(cfg.artifacts, kind, cfg.study, f"{sequence}.zarr") for kind in ("scans", "submaps"))
        drawn = altered(store.read(scans, schemas.SCANS), store.read(submaps, schemas.SUBMAPS), look, alteration)
        return {case: Rows(*rows) for case, rows in drawn.items()}

    return dict(zip(sequences, instantiate(cfg.compute).each(one, sequences), strict=True))


def ask(cfg: DictConfig, method: str, model: str, changed: str, drawn: Drawn, out: Path) -> dict[str, Robustness]:
    """What one model answers about every sequence, kept as artifacts in `out`."""
    learned = store.read_model(trained(cfg) / f"{model}.safetensors")
    localizer = made("method", method, **OmegaConf.from_dotlist(changed.split()).get("method", {})).localizer(learned)
    localize, evaluate = (OmegaConf.load(ROOT / "conf" / f"{stage}.yaml") for stage in ("localize", "evaluate"))
    rejection, found = instantiate(localize.rejection), {}
    for sequence, cases in drawn.items():
        rankings = {case: rejection.order(localizer(rows, localize.k)) for case, rows in cases.items()}
        poses = [rows.world_T_anchor for rows in cases.values()]
        thresholds = rejection.thresholds(learned, next(iter(rankings.values())).kinds)
        labels = store.read(Path(cfg.artifacts, "labels", cfg.study, cfg.cells, f"{sequence}.zarr"), schemas.LABELS)
        places, days = Labels(**{name: labels.load(name) for name in schemas.LABELS.columns}), int(labels.attrs["days"])
        one = judge(rankings, poses, thresholds, places, poses[0], days, instantiate(evaluate.distance), model)
        with store.write(out / f"{sequence}.zarr", schemas.ROBUSTNESS, **one.attrs()) as artifact:
            for column in schemas.ROBUSTNESS.columns:
                artifact.put(column, getattr(one, column))
        found[sequence] = one
    return found


def trained(cfg: DictConfig) -> Path:
    """Where the study's models are."""
    return Path(cfg.artifacts, "train", cfg.study, cfg.cells)


def parameters(cfg: DictConfig, words: Any) -> dict[str, Any]:
    """What the numbers were made with."""
    changed = {model: learn for method in words.methods for model, learn in models(method).items() if learn}
    altering: Any = OmegaConf.to_container(cfg.alteration)
    said = {"budget": words.budget, "train": words.train, "sequences": cfg.sequences.split(), "variants": changed}
    return {"alteration": altering, **said, "stress": dict(words.get("stress", {}))}


if __name__ == "__main__":
    main()
