"""Proposes the study of a data set: the words of `yearloc use` in; a `Study` out.

1. Find the sequences that train and test (`discovery`).
2. Make a study of them, with the choices in the data set's yaml (`first_choices`).
3. Apply CHANGES to it one after another: the stress sequences of its world's preset, the scale,
   the variants and seeds of each method, the experiment, perturbed queries, poses, and timing. Each
   is a function that takes a study and returns a changed one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from pipeline.core.errors import ConfigError
from pipeline.readers.splits import Split
from pipeline.running.texts import read_yaml
from pipeline.studies.discovery import Drives, map_path, recorded_drives, simulated_drives
from pipeline.studies.study import (
    EXPERIMENTS,
    LIFELONG,
    MAP_SEQUENCE,
    TOLERANCE,
    VIEWPOINTS,
    YEAR,
    CellSize,
    Experiment,
    Study,
    StudyMethod,
    Tolerance,
    file_of,
    settings_of,
)

OPTIONS = (
    "perturbed",
    "budget",
    "cells",
    "latency",
    "methods",
    "paths",
    "poses",
    "experiment",
    "scale",
    "seeds",
    "tests",
    "variants",
)
"""The options of `yearloc use` for a study, without those in NEEDLESS for its experiment."""
MOST_SEEDS = 100
"""The most models of a method that `seeds=` may ask for."""
NEEDLESS = {
    VIEWPOINTS: {"perturbed", "cells", "poses", "paths", "latency"},
    LIFELONG: {"perturbed", "cells", "poses", "paths", "latency"},
}
"""By experiment, the options of `yearloc use` that have no effect on its studies."""
OF_MAPS = ("bev_correlation",)
"""The methods that learn a 3-D map: others look at it from where a sensor was."""
DRIVEN = ("experiment", "log", "perturbed", "scale", "split", "train")
"""The options of `yearloc use` that need a drive to learn, not a 3-D map."""
SLAM = "slam"
"""The word after `poses=` by which poses are estimated from the scans; other words name models."""
REPLAYED = "replayed"
"""A method with this setting trains its network further; any other only adds to its database."""
PRESET = "demo"
"""The preset of a simulated world without the option `world=`: one of its files in conf/world."""


@dataclass(frozen=True)
class Request:
    """What a person wants from a data set, beside the choices that its yaml makes."""

    conf: Path
    """The project's folder conf/."""
    options: Mapping[str, str]
    """The words KEY=VALUE of `yearloc use`."""
    defaults: Mapping[str, Any]
    """The study in the data set's yaml, with the changes that the experiment makes to it."""

    def has(self, option: str) -> bool:
        """Whether the person gave an option, even an empty one."""
        return option in self.options

    def names(self, option: str, choices: Sequence[str]) -> list[str]:
        """The names after an option, each once; all `choices` if the option is not given.

        An empty option gives none. Raises ConfigError for a name that is not among the choices.
        """
        words = self.options[option].split(",") if self.has(option) else choices
        names = [name for name in dict.fromkeys(words) if name]
        for name in names:
            if name not in choices:
                expected = "this experiment and these methods have none"
                if choices:
                    expected = f"expected some of {', '.join(choices)}"
                raise ConfigError(f"{option}={name}: {expected}")
        return names

    @property
    def preset(self) -> str:
        """The preset of the simulated world."""
        return self.options.get("world", PRESET)


def propose(conf: Path, name: str, options: Mapping[str, str]) -> tuple[Study, list[str]]:
    """Propose the study of data set `name`, a file of conf/dataset, with notes for its user.

    `options` are the words KEY=VALUE of `yearloc use`. Several values have commas between. Raises
    ConfigError for an unknown data set, option or value, and if the logs on disk do not make a
    study.
    """
    dataset = read_yaml(file_of(conf, "dataset", name, f"no data set {name}: expected one of"))
    experiment = cast(Experiment, options.get("experiment", YEAR))  # `_defaults` refuses any other
    _refuse_unknown(name, dataset, experiment, options)
    defaults = _defaults(conf, name, dataset["study"], experiment)
    if MAP_SEQUENCE in options:
        defaults = {**defaults, "methods": OF_MAPS, "poses": OF_MAPS, "variants": {}}
        defaults |= {"perturbed": {}, "views": {}}
    request = Request(conf, options, defaults)
    if dataset["simulated"]:
        drives = simulated_drives(conf, name, request.defaults, options)
    else:
        drives = recorded_drives(name, dataset["reader"], request.defaults, options)
    study = first_choices(request, name, experiment, dataset["simulated"], drives)
    for change in CHANGES:
        study = change(study, request)
    refuse_unposed(study, dataset["reader"])
    return study, drives.notes


