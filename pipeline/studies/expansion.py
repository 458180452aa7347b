"""Expands conf/studies.yaml to the lists of dvc.yaml, one entry an instance of a stage.

DVC can look up no name within another, so all that a stage needs is listed for each of its
instances.
"""

import shlex
from collections.abc import Mapping
from itertools import product
from typing import Any

from pipeline.core.settings import written
from pipeline.studies.courses import instances
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import CellSize, Study, StudyMethod

Lists = dict[str, dict[str, dict[str, Any]]]

LISTS = (
    "drives",
    "slam",
    "slam_further",
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
    "absent",
)
STRUCTURE = ("demolition", "construction")
"""Alterations that a method's own model answers alone: variants and seeds differ in the headings
that they learned."""


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
    lists["report"]["all"] = {"studies": _word("studies", [*studies.values()])}
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
            "slam": _path("slam", dataset, *([sequence] if study.slam else [])),
            **drive,
        }
    for sequence in study.sequences if study.slam else ():
        train = study.train[0]
        kind = "slam" if sequence == train else "slam_further"
        lists[kind][f"{dataset}-{sequence}"] = {
            "dataset": dataset,
            "root": study.root,
            "sequence": sequence,
            "train": train,
        }
    if not study.slam:
        _add_absent(lists, "slam", dataset)
    lists["submaps"][dataset] = {
        "dataset": dataset,
        "submap": study.submap,
        "sequences": sequences,
    }
    for method in study.methods:
        for looked_at in method.views:
            name = f"{dataset}-{looked_at}"
            view = {"dataset": dataset, "view": looked_at}
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
    view = method.view_of(model.variant)
    seed = f"method.seed={model.seed}" if model.seed else ""
    settings = " ".join(f"method.{name}={value}" for name, value in method.settings.items())
    words = (f"method={model.method}", settings, method.variants.get(model.variant, ""), seed)
    entry = {"dataset": dataset, "grid": grid.name, "method": model.method, "model": model.name}
    entry |= {
        "recipe": " ".join(filter(None, words)),
        "code": method.code,
        "view": view,
        "train": study.train_text,
    }
    tolerance = {"tolerance": study.tolerance.name}
    learned = {
        "budget": study.budget,
        "of": "" if len(study.train) > 1 else f"/{study.train_text}.zarr",
    }
    lists["models"][f"{dataset}-{grid.name}-{model.name}"] = entry | learned
    if study.learns_further_days:
        named = {"name": _word("name", model), "simulated": _switch(study.simulated)}
        lists["lifelong"] |= instances({**entry, **learned, **tolerance, **named}, study, method)
    if not study.asks_about_the_year:
        return
    is_own_grid = grid in study.grids
    altered = [
        name
        for name in study.altered
        if is_own_grid and (name not in STRUCTURE or model == ModelName(model.method))
    ]
    tests = study.asked_days if is_own_grid else study.tests
    if not study.altered:
        _add_absent(lists, "altered", dataset, view)
    queries = {"tests": " ".join(tests), "alterations": " ".join(altered)}
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
    bird_views = study.bird_view_methods if not lifelong else []
    is_timed = year and study.latency
    for grid in study.grids if is_timed else ():
        lists["latency"][f"{dataset}-{grid.name}"] = {
            "grid": grid.name,
            "dataset": dataset,
            "simulated": _switch(study.simulated),
            "sequence": study.tests[-1],  # as the SCI paper's Table III
            "contenders": _word("contenders", {part.name: part.view for part in study.methods}),
            "trained": _word("trained", study.models),
        }
    for grid, method in product(study.grids, bird_views):
        for model in method.models:
            lists["viewpoints"][f"{dataset}-{grid.name}-{model.name}"] = {
                "dataset": dataset,
                "grid": grid.name,
                "model": model.name,
                "code": method.code,
                "view": method.view_of(model.variant),
                "tests": " ".join(study.tests),
            }
    if robust:
        entry = {"dataset": dataset, "train": study.train_text, "sequences": " ".join(study.tests)}
        lists["events"][dataset] = entry | _drive(study)
    present = {
        "evaluate": year,
        "viewpoints": bool(bird_views),
        "events": robust,
        "lifelong": lifelong,
        "latency": is_timed,
    }
    for kind, is_present in present.items():
        if not is_present:
            _add_absent(lists, kind, dataset)
    lists["results"][dataset] = {"dataset": dataset, "study": _word("study", study)}
    if year or lifelong:
        lists["published"][dataset] = {"dataset": dataset}


def _add_absent(lists: Lists, kind: str, *names: str) -> None:
    """Add the empty folder of a kind of artifacts that a study has none of.

    DVC has no optional dependencies: whatever reads the kind finds nothing in there.
    """
    lists["absent"]["-".join((*names, kind))] = {"out": _path(kind, *names)}


def _word(setting: str, value: Any) -> str:
    """A setting with a table or a list as a word of a shell's command line."""
    return shlex.quote(f"{setting}={written(value)}")


def _switch(value: bool) -> str:
    return str(value).lower()


def _drive(study: Study) -> dict[str, str]:
    """What the stages of one drive take from its study."""
    return {"world": study.world, **study.origin, "root": study.root}


def _path(kind: str, *names: str) -> str:
    """The path of a kind of artifacts as dvc.yaml has it."""
    return Layout().path(kind, *names).as_posix()
