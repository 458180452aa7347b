"""Expands studies to conf/lists.yaml: a list for each `foreach` of dvc.yaml, an entry an instance.

An instance is one run of a stage: of a sequence, a view, or a model at a cell size. DVC can look up
no name within another, so each entry holds all names and settings that its command line needs.
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
"""List, such as models, to instance, such as campus-10m-sci, to the names and settings it takes."""

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
"""Alterations that only a method's own model is asked about.

Variants and seeds differ in the headings that they learned, which buildings have no part in.
"""


def expand(studies: Mapping[str, Study]) -> Lists:
    """The lists of all studies together."""
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
        for view in method.views:
            instance = f"{dataset}-{view}"
            names = {"dataset": dataset, "view": view}
            lists[method.stage][instance] = {**names, "sequences": sequences}
            for alteration, altered_sequences in study.altered.items():
                lists["altered"][f"{instance}-{alteration}"] = {
                    **names,
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
    """Add the training of a model, what it learns further, and what it is asked."""
    trained = _trained(study, grid, method, model)
    training = {
        "budget": study.budget,
        "of": "" if len(study.train) > 1 else f"/{study.train_text}.zarr",
    }
    lists["models"][_instance(study, grid, model)] = trained | training
    if study.learns_further_days:
        course = {
            **trained,
            **training,
            "tolerance": study.tolerance.name,
            "name": _word("name", model),
            "simulated": _switch(study.simulated),
        }
        lists["lifelong"] |= instances(course, study, method)
    if study.asks_about_the_year:
        _questions(lists, study, grid, model, trained)


def _trained(study: Study, grid: CellSize, method: StudyMethod, model: ModelName) -> dict[str, Any]:
    """What every stage is told of a model: its names, and the words that make its method."""
    settings = " ".join(f"method.{name}={value}" for name, value in method.settings.items())
    seed = f"method.seed={model.seed}" if model.seed else ""
    recipe = (f"method={model.method}", settings, method.variants.get(model.variant, ""), seed)
    return {
        "dataset": study.name,
        "grid": grid.name,
        "method": model.method,
        "model": model.name,
        "recipe": " ".join(filter(None, recipe)),
        "code": method.code,
        "view": method.view_of(model.variant),
        "train": study.train_text,
    }


def _questions(
    lists: Lists, study: Study, grid: CellSize, model: ModelName, trained: Mapping[str, Any]
) -> None:
    """Add a model's rankings, poses and paths, and the evaluation of each.

    At the cell sizes of `cells` it is asked about the tests alone, as driven, without poses.
    """
    dataset = study.name
    instance = _instance(study, grid, model)
    is_own_grid = grid in study.grids
    alterations = [
        name
        for name in study.altered
        if is_own_grid and (name not in STRUCTURE or model == ModelName(model.method))
    ]
    tests = " ".join(study.asked_days if is_own_grid else study.tests)
    queries = {"tests": tests, "alterations": " ".join(alterations)}
    if not study.altered:
        _add_absent(lists, "altered", dataset, trained["view"])
    lists["rankings"][instance] = {**trained, **queries}
    if is_own_grid and model.family in study.poses:
        lists["maps"][dataset] = {"dataset": dataset, "train": study.train_text}
        lists["poses"][instance] = {**trained, **queries, "budget": study.budget}
    for answers in study.answers_of(model) if is_own_grid else [model]:
        lists["evaluations"][_instance(study, grid, answers)] = {
            "dataset": dataset,
            "grid": grid.name,
            "train": study.train_text,
            "tests": tests,
            "tolerance": study.tolerance.name,
            "model": answers.name,
            "rankings": Layout().answers(dataset, grid.name, answers).as_posix(),
        }
        if answers.path:
            lists["paths"][_instance(study, grid, answers)] = {
                "dataset": dataset,
                "grid": grid.name,
                "model": model.name,
                "train": study.train_text,
                "path": answers.path,
                "out": answers.name,
                "tests": tests,
            }


def _instance(study: Study, grid: CellSize, answers: ModelName) -> str:
    """The name of a stage's instance for one model: campus-10m-sci."""
    return f"{study.name}-{grid.name}-{answers.name}"


def _measurements(lists: Lists, study: Study) -> None:
    """Add timings, viewpoints and events, and the results that gather all numbers."""
    dataset = study.name
    is_evaluated = study.asks_about_the_year
    is_lifelong = study.learns_further_days
    is_robustness = study.question == "robustness"
    is_timed = is_evaluated and study.latency
    bird_view_methods = study.bird_view_methods if not is_lifelong else []
    for grid in study.grids if is_timed else ():
        lists["latency"][f"{dataset}-{grid.name}"] = {
            "grid": grid.name,
            "dataset": dataset,
            "simulated": _switch(study.simulated),
            "sequence": study.tests[-1],  # as the SCI paper's Table III
            "contenders": _word(
                "contenders", {method.name: method.view for method in study.methods}
            ),
            "trained": _word("trained", study.models),
        }
    for grid, method in product(study.grids, bird_view_methods):
        for model in method.models:
            lists["viewpoints"][f"{dataset}-{grid.name}-{model.name}"] = {
                "dataset": dataset,
                "grid": grid.name,
                "model": model.name,
                "code": method.code,
                "view": method.view_of(model.variant),
                "tests": " ".join(study.tests),
            }
    if is_robustness:
        lists["events"][dataset] = {
            "dataset": dataset,
            "train": study.train_text,
            "sequences": " ".join(study.tests),
            **_drive(study),
        }
    present = {
        "evaluate": is_evaluated,
        "viewpoints": bool(bird_view_methods),
        "events": is_robustness,
        "lifelong": is_lifelong,
        "latency": is_timed,
    }
    for kind, is_present in present.items():
        if not is_present:
            _add_absent(lists, kind, dataset)
    lists["results"][dataset] = {"dataset": dataset, "study": _word("study", study)}
    if is_evaluated or is_lifelong:
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
