"""Expands studies to the lists of conf/lists.yaml, from which DVC makes the stages that it runs.

Each list is the `foreach` of one stage in dvc.yaml, and each entry is an instance: one run of the
stage, such as the training of one model at one cell size. DVC cannot look names up elsewhere, so an
entry holds every name and setting that its command line needs.
"""

import shlex
from collections.abc import Mapping
from itertools import product
from typing import Any

from pipeline.core.settings import written
from pipeline.studies.layout import Layout
from pipeline.studies.models import ModelName
from pipeline.studies.study import CellSize, Study, StudyMethod

Lists = dict[str, dict[str, dict[str, Any]]]
"""The lists by name, such as models. A list maps an instance, such as campus-10m-sci, to its names
and settings."""

LISTS = (
    "drives",
    "squares",
    "slam",
    "slam_further",
    "submaps",
    "views",
    "birdviews",
    "perturbed",
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
"""The names of all lists. dvc.yaml needs each of them, even an empty one."""
STRUCTURE = ("demolition", "construction")
"""Perturbations of buildings, with which only a method's own model is queried.

Variants and seeds differ in which headings they learned, and buildings do not matter for that.
"""


def expand(studies: Mapping[str, Study]) -> Lists:
    """The lists of all studies together."""
    lists: Lists = {name: {} for name in LISTS}
    for study in studies.values():
        _add_drives(lists, study)
        _add_views(lists, study)
        _add_labels(lists, study)
        for grid, method in product(study.all_grids, study.methods):
            for model in method.models:
                is_methods_own = model == ModelName(method.name)
                if grid in study.grids or is_methods_own:
                    _add_model(lists, study, grid, method, model)
        _add_measurements(lists, study)
    lists["report"]["all"] = {"studies": _word("studies", [*studies.values()])}
    return lists


def _add_drives(lists: Lists, study: Study) -> None:
    """Add the logs, scans, estimated poses and submaps of each sequence."""
    dataset = study.name
    for sequence in study.drives:
        slam_names = (dataset, sequence) if study.slam else (dataset,)
        lists["drives"][f"{dataset}-{sequence}"] = {
            "dataset": dataset,
            "sequence": sequence,
            "slam": _path("slam", *slam_names),
            **_drive(study),
        }
    if study.map:
        lists["squares"][f"{dataset}-{study.train_text}"] = {
            "dataset": dataset,
            "sequence": study.train_text,
            "files": study.map,
        }
    if study.slam:
        train = study.train[0]
        for sequence in study.sequences:
            name = "slam" if sequence == train else "slam_further"
            lists[name][f"{dataset}-{sequence}"] = {
                "dataset": dataset,
                "root": study.root,
                "sequence": sequence,
                "train": train,
            }
    else:
        _add_absent(lists, "slam", dataset)
    lists["submaps"][dataset] = {
        "dataset": dataset,
        "submap": study.submap,
        "sequences": " ".join(study.sequences),
    }


def _add_views(lists: Lists, study: Study) -> None:
    """Add the views that the methods look at, of unperturbed and of perturbed submaps."""
    for method in study.methods:
        for view in method.views:
            instance = f"{study.name}-{view}"
            names = {"dataset": study.name, "view": view}
            lists[method.stage][instance] = {**names, "sequences": " ".join(study.sequences)}
            for perturbation, perturbed_sequences in study.perturbed.items():
                lists["perturbed"][f"{instance}-{perturbation}"] = {
                    **names,
                    "perturbation": perturbation,
                    "sequences": " ".join(perturbed_sequences),
                }


def _add_labels(lists: Lists, study: Study) -> None:
    """Add the places of the submaps, at each cell size."""
    labelled_sequences = study.sequences if study.tests_over_days else study.train
    for grid in study.all_grids:
        lists["labels"][f"{study.name}-{grid.name}"] = {
            "grid": grid.name,
            "dataset": study.name,
            "train": study.train_text,
            "sequences": " ".join(labelled_sequences),
        }


def _add_model(
    lists: Lists, study: Study, grid: CellSize, method: StudyMethod, model: ModelName
) -> None:
    """Add the training of a model, and either the further days that it learns or its answers."""
    model_settings = _model_settings(study, grid, method, model)
    training = {
        "budget": study.budget,
        # what a path of views or labels ends in: of several sequences their folder is read
        "of": "" if len(study.train) > 1 else f"/{study.train_text}.zarr",
    }
    lists["models"][_instance(study, grid, model)] = model_settings | training
    if study.learns_further_days:
        course = {
            **model_settings,
            **training,
            "tolerance": study.tolerance.name,
            "name": _word("name", model),
            "simulated": _switch(study.simulated),
        }
        lists["lifelong"] |= courses_of_model(course, study, method)
    if study.tests_over_days:
        _add_answers(lists, study, grid, model, model_settings)


def courses_of_model(
    model_settings: Mapping[str, Any], study: Study, method: StudyMethod
) -> dict[str, dict[str, Any]]:
    """The courses of one model, as instances of the stage `lifelong`: name to settings.

    A course is an order of the days that are learned after training, and a strategy to learn them.
    The order `self_training` has the days that a site learns from its own poses. `model_settings`
    are the settings of the model itself, which each instance takes too.
    """
    model = f"{study.name}-{model_settings['grid']}-{model_settings['model']}"
    days_of_order = {"days": study.learned, "self_training": study.self_training}
    return {
        f"{model}-{order}-{strategy}": {
            **model_settings,
            "order": order,
            "strategy": strategy,
            "learned": " ".join(days_of_order.get(order, ())),
            "queried": " ".join(study.tests),
        }
        for order, strategies in method.courses.items()
        for strategy in strategies
    }


def _model_settings(
    study: Study, grid: CellSize, method: StudyMethod, model: ModelName
) -> dict[str, Any]:
    """The settings of a model for every stage: its names, and the words that make its method."""
    settings = " ".join(f"method.{name}={value}" for name, value in method.settings.items())
    variant_words = method.variants.get(model.variant, "")
    seed = f"method.seed={model.seed}" if model.seed else ""
    recipe = (f"method={model.method}", settings, variant_words, seed)
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


def _add_answers(
    lists: Lists,
    study: Study,
    grid: CellSize,
    model: ModelName,
    model_settings: Mapping[str, Any],
) -> None:
    """Add what a model answers, and its evaluation.

    At further cell sizes only the unperturbed test sequences are queried.
    """
    dataset = study.name
    instance = _instance(study, grid, model)
    is_own_grid = grid in study.grids
    tests = " ".join(study.query_days if is_own_grid else study.tests)
    perturbations = _perturbations_of(study, model) if is_own_grid else []
    queries = {"tests": tests, "perturbations": " ".join(perturbations)}
    if not study.perturbed:
        _add_absent(lists, "perturbed", dataset, model_settings["view"])
    lists["rankings"][instance] = {**model_settings, **queries}
    if is_own_grid and model.family in study.poses:
        if not study.map:  # the stage `squares` writes such a map
            lists["maps"][dataset] = {"dataset": dataset, "train": study.train_text}
        lists["poses"][instance] = {**model_settings, **queries, "budget": study.budget}
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


def _perturbations_of(study: Study, model: ModelName) -> list[str]:
    """The perturbations with which a model is queried."""
    is_methods_own = model == ModelName(model.method)
    return [name for name in study.perturbed if is_methods_own or name not in STRUCTURE]


def _instance(study: Study, grid: CellSize, answers: ModelName) -> str:
    """The name of an instance for one model and cell size: campus-10m-sci."""
    return f"{study.name}-{grid.name}-{answers.name}"


def _add_measurements(lists: Lists, study: Study) -> None:
    """Add timings, viewpoints and events, and the results that gather all numbers of the study."""
    dataset = study.name
    is_evaluated = study.tests_over_days
    is_lifelong = study.learns_further_days
    is_timed = is_evaluated and study.latency
    has_events = study.experiment == "robustness"
    has_viewpoints = bool(study.bird_view_methods) and not is_lifelong
    if is_timed:
        _add_latency(lists, study)
    if has_viewpoints:
        _add_viewpoints(lists, study)
    if has_events:
        lists["events"][dataset] = {
            "dataset": dataset,
            "train": study.train_text,
            "sequences": " ".join(study.tests),
            **_drive(study),
        }
    has_artifacts = {
        "evaluate": is_evaluated,
        "viewpoints": has_viewpoints,
        "events": has_events,
        "lifelong": is_lifelong,
        "latency": is_timed,
    }
    for kind, is_made in has_artifacts.items():
        if not is_made:
            _add_absent(lists, kind, dataset)
    lists["results"][dataset] = {"dataset": dataset, "study": _word("study", study)}
    if is_evaluated or is_lifelong:
        lists["published"][dataset] = {"dataset": dataset}


def _add_latency(lists: Lists, study: Study) -> None:
    """Add the timing of each method's queries, on the last test sequence."""
    contenders = {method.name: method.view for method in study.methods}
    for grid in study.grids:
        lists["latency"][f"{study.name}-{grid.name}"] = {
            "grid": grid.name,
            "dataset": study.name,
            "simulated": _switch(study.simulated),
            "sequence": study.tests[-1],  # as the SCI paper's Table III
            "contenders": _word("contenders", contenders),
            "trained": _word("trained", study.models),
        }


def _add_viewpoints(lists: Lists, study: Study) -> None:
    """Add the judging of turned robots, for every model that looks at bird-views."""
    for grid, method in product(study.grids, study.bird_view_methods):
        for model in method.models:
            lists["viewpoints"][_instance(study, grid, model)] = {
                "dataset": study.name,
                "grid": grid.name,
                "model": model.name,
                "code": method.code,
                "view": method.view_of(model.variant),
                "tests": " ".join(study.tests),
            }


def _add_absent(lists: Lists, kind: str, *names: str) -> None:
    """Add an empty folder in the place of a kind of artifacts that a study has none of."""
    # DVC has no optional dependencies: a stage that reads the kind finds the folder empty
    lists["absent"]["-".join((*names, kind))] = {"out": _path(kind, *names)}


def _word(setting: str, value: Any) -> str:
    """A setting whose value is a table or a list, as one word of a shell's command line."""
    return shlex.quote(f"{setting}={written(value)}")


def _switch(value: bool) -> str:
    """A boolean as YAML has it."""
    return str(value).lower()


def _drive(study: Study) -> dict[str, str]:
    """The settings of a study that the stages of each single drive take."""
    return {
        "world": study.world,
        "code": "worlds" if study.simulated else "pipeline/readers",
        "reads": study.origin["reads"],
        "root": study.root,
    }


def _path(kind: str, *names: str) -> str:
    """The path of an artifact, or of a folder of them, as dvc.yaml has it."""
    return Layout().path(kind, *names).as_posix()
