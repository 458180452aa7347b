"""Expands conf/studies.yaml to the lists of dvc.yaml, one entry an instance of a stage.

DVC can look up no name within another, so all that a stage needs is listed for each of its
instances.
"""

from collections.abc import Mapping
from itertools import product
from typing import Any

from pipeline.studies.courses import instances
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import CellSize, Study, StudyMethod

Lists = dict[str, dict[str, dict[str, Any]]]

LISTS = (
    "drives",
    "submaps",
    "views",
    "birdviews",
    "altered",
    "labels",
    "maps",
    "models",
    "rankings",
    "poses",
    "paths",
    "evaluations",
    "events",
    "viewpoints",
    "lifelong",
    "latency",
    "results",
    "report",
    "published",
)
STRUCTURE = ("demolition", "construction")
"""Alterations that a method's own model answers alone: variants and seeds differ in the headings
that they learned."""
INSTEAD = {
    "evaluated": "pipeline/__init__.py",
    "viewed": "pipeline/evaluation/__init__.py",
    "changed": "pipeline/formats/__init__.py",
    "learned": "pipeline/fetching/__init__.py",
}
"""What a stage depends on where a study has no such artifact, an empty file: DVC has no optional
dependencies."""


def expand(studies: Mapping[str, Study]) -> Lists:
    """The entries of each list, by the name of a stage's instance, such as campus-10m-sci."""
    lists: Lists = {name: {} for name in LISTS}
    for study in studies.values():
        _views(lists, study)
        for grid, method in product(study.all_grids, study.methods):
            for model in method.models:
                if grid in study.grids or model == ModelName(method.name):
                    _model(lists, study, grid, method, model)
        _measurements(lists, study)
    lists["report"]["all"] = {
        "evaluated": _path("evaluate") if lists["rankings"] else INSTEAD["evaluated"],
        "viewed": _path("viewpoints") if lists["viewpoints"] else INSTEAD["viewed"],
        "learned": _path("lifelong") if lists["lifelong"] else INSTEAD["learned"],
        "timed": _path("latency") if lists["latency"] else INSTEAD["changed"],
    }
    return lists


def _views(lists: Lists, study: Study) -> None:
    """Add what is computed before training: logs, scans, submaps, views, labels."""
    dataset = study.name
    drive = _drive(study)
    sequences = " ".join(study.sequences)
    for sequence in study.sequences:
        lists["drives"][f"{dataset}-{sequence}"] = {
            "dataset": dataset,
            "sequence": sequence,
            **drive,
        }
    lists["submaps"][dataset] = {
        "dataset": dataset,
        "submap": study.submap,
        "sequences": sequences,
    }
    for method in study.methods:
        name = f"{dataset}-{method.view}"
        view = {"dataset": dataset, "view": method.view}
        lists[method.stage][name] = view | {"sequences": sequences}
        for alteration, altered_sequences in study.altered.items():
            lists["altered"][f"{name}-{alteration}"] = view | {
                "alteration": alteration,
                "sequences": " ".join(altered_sequences),
            }
    labelled = sequences if study.asks_about_the_year else study.train_text
    for grid in study.all_grids:
        lists["labels"][f"{dataset}-{grid.name}"] = {
            "grid": grid.name,
            "dataset": dataset,
            "train": study.train_text,
            "sequences": labelled,
        }


def _model(
    lists: Lists, study: Study, grid: CellSize, method: StudyMethod, model: ModelName
) -> None:
    """Add the training of a model, its rankings, evaluations, poses and paths."""
    dataset = study.name
    seed = f"method.seed={model.seed}" if model.seed else ""
    settings = " ".join(f"method.{name}={value}" for name, value in method.settings.items())
    words = (f"method={model.method}", settings, method.variants.get(model.variant, ""), seed)
    entry = {"dataset": dataset, "grid": grid.name, "method": model.method, "model": model.name}
    entry |= {
        "recipe": " ".join(filter(None, words)),
        "code": method.code,
        "view": method.view,
        "train": study.train_text,
    }
    tolerance = {"tolerance": study.tolerance.name}
    learned = {
        "budget": study.budget,
        "of": "" if len(study.train) > 1 else f"/{study.train_text}.zarr",
    }
    lists["models"][f"{dataset}-{grid.name}-{model.name}"] = entry | learned
    if study.learns_further_days:
        lists["lifelong"] |= instances({**entry, **learned, **tolerance}, study, method, INSTEAD)
    if not study.asks_about_the_year:
        return
    is_own_grid = grid in study.grids
    altered = [
        name
        for name in study.altered
        if is_own_grid and (name not in STRUCTURE or model == ModelName(model.method))
    ]
    tests = study.asked_days if is_own_grid else study.tests
    altered_views = _path("altered", dataset, method.view) if altered else INSTEAD["evaluated"]
    queries = {"tests": " ".join(tests), "alterations": " ".join(altered), "altered": altered_views}
    lists["rankings"][f"{dataset}-{grid.name}-{model.name}"] = entry | queries
    evaluated = {name: entry[name] for name in ("dataset", "grid", "train")} | {
        "tests": queries["tests"],
        **tolerance,
    }
    for answers in study.answers_of(model) if is_own_grid else [model]:
        lists["evaluations"][f"{dataset}-{grid.name}-{answers.name}"] = evaluated | {
            "model": answers.name,
            "rankings": Layout().answers(dataset, grid.name, answers).as_posix(),
        }
        if answers.path:
            followed = {name: entry[name] for name in ("dataset", "grid", "model", "train")} | {
                "path": answers.path
            }
            lists["paths"][f"{dataset}-{grid.name}-{answers.name}"] = followed | {
                "out": answers.name,
                "tests": queries["tests"],
            }
        elif answers.posed:
            lists["maps"][dataset] = {"dataset": dataset, "train": study.train_text}
            lists["poses"][f"{dataset}-{grid.name}-{model.name}"] = entry | {
                **{name: queries[name] for name in ("tests", "alterations")},
                "budget": study.budget,
            }


def _measurements(lists: Lists, study: Study) -> None:
    """Add timings, viewpoints and events, and the results that gather all numbers."""
    dataset = study.name
    year = study.asks_about_the_year
    robust = study.question == "robustness"
    lifelong = study.learns_further_days
    bird_views = bool(study.bird_view_methods) and not lifelong
    by_grid = {
        f"{dataset}-{grid.name}": {"grid": grid.name, "dataset": dataset} for grid in study.grids
    }
    lists["latency"] |= by_grid if year and study.latency else {}
    lists["viewpoints"] |= by_grid if bird_views else {}
    if robust:
        entry = {"dataset": dataset, "train": study.train_text, "sequences": " ".join(study.tests)}
        lists["events"][dataset] = entry | _drive(study)
    sources = {
        "evaluated": ("evaluate", year),
        "viewed": ("viewpoints", bird_views),
        "changed": ("events", robust),
        "learned": ("lifelong", lifelong),
    }
    dependencies = {
        word: _path(kind, dataset) if exists else INSTEAD[word]
        for word, (kind, exists) in sources.items()
    }
    lists["results"][dataset] = {"dataset": dataset, **dependencies}
    if year or lifelong:
        lists["published"][dataset] = {"dataset": dataset}


def _drive(study: Study) -> dict[str, str]:
    """What the stages of one drive take from its study."""
    return {"world": study.world, **study.origin, "root": study.root}


def _path(kind: str, *names: str) -> str:
    """The path of a kind of artifacts as dvc.yaml has it."""
    return Layout().path(kind, *names).as_posix()
