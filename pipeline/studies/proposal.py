"""Proposes the study of a data set: what `yearloc use` writes into conf/studies.yaml.

A study begins with the drives of the data set and the choices in its yaml. Functions from study to
study follow in this order: the preset of its world, the scale, the models of each method, the
question, and what a person asks for besides.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.core.errors import ConfigError
from pipeline.readers.parts import Part
from pipeline.running.texts import read_yaml
from pipeline.studies.courses import courses, with_further_days
from pipeline.studies.discovery import Drives, recorded, simulated
from pipeline.studies.study import (
    LIFELONG,
    QUESTIONS,
    TOLERANCE,
    CellSize,
    Study,
    StudyMethod,
    Tolerance,
    file_of,
    settings_of,
)

OPTIONS = (
    "altered",
    "budget",
    "cells",
    "latency",
    "methods",
    "paths",
    "poses",
    "question",
    "scale",
    "seeds",
    "tests",
    "variants",
)
"""What every study takes."""
MOST_SEEDS = 100
NEEDLESS = {
    "viewpoints": {"altered", "cells", "poses", "paths", "latency"},
    LIFELONG: {"altered", "cells", "poses", "paths", "latency"},
}
"""Options of `yearloc use` that nothing reads of a study with this question."""
SLAM = "slam"
"""Among `poses=`: poses are estimated from the scans; the other words there name models."""
PRESET = "demo"
"""Of a simulated world, where nothing else is said: a file of conf/world of the data set."""


@dataclass(frozen=True)
class Proposal:
    """A study for conf/studies.yaml, and what a person should know about it."""

    study: Study
    notes: list[str]


@dataclass(frozen=True)
class Request:
    """What a person asks of a data set."""

    conf: Path
    options: Mapping[str, str]
    """The words KEY=VALUE of `yearloc use`."""
    defaults: Mapping[str, Any]
    """The study in the data set's yaml, with what the question changes in it."""

    def __contains__(self, option: str) -> bool:
        return option in self.options

    def names(self, option: str, offered: Sequence[str]) -> list[str]:
        """The names that an option wants: all where it is missing, none where it is empty.

        Raises ConfigError for a name that is not `offered`.
        """
        wanted = self.options[option].split(",") if option in self.options else offered
        names = [name for name in dict.fromkeys(wanted) if name]
        if unknown := [name for name in names if name not in offered]:
            expected = (
                f"expected some of {', '.join(offered)}"
                if offered
                else "this question and these methods have none"
            )
            raise ConfigError(f"{option}={unknown[0]}: {expected}")
        return names


def propose(conf: Path, name: str, options: Mapping[str, str]) -> Proposal:
    """Propose the study of data set `name`.

    Options are root, log, parts, world, budget, question, scale and seeds, and with commas train,
    learned, tests, methods, variants, altered, cells, poses and paths. Raises ConfigError for an
    unknown data set or option, and where what is on disk does not make a study.
    """
    dataset = read_yaml(file_of(conf, "dataset", name, f"no data set {name}: expected one of"))
    question = options.get("question", QUESTIONS[0])
    _refuse_unknown(name, dataset, question, options)
    request = Request(conf, options, _defaults(conf, name, dataset["study"], question))
    drives = (
        simulated(conf, name, request.defaults, options)
        if dataset["simulated"]
        else recorded(name, dataset["reader"], request.defaults, options)
    )
    study = first_choices(request, name, question, dataset["simulated"], drives)
    for change in CHANGES:
        study = change(study, request)
    refuse_unposed(study, dataset["reader"])
    return Proposal(study, drives.notes)


def first_choices(
    request: Request, name: str, question: str, is_simulated: bool, drives: Drives
) -> Study:
    """The study of these drives with the choices of the data set's yaml, and a person's budget."""
    conf = request.conf
    defaults = request.defaults
    views = defaults.get("views", {})
    names = request.options["methods"].split(",") if "methods" in request else defaults["methods"]
    views_of_methods = {method: str(settings_of(conf, method)["view"]) for method in names}
    budget = request.options.get("budget", drives.budget)
    file_of(conf, "budget", budget, f"budget={budget}: expected one of")
    return Study(
        name=name,
        question=question,
        simulated=is_simulated,
        world=drives.world,
        root=drives.root,
        train=tuple(drives.train.split()),
        tests=tuple(drives.tests),
        budget=budget,
        submap=defaults["submap"],
        grids=tuple(CellSize.read(conf, name, grid) for grid in defaults["grids"]),
        methods=tuple(
            StudyMethod.described(conf, method, views.get(view, view))
            for method, view in views_of_methods.items()
        ),
        tolerance=Tolerance.read(conf, name, TOLERANCE),
    )