def first_choices(
    request: Request, name: str, experiment: Experiment, is_simulated: bool, drives: Drives
) -> Study:
    """The study of these drives with the choices of the data set's yaml.

    The methods and the budget are the person's, if the options name them. `name` is the data set.
    """
    conf = request.conf
    defaults = request.defaults
    names = defaults["methods"]
    if request.has("methods"):
        names = request.options["methods"].split(",")
    view_of_method = {method: str(settings_of(conf, method)["view"]) for method in names}
    # the data set may have some methods look at another view than their yaml says
    replaced_views = defaults.get("views", {})
    budget = request.options.get("budget", drives.budget)
    file_of(conf, "budget", budget)
    return Study(
        name=name,
        experiment=experiment,
        simulated=is_simulated,
        world=drives.world,
        root=drives.root,
        train=tuple(drives.train.split()),
        tests=tuple(drives.tests),
        budget=budget,
        submap=defaults["submap"],
        grids=tuple(CellSize.read(conf, grid) for grid in defaults["grids"]),
        methods=tuple(
            StudyMethod.described(conf, method, replaced_views.get(view, view))
            for method, view in view_of_method.items()
        ),
        tolerance=Tolerance.read(conf, TOLERANCE),
    )


def with_map(study: Study, request: Request) -> Study:
    """The study that learns a 3-D map instead of a drive, if the option is given.

    Raises ConfigError for methods that learn no map, LogError for a path that is no map.
    """
    if not request.has(MAP_SEQUENCE):
        return study
    for method in study.methods:
        if method.name not in OF_MAPS:
            raise ConfigError(
                f"methods={method.name}: learns scans, and a map has none; expected "
                f"{', '.join(OF_MAPS)}"
            )
    methods = tuple(replace(method, settings={"of_map": True}) for method in study.methods)
    return replace(study, map=map_path(request.options[MAP_SEQUENCE]), methods=methods)


def with_stress(study: Study, request: Request) -> Study:
    """The study with the stress sequences, drives hard in one way, of its world's preset."""
    if not study.simulated:
        return study
    stress = request.defaults.get("stress", {}).get(request.preset, {})
    return replace(study, stress=dict(stress))


def with_scale(study: Study, request: Request) -> Study:
    """The study at another scale, a file of conf/scale, if the option is given.

    A scale replaces the submaps, the cell sizes, the tolerance, and views and settings of methods.
    """
    if not request.has("scale"):
        return study
    name = request.options["scale"]
    scale = read_yaml(file_of(request.conf, "scale", name))
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
        grids=tuple(CellSize.read(request.conf, grid) for grid in grids),
        tolerance=Tolerance.read(request.conf, tolerance),
        methods=tuple(methods),
    )


def with_models(study: Study, request: Request) -> Study:
    """The study with the variants of each method, and the seeds of those that train at random.

    A study of viewpoints takes variants only where `variants=` names them. Raises ConfigError for
    a wrong number of seeds, or if no method would use several.
    """
    seeds = request.options.get("seeds", str(request.defaults.get("seeds", 1)))
    if not (seeds.isdecimal() and 1 <= int(seeds) <= MOST_SEEDS):
        raise ConfigError(f"seeds={seeds}: expected a number from 1 to {MOST_SEEDS}")
    names = [method.name for method in study.methods]
    variants_of_methods: Mapping[str, Mapping[str, str]] = request.defaults.get("variants", {})
    known_variants = set[str]()
    for name in names:
        known_variants |= variants_of_methods.get(name, {}).keys()
    if study.experiment == VIEWPOINTS and not request.has("variants"):
        variant_names = []  # each would train for minutes
    else:
        variant_names = request.names("variants", sorted(known_variants))
    methods = []
    for method in study.methods:
        variants = {
            variant: words
            for variant, words in variants_of_methods.get(method.name, {}).items()
            if variant in variant_names
        }
        is_random = "seed" in settings_of(request.conf, method.name)
        methods.append(replace(method, variants=variants, seeds=int(seeds) if is_random else 1))
    uses_seeds = any(method.seeds > 1 for method in methods)
    if int(seeds) > 1 and request.has("seeds") and not uses_seeds:
        raise ConfigError(
            f"seeds={seeds}: none of {','.join(names)} draws at random; leave seeds out"
        )
    return replace(study, methods=tuple(methods))


