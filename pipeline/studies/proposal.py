"""Proposes the study of a data set: the words of `yearloc use` in; a `Study` out.

1. Find the sequences that train and test (`discovery`).
2. Make a study of them, with the choices in the data set's yaml (`first_choices`).
3. Apply CHANGES to it one after another: the preset of its world, the scale, the variants and seeds
   of each method, the question, altered queries, poses, and timing. Each is a function that takes a
   study and returns a changed one.
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
"""The options of `yearloc use` that every study takes."""
MOST_SEEDS = 100
NEEDLESS = {
    "viewpoints": {"altered", "cells", "poses", "paths", "latency"},
    LIFELONG: {"altered", "cells", "poses", "paths", "latency"},
}
"""By question, the options of `yearloc use` that have no effect on its studies."""
SLAM = "slam"
"""The word after `poses=` by which poses are estimated from the scans; other words name models."""
PRESET = "demo"
"""The preset of a simulated world without the option `world=`: one of its files in conf/world."""


@dataclass(frozen=True)
class Proposal:
    """A study for conf/studies.yaml, and what a person should know about it."""

    study: Study
    notes: list[str]


@dataclass(frozen=True)
class Request:
    """What a person asks of a data set, beside the choices that its yaml makes."""

    conf: Path
    """The project's folder conf/."""
    options: Mapping[str, str]
    """The words KEY=VALUE of `yearloc use`."""
    defaults: Mapping[str, Any]
    """The study in the data set's yaml, with the changes that the question makes to it."""

    def __contains__(self, option: str) -> bool:
        return option in self.options

    def names(self, option: str, offered: Sequence[str]) -> list[str]:
        """The names after an option; all `offered` ones without the option, none if it is empty.

        Raises ConfigError for a name that is not offered.
        """
        wanted = self.options[option].split(",") if option in self.options else offered
        names = [name for name in dict.fromkeys(wanted) if name]
        for name in names:
            if name not in offered:
                expected = "this question and these methods have none"
                if offered:
                    expected = f"expected some of {', '.join(offered)}"
                raise ConfigError(f"{option}={name}: {expected}")
        return names


def propose(conf: Path, name: str, options: Mapping[str, str]) -> Proposal:
    """Propose the study of data set `name`, a file of conf/dataset.

    `options` are the words KEY=VALUE of `yearloc use`. Several values have commas between. Raises
    ConfigError for an unknown data set, option or value, and if the logs on disk do not make a
    study.
    """
    dataset = read_yaml(file_of(conf, "dataset", name, f"no data set {name}: expected one of"))
    question = options.get("question", QUESTIONS[0])
    _refuse_unknown(name, dataset, question, options)
    request = Request(conf, options, _defaults(conf, name, dataset["study"], question))
    if dataset["simulated"]:
        drives = simulated(conf, name, request.defaults, options)
    else:
        drives = recorded(name, dataset["reader"], request.defaults, options)
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
    names = request.options["methods"].split(",") if "methods" in request else defaults["methods"]
    view_of_method = {method: str(settings_of(conf, method)["view"]) for method in names}
    replaced_views = defaults.get("views", {})
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
            StudyMethod.described(conf, method, replaced_views.get(view, view))
            for method, view in view_of_method.items()
        ),
        tolerance=Tolerance.read(conf, name, TOLERANCE),
    )


def with_preset(study: Study, request: Request) -> Study:
    """The study with the stress sequences of its world: drives that are hard in one way."""
    if not study.simulated:
        return study
    stress = request.defaults.get("stress", {}).get(_preset(request), {})
    return replace(study, stress=dict(stress))