def with_preset(study: Study, request: Request) -> Study:
    """What goes with the preset of a simulated world: its sequences of stress."""
    if not study.simulated:
        return study
    stress = request.defaults.get("stress", {}).get(_preset(request), {})
    return replace(study, stress=dict(stress))


def with_scale(study: Study, request: Request) -> Study:
    """What a scale, a file of conf/scale, has instead of the data set's choices.

    Its submaps, cells and tolerance, and each method's view and settings.
    """
    if "scale" not in request:
        return study
    scale_file = file_of(
        request.conf,
        "scale",
        request.options["scale"],
        f"scale={request.options['scale']}: expected one of",
    )
    scale = read_yaml(scale_file)
    methods = []
    for method in study.methods:
        view = scale.get("views", {}).get(method.view, method.view)
        own_settings = settings_of(request.conf, method.name)
        settings = {
            key: value for key, value in scale.get("methods", {}).items() if key in own_settings
        }
        described = StudyMethod.described(request.conf, method.name, view)
        methods.append(replace(described, settings=settings))
    grids = scale.get("grids", study.grid_names)
    tolerance = scale.get("tolerance", study.tolerance.name)
    return replace(
        study,
        submap=scale.get("submap", {}).get(study.submap, study.submap),
        grids=tuple(CellSize.read(request.conf, study.name, grid) for grid in grids),
        tolerance=Tolerance.read(request.conf, study.name, tolerance),
        methods=tuple(methods),
    )


def with_models(study: Study, request: Request) -> Study:
    """The variants of each method, and the seeds of one that draws at random in training."""
    seeds = request.options.get("seeds", str(request.defaults.get("seeds", 1)))
    if not (seeds.isdecimal() and 1 <= int(seeds) <= MOST_SEEDS):
        raise ConfigError(f"seeds={seeds}: expected a number from 1 to {MOST_SEEDS}")
    names = [method.name for method in study.methods]
    offered: dict[str, Mapping[str, str]] = {
        method: variants
        for method, variants in request.defaults.get("variants", {}).items()
        if method in names
    }
    all_variants = sorted({name for variants in offered.values() for name in variants})
    unasked = study.question == "viewpoints" and "variants" not in request
    wanted = [] if unasked else request.names("variants", all_variants)  # each trains for minutes
    methods = []
    for method in study.methods:
        variants = {
            name: words for name, words in offered.get(method.name, {}).items() if name in wanted
        }
        is_random = "seed" in settings_of(request.conf, method.name)
        methods.append(replace(method, variants=variants, seeds=int(seeds) if is_random else 1))
    if int(seeds) > 1 and "seeds" in request and all(method.seeds == 1 for method in methods):
        raise ConfigError(
            f"seeds={seeds}: none of {','.join(names)} draws at random; leave seeds out"
        )
    return replace(study, methods=tuple(methods))


def with_question(study: Study, request: Request) -> Study:
    """What a question needs: methods on bird-views, or further days and strategies."""
    if study.question == "viewpoints" and len(study.bird_view_methods) < len(study.methods):
        raise ConfigError(
            f"methods={','.join(method.name for method in study.methods)}: only methods that look "
            "at bird-views can be asked about viewpoints"
        )
    if not study.learns_further_days:
        return study
    preset = _preset(request) if study.simulated else ""
    study = with_further_days(study, request.defaults, preset, request.options.get("learned", ""))
    methods = [
        replace(
            method,
            courses=courses(
                request.defaults, settings_of(request.conf, method.name), bool(study.updates)
            ),
        )
        for method in study.methods
    ]
    return replace(study, methods=tuple(methods))


def with_alterations(study: Study, request: Request) -> Study:
    """Altered queries of some test sequences, and further cell sizes."""
    alterable = {
        name: tuple(spread([*study.tests], number))
        for name, number in request.defaults.get("altered", {}).items()
    }
    alterations = request.names("altered", [*alterable])
    cells = request.defaults.get("cells", [])
    if "cells" in request:
        grid_files = sorted((request.conf / "grid").glob("*.yaml"))
        cells = request.names(
            "cells", [file.stem for file in grid_files if file.stem not in study.grid_names]
        )
    return replace(
        study,
        altered={name: alterable[name] for name in alterations},
        cells=tuple(CellSize.read(request.conf, study.name, cell) for cell in cells),
    )