def with_experiment(study: Study, request: Request) -> Study:
    """The study with what its experiment needs: `lifelong` needs further days and courses.

    The courses of a method say in which order it learns these days, and by which strategies. Raises
    ConfigError for methods that cannot take part in the experiment of viewpoints.
    """
    if study.experiment == VIEWPOINTS and len(study.bird_view_methods) < len(study.methods):
        raise ConfigError(
            f"methods={','.join(method.name for method in study.methods)}: only methods that look "
            "at bird-views can be asked about viewpoints"
        )
    if not study.learns_further_days:
        return study
    preset = request.preset if study.simulated else ""
    study = with_further_days(study, request.defaults, preset, request.options.get("learned", ""))
    methods = []
    for method in study.methods:
        settings = settings_of(request.conf, method.name)
        courses_of_method = courses(
            request.defaults, settings, has_self_training=bool(study.self_training)
        )
        methods.append(replace(method, courses=courses_of_method))
    return replace(study, methods=tuple(methods))


def with_further_days(
    study: Study, defaults: Mapping[str, Any], preset: str, learned: str
) -> Study:
    """The study in which a model learns some of the test days, and is queried on the others.

    `learned` names the learned days, with commas between. If it is empty they are those that
    `defaults`, the study in the data set's yaml, has for this preset of a world, or else every
    second test day. Raises ConfigError if no day is left to learn or to query.
    """
    default_days = defaults.get("learned", {}).get(preset, study.tests[::2])
    learned_days = learned.split(",") if learned else list(default_days)
    query_days = [day for day in study.tests if day not in learned_days]
    if not learned_days or not query_days:
        raise ConfigError(
            f"learned={','.join(learned_days)}: expected some of several test sequences; the "
            "others are asked after each"
        )
    # a queried day must not be learned
    self_training = [
        day for day in defaults.get("self_training", {}).get(preset, ()) if day not in query_days
    ]
    return replace(
        study,
        learned=tuple(learned_days),
        tests=tuple(query_days),
        self_training=tuple(self_training),
    )


def courses(
    defaults: Mapping[str, Any], settings: Mapping[str, Any], has_self_training: bool
) -> dict[str, tuple[str, ...]]:
    """The strategies of each order for a method with these settings of its yaml.

    `defaults` has two tables: `trained` for methods that train further, and `courses` for others.
    The order `self_training` is left out unless the study has such days (`has_self_training`).
    """
    trains_further = REPLAYED in settings
    strategies_of_orders = defaults["trained" if trains_further else "courses"]
    return {
        order: tuple(strategies)
        for order, strategies in strategies_of_orders.items()
        if order != "self_training" or has_self_training
    }


def with_perturbations(study: Study, request: Request) -> Study:
    """The study with perturbed queries of some test sequences, and with further cell sizes."""
    # the data set's yaml says how many test sequences each perturbation perturbs
    sequences_of_perturbations = {
        name: tuple(evenly_chosen([*study.tests], number))
        for name, number in request.defaults.get("perturbed", {}).items()
    }
    perturbations = request.names("perturbed", [*sequences_of_perturbations])
    cells = request.defaults.get("cells", [])
    if request.has("cells"):
        grid_files = sorted((request.conf / "grid").glob("*.yaml"))
        cells = request.names(
            "cells", [file.stem for file in grid_files if file.stem not in study.grid_names]
        )
    return replace(
        study,
        perturbed={name: sequences_of_perturbations[name] for name in perturbations},
        cells=tuple(CellSize.read(request.conf, cell) for cell in cells),
    )


def with_poses(study: Study, request: Request) -> Study:
    """The study with the models whose answers are registered to poses, and the ways to join them.

    poses= names the models; without it they are those that the data set's yaml names. poses=slam
    means that the logs have no poses and these are estimated from the scans. paths= names the ways
    in which poses are joined along a drive.
    """
    poses = _posed_families(study, request)
    paths = []
    if request.has("paths"):
        path_files = sorted((request.conf / "path").glob("*.yaml"))
        paths = request.names("paths", [file.stem for file in path_files])
    if paths and not poses:
        raise ConfigError(
            f"paths={request.options['paths']}: joins poses along a drive; say poses=METHOD too"
        )
    is_slam = SLAM in request.options.get("poses", "").split(",")
    if is_slam and study.map:
        raise ConfigError("poses=slam: poses in a map are not estimated; the drives need their own")
    return replace(study, poses=tuple(poses), paths=tuple(paths), slam=is_slam)