def with_scale(study: Study, request: Request) -> Study:
    """The study at another scale, a file of conf/scale, if the option is given.

    A scale replaces the submaps, the cell sizes, the tolerance, and views and settings of methods.
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
    """The study with the variants of each method, and the seeds of those that train at random."""
    seeds = request.options.get("seeds", str(request.defaults.get("seeds", 1)))
    if not (seeds.isdecimal() and 1 <= int(seeds) <= MOST_SEEDS):
        raise ConfigError(f"seeds={seeds}: expected a number from 1 to {MOST_SEEDS}")
    names = [method.name for method in study.methods]
    variants_of_methods: Mapping[str, Mapping[str, str]] = request.defaults.get("variants", {})
    offered = set[str]()
    for name in names:
        offered |= variants_of_methods.get(name, {}).keys()
    if study.question == "viewpoints" and "variants" not in request:
        wanted = []  # each would train for minutes
    else:
        wanted = request.names("variants", sorted(offered))
    methods = []
    for method in study.methods:
        variants = {
            variant: words
            for variant, words in variants_of_methods.get(method.name, {}).items()
            if variant in wanted
        }
        is_random = "seed" in settings_of(request.conf, method.name)
        methods.append(replace(method, variants=variants, seeds=int(seeds) if is_random else 1))
    if int(seeds) > 1 and "seeds" in request and all(method.seeds == 1 for method in methods):
        raise ConfigError(
            f"seeds={seeds}: none of {','.join(names)} draws at random; leave seeds out"
        )
    return replace(study, methods=tuple(methods))


def with_question(study: Study, request: Request) -> Study:
    """The study with what its question needs, such as further days and strategies to learn them.

    Raises ConfigError for methods that the question of viewpoints cannot be asked about.
    """
    if study.question == "viewpoints" and len(study.bird_view_methods) < len(study.methods):
        raise ConfigError(
            f"methods={','.join(method.name for method in study.methods)}: only methods that look "
            "at bird-views can be asked about viewpoints"
        )
    if not study.learns_further_days:
        return study
    preset = _preset(request) if study.simulated else ""
    study = with_further_days(study, request.defaults, preset, request.options.get("learned", ""))
    methods = []
    for method in study.methods:
        settings = settings_of(request.conf, method.name)
        courses_of_method = courses(request.defaults, settings, bool(study.updates))
        methods.append(replace(method, courses=courses_of_method))
    return replace(study, methods=tuple(methods))


def with_alterations(study: Study, request: Request) -> Study:
    """The study with altered queries of some test sequences, and with further cell sizes."""
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
    """The study with the models whose answers are registered to poses, and the ways to join them.

    poses= names the models; without it they are those that the data set's yaml names. poses=slam
    means that the logs have no poses and these are estimated from the scans. paths= names the ways
    in which poses are joined along a drive.
    """
    wants_slam = SLAM in request.options.get("poses", "").split(",")
    poses = _posed_families(study, request)
    offered_paths = [path.stem for path in sorted((request.conf / "path").glob("*.yaml"))]
    paths = request.names("paths", offered_paths) if "paths" in request else []
    if paths and not poses:
        raise ConfigError(
            f"paths={request.options['paths']}: joins poses along a drive; say poses=METHOD too"
        )
    return replace(study, poses=tuple(poses), paths=tuple(paths), slam=wants_slam)


def _posed_families(study: Study, request: Request) -> list[str]:
    """The families of models (method and variant) whose answers are registered."""
    families = [model.family for model in study.models if not model.seed]
    names_models = "poses" in request and request.options["poses"] != SLAM
    if names_models:
        return [name for name in request.names("poses", [*families, SLAM]) if name != SLAM]
    if "poses" in NEEDLESS.get(study.question, set()):
        return []
    default_families = request.defaults.get("poses", ())
    if study.simulated and default_families:
        default_families = default_families.get(_preset(request), ())
    return [name for name in families if name in default_families]


def with_timing(study: Study, request: Request) -> Study:
    """The study with the choice whether the cost of a query is measured."""
    latency = request.options.get("latency", "yes")
    if latency not in ("yes", "no"):
        raise ConfigError(f"latency={latency}: expected yes or no")
    return replace(study, latency=latency == "yes")


def _preset(request: Request) -> str:
    """The preset of the simulated world."""
    return request.options.get("world", PRESET)


def _refuse_unknown(
    name: str, dataset: Mapping[str, Any], question: str, options: Mapping[str, str]
) -> None:
    """Raise ConfigError for an option that a data set or a question does not take."""
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
    """Raise ConfigError if logs have no poses, and these cannot or shall not be estimated."""
    for key in ("truth", "poses"):
        if key in reader and not reader[key] and not study.slam:
            raise ConfigError(
                f"{study.name}: reader.{key} of its yaml names no poses; say poses=slam, and "
                "they are estimated from the scans"
            )
    for sequence in study.sequences if study.slam else ():
        _, part = Part.named(sequence)
        if part and part.needs_path:
            raise ConfigError(
                f"{sequence}: a part by path, which is not known before poses=slam has estimated "
                "it; split the log by time, as in parts=time:2"
            )


def _defaults(conf: Path, name: str, study: Mapping[str, Any], question: str) -> Mapping[str, Any]:
    """The study in a data set's yaml, with the changes that a question makes to it.

    conf/question/QUESTION.yaml has the changes to every study, the data set's yaml those to its
    own. Raises ConfigError for a question that this data set cannot be asked.
    """
    offered = [word for word in QUESTIONS if word != "viewpoints" or word in study]
    if question not in offered:
        raise ConfigError(f"question={question}: of {name} expected {' or '.join(offered)}")
    whole_logs = {"parts": False} if question == "viewpoints" else {}
    question_file = conf / "question" / f"{question}.yaml"
    general_changes = read_yaml(question_file) if question_file.is_file() else {}
    own_changes = study.get(question, {})
    defaults = {**study, **whole_logs, **general_changes, **own_changes}
    if "variants" in general_changes and "variants" in own_changes:
        general = general_changes["variants"]
        own = own_changes["variants"]
        defaults["variants"] = {
            method: {**general.get(method, {}), **own.get(method, {})} for method in general | own
        }
    return defaults


def spread(tests: list[str], number: int) -> list[str]:
    """Choose `number` test sequences evenly from the first to the last; all if there are fewer."""
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
"""The changes to a study in the order in which they are applied."""