def with_poses(study: Study, request: Request) -> Study:
    """Which models' answers are registered with the map, and how poses are joined along a drive.

    Without poses= these are the models that the data set's yaml names.
    """
    registered = request.defaults.get("poses", ())
    if study.simulated and registered:
        registered = registered.get(_preset(request), ())
    if "poses" in NEEDLESS.get(study.question, set()):
        registered = ()
    families = [model.family for model in study.models if not model.seed]
    wanted = request.options.get("poses", "").split(",")
    names_models = "poses" in request and wanted != [SLAM]
    offered = [name for name in families if names_models or name in registered]
    poses = request.names("poses", [*offered, SLAM]) if names_models else offered
    poses = [name for name in poses if name != SLAM]
    offered_paths = [path.stem for path in sorted((request.conf / "path").glob("*.yaml"))]
    paths = request.names("paths", offered_paths if "paths" in request else [])
    if paths and not poses:
        raise ConfigError(
            f"paths={request.options['paths']}: joins poses along a drive; say poses=METHOD too"
        )
    return replace(study, poses=tuple(poses), paths=tuple(paths), slam=SLAM in wanted)


def with_timing(study: Study, request: Request) -> Study:
    """Whether the cost of a query is measured."""
    if (latency := request.options.get("latency", "yes")) not in ("yes", "no"):
        raise ConfigError(f"latency={latency}: expected yes or no")
    return replace(study, latency=latency == "yes")


def _preset(request: Request) -> str:
    return request.options.get("world", PRESET)


def _refuse_unknown(
    name: str, dataset: Mapping[str, Any], question: str, options: Mapping[str, str]
) -> None:
    """Raises ConfigError for an option that a data set or a question does not take."""
    allowed = set(OPTIONS)
    allowed |= {"learned"} if question == LIFELONG else set()
    allowed |= {"world"} if dataset["simulated"] else {"root", "log", "parts", "train"}
    needless = NEEDLESS.get(question, set())
    allowed -= {option for option in needless if options.get(option) not in ("", "no")}
    if unknown := sorted(set(options) - allowed):
        request = f"{name} question={question}" if needless else name
        raise ConfigError(
            f"{request} has no option {unknown[0]}: expected {', '.join(sorted(allowed))}"
        )


def refuse_unposed(study: Study, reader: Mapping[str, Any]) -> None:
    """Raise ConfigError for logs without poses that are not to be estimated, or cannot be."""
    without = [key for key in ("truth", "poses") if key in reader and not reader[key]]
    if without and not study.slam:
        raise ConfigError(
            f"{study.name}: reader.{without[0]} of its yaml names no poses; say poses=slam, and "
            "they are estimated from the scans"
        )
    by_path = [
        name for name in study.sequences if (part := Part.named(name)[1]) and part.needs_path
    ]
    if by_path and study.slam:
        raise ConfigError(
            f"{by_path[0]}: a part by path, which is not known before poses=slam has estimated it; "
            "split the log by time, as in parts=time:2"
        )


def _defaults(conf: Path, name: str, study: Mapping[str, Any], question: str) -> Mapping[str, Any]:
    """A data set's study with what a question changes in every study, and in this one.

    Raises ConfigError for a question that this data set cannot be asked.
    """
    offered = [word for word in QUESTIONS if word != "viewpoints" or word in study]
    if question not in offered:
        raise ConfigError(f"question={question}: of {name} expected {' or '.join(offered)}")
    whole_logs = {"parts": False} if question == "viewpoints" else {}
    asked_of_all = conf / "question" / f"{question}.yaml"
    changes = read_yaml(asked_of_all) if asked_of_all.is_file() else {}
    asked_of_this = study.get(question, {})
    merged = {**study, **whole_logs, **changes, **asked_of_this}
    if "variants" in changes and "variants" in asked_of_this:
        general = changes["variants"]
        further = asked_of_this["variants"]
        merged["variants"] = {
            method: {**general.get(method, {}), **further.get(method, {})}
            for method in (general | further)
        }
    return merged


def spread(tests: list[str], number: int) -> list[str]:
    """`number` of the test sequences, evenly from the first to the last; all if there are fewer."""
    if number >= len(tests):
        return list(tests)
    return [tests[round(i * (len(tests) - 1) / max(number - 1, 1))] for i in range(number)]


CHANGES = (
    with_preset,
    with_scale,
    with_models,
    with_question,
    with_alterations,
    with_poses,
    with_timing,
)
"""From study to study, in the order in which they are applied."""