def _posed_families(study: Study, request: Request) -> list[str]:
    """The families of models (method and variant) whose answers are registered."""
    families = [model.family for model in study.models if not model.seed]
    if request.options.get("poses", SLAM) != SLAM:
        return [name for name in request.names("poses", [*families, SLAM]) if name != SLAM]
    if "poses" in NEEDLESS.get(study.experiment, set()):
        return []
    default_families = request.defaults.get("poses", ())
    if study.simulated and default_families:
        # the yaml of a simulated data set has a list for each preset of its world
        default_families = default_families.get(request.preset, ())
    return [name for name in families if name in default_families]


def with_timing(study: Study, request: Request) -> Study:
    """The study with the choice whether the cost of a query is measured: `latency=` yes or no."""
    latency = request.options.get("latency", "yes")
    if latency not in ("yes", "no"):
        raise ConfigError(f"latency={latency}: expected yes or no")
    return replace(study, latency=latency == "yes")


def _refuse_unknown(
    name: str, dataset: Mapping[str, Any], experiment: str, options: Mapping[str, str]
) -> None:
    """Raise ConfigError for an option that the data set or the experiment does not take."""
    allowed = set(OPTIONS)
    allowed |= {"learned"} if experiment == LIFELONG else set()
    allowed |= (
        {"world"} if dataset["simulated"] else {"root", "log", "split", "train", MAP_SEQUENCE}
    )
    if MAP_SEQUENCE in options:
        allowed -= set(DRIVEN)
    needless = NEEDLESS.get(experiment, set())
    for option in needless:
        switches_off = options.get(option) in ("", "no")
        if not switches_off:  # to switch off what is off anyway is allowed
            allowed.discard(option)
    if unknown := sorted(set(options) - allowed):
        request = f"{name} experiment={experiment}" if needless else name
        request += " with map=" if MAP_SEQUENCE in options else ""
        raise ConfigError(
            f"{request} has no option {unknown[0]}: expected {', '.join(sorted(allowed))}"
        )


def refuse_unposed(study: Study, reader: Mapping[str, Any]) -> None:
    """Raise ConfigError if logs have no poses, and poses cannot or shall not be estimated."""
    for key in ("ground_truth", "poses"):  # the keys by which readers name the source of poses
        if key in reader and not reader[key] and not study.slam:
            raise ConfigError(
                f"{study.name}: reader.{key} of its yaml names no poses; say poses=slam, and "
                "they are estimated from the scans"
            )
    for sequence in study.sequences if study.slam else ():
        _, split = Split.named(sequence)
        if split and split.needs_path:
            raise ConfigError(
                f"{sequence}: a split by path, which is not known before poses=slam has estimated "
                "it; split the log by time, as in split=time:2"
            )


def _defaults(
    conf: Path, name: str, study: Mapping[str, Any], experiment: str
) -> Mapping[str, Any]:
    """The study in a data set's yaml, changed by conf/experiment and by the yaml itself."""
    # the experiment of viewpoints needs a table in the data set's yaml
    experiments = [word for word in EXPERIMENTS if word != VIEWPOINTS or word in study]
    if experiment not in experiments:
        raise ConfigError(f"experiment={experiment}: of {name} expected {' or '.join(experiments)}")
    # the sequences of viewpoints are whole logs; other experiments may split a log
    changes_of_logs = {"split": False} if experiment == VIEWPOINTS else {}
    experiment_file = conf / "experiment" / f"{experiment}.yaml"
    general_changes = read_yaml(experiment_file) if experiment_file.is_file() else {}
    own_changes = study.get(experiment, {})
    defaults = {**study, **changes_of_logs, **general_changes, **own_changes}
    if "variants" in general_changes and "variants" in own_changes:
        general_variants = general_changes["variants"]
        own_variants = own_changes["variants"]
        defaults["variants"] = {
            method: {**general_variants.get(method, {}), **own_variants.get(method, {})}
            for method in general_variants | own_variants
        }
    return defaults


def evenly_chosen(tests: list[str], number: int) -> list[str]:
    """Choose `number` test sequences evenly from the first to the last; all if there are fewer."""
    if number >= len(tests):
        return list(tests)
    last_row = len(tests) - 1
    last_choice = max(number - 1, 1)
    return [tests[round(choice * last_row / last_choice)] for choice in range(number)]


CHANGES = (
    with_map,
    with_stress,
    with_scale,
    with_models,
    with_experiment,
    with_perturbations,
    with_poses,
    with_timing,
)
"""The changes to a study in the order in which they are applied."""
