"""A study: which days are learned, which days are queried, and which methods are compared.

A study has one of four experiments.
- `year`: how well does a localiser work through a year? Methods on bird-views are judged with
  turned robots too (DOM and PFL, IROS 2018).
- `robustness`: the same, also with perturbed queries, stress sequences (drives that are hard in one
  way), other cell sizes, and variants of the methods.
- `viewpoints`: turned robots alone, on sequences that share no place with training.
- `lifelong`: what does a model answer after it has learned further days?

`Study.of` reads a study of conf/studies.yaml and checks it; `Study.table` is what is written there.
"""

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal, Self, get_args

from pipeline.core.errors import ConfigError
from pipeline.core.settings import Count, Names, filled, plain
from pipeline.running.texts import read_yaml
from pipeline.studies.models import ModelName

YEAR: Final = "year"
ROBUSTNESS: Final = "robustness"
VIEWPOINTS: Final = "viewpoints"
LIFELONG: Final = "lifelong"
Experiment = Literal["year", "robustness", "viewpoints", "lifelong"]
EXPERIMENTS = get_args(Experiment)
Stage = Literal["views", "birdviews"]
VIEWS: Final = "views"
"""The stage that draws views of single submaps."""
BIRD_VIEWS: Final = "birdviews"
"""The stage that draws bird-views, of an octree of all scans so far."""
MAP_SEQUENCE: Final = "map"
"""The training sequence of a study that learns a 3-D map instead of a drive."""
VIEW_WORD = "method.view="
"""The beginning of the word by which a variant looks at another view than its method."""
EMPTY: tuple[object, ...] = ("", [], {}, None)
"""Values of a key in conf/studies.yaml that count as if it were left out."""
TOLERANCE = "15m"
"""How near an answer must be unless the study says otherwise: a file of conf/tolerance."""
SIMULATED = {"source": "world", "reads": "simulated"}
RECORDED = {"source": "readers", "reads": "reader"}
"""Where the logs of a simulated and of a recorded study come from.

`source` says what provides the logs: a simulated world, or a reader of recorded ones. `reads` is
the key of the data set's yaml that they depend on: `reader` if they are recorded, else only
`simulated`.
"""
KEYS = (
    "experiment",
    "world",
    *SIMULATED,
    "root",
    "map",
    "slam",
    "train",
    "tests",
    "budget",
    "learned",
    "self_training",
    "submap",
    "grids",
    "methods",
    "perturbed",
    "cells",
    "stress",
    "poses",
    "paths",
    "tolerance",
    "latency",
)
"""The keys of a study in conf/studies.yaml, in the order of writing: the fields of `Study`, with
two keys for `simulated`."""


@dataclass(frozen=True)
class CellSize:
    """The cell size of a study's grid: a file of conf/grid, and the wanted side of its cells."""

    name: str
    cell_m: float

    @classmethod
    def read(cls, conf: Path, name: str) -> Self:
        """Read conf/grid/`name`.yaml; raises ConfigError if it is missing."""
        return cls(name, float(read_yaml(file_of(conf, "grid", name))["cell_m"]))


@dataclass(frozen=True)
class Tolerance:
    """How near an answer must be: a file of conf/tolerance, and its distance in metres."""

    name: str
    correct_m: float

    @classmethod
    def read(cls, conf: Path, name: str) -> Self:
        """Read conf/tolerance/`name`.yaml; raises ConfigError if it is missing."""
        content = read_yaml(file_of(conf, "tolerance", name))
        return cls(name, float(content["distance"]["correct_m"]))


@dataclass(frozen=True)
class StudyMethod:
    """A method as a study compares it."""

    name: str
    """A file of conf/method."""
    view: str
    """What it looks at: a file of conf/view."""
    code: str
    """The file of its module, or its folder if it has several."""
    stage: Stage = VIEWS
    """The stage that draws its view."""
    seeds: Count = 1
    """The number of models that are trained with different random draws."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """The settings of its yaml to which this study gives another value."""
    variants: Mapping[str, str] = field(default_factory=dict)
    """Its variants by name, each with the words of the command line that make it."""
    courses: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """For each order of the further days the strategies to learn them: files of conf/strategy."""

    @classmethod
    def described(cls, conf: Path, name: str, view: str = "") -> Self:
        """The method of conf/method/`name`.yaml, looking at `view` if that is given.

        Raises ConfigError if there is no such method.
        """
        settings = settings_of(conf, name)
        # a class of pipeline.methods.NAME, or of a module in a folder of this name
        *module, _ = settings["_target_"].split(".")
        code = "/".join(module[:3])
        if len(module) == 3:
            code += ".py"
        view = view or str(settings["view"])
        return cls(name, view, code, stage_of(conf, view))

    def view_of(self, variant: str) -> str:
        """What a variant looks at: the view that its words name, else the method's own."""
        view = self.view
        for word in self.variants.get(variant, "").split():
            if word.startswith(VIEW_WORD):
                view = word.removeprefix(VIEW_WORD)
        return view

    @property
    def views(self) -> tuple[str, ...]:
        """The views that it and its variants look at, each once."""
        return tuple(dict.fromkeys(map(self.view_of, ("", *self.variants))))

    @property
    def models(self) -> list[ModelName]:
        """The models of the method itself, then of each variant, each with every seed."""
        return [
            ModelName(self.name, variant, seed)
            for variant in ("", *self.variants)
            for seed in range(self.seeds)
        ]

    @property
    def families(self) -> dict[str, list[ModelName]]:
        """The models by family: the method itself or a variant, with one model of each seed."""
        families: dict[str, list[ModelName]] = {}
        for model in self.models:
            families.setdefault(model.family, []).append(model)
        return families

    @property
    def is_on_bird_views(self) -> bool:
        """Whether it looks at bird-views, which are drawn at all headings."""
        return self.stage == BIRD_VIEWS


@dataclass(frozen=True)
class Study:
    """One data set's training sequences, its test sequences, and what is compared on them."""

    name: str
    """The name of the data set, a file of conf/dataset; the study is called the same."""
    experiment: Experiment
    simulated: bool
    """Whether the logs were driven in a simulated world, not recorded."""
    world: str
    """The simulated world, or `recorded`: a file of conf/world."""
    root: str
    """The folder of the logs."""
    train: Names
    """The training sequences; a study of viewpoints may have several."""
    tests: tuple[str, ...]
    """The test sequences."""
    budget: str
    """The training budget: a file of conf/budget."""
    submap: str
    """How a drive is cut into submaps: a file of conf/submap."""
    grids: tuple[CellSize, ...]
    """The cell sizes at which everything is measured."""
    methods: tuple[StudyMethod, ...]
    """The methods that are compared."""
    tolerance: Tolerance
    """How near an answer must be to be right."""
    learned: tuple[str, ...] = ()
    """Sequences with reference poses that models learn after training."""
    self_training: tuple[str, ...] = ()
    """Sequences without reference poses, which a site learns from its own poses (pseudo-labels)."""
    perturbed: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """For each perturbation (a file of conf/perturbation) the test sequences that it perturbs."""
    cells: tuple[CellSize, ...] = ()
    """Further cell sizes, at which only the methods' own models are queried."""
    stress: Mapping[str, str] = field(default_factory=dict)
    """Sequences that are hard in one way, each with a description of it."""
    poses: tuple[str, ...] = ()
    """Families of models whose answers are registered with the map: `sci`, `sci-4way`."""
    paths: tuple[str, ...] = ()
    """The ways in which the poses of a drive are joined: files of conf/path."""
    latency: bool = True
    """Whether the cost of a query is measured."""
    slam: bool = False
    """Whether poses are estimated from the scans, not read from the logs."""
    map: str = ""
    """The 3-D map that is learned instead of a drive, a file or a folder of tiles; or nothing."""
    key_order: tuple[str, ...] = field(default=(), compare=False)
    """The keys that conf/studies.yaml has, in its order, so that it is written in this order."""

    @classmethod
    def of(cls, conf: Path, name: str, table: Mapping[str, Any]) -> Self:
        """Read the study `name` of conf/studies.yaml.

        Whoever writes it by hand may leave out the experiment, and each method's view, code and
        stage. Raises ConfigError for a key that is missing or unknown, for a value of a wrong type,
        and for a grid, tolerance or method that conf/ has no file of.
        """
        with faults_of(name):
            _refuse_unknown("the study", table, KEYS)
            origin = {key: table.get(key) for key in SIMULATED}
            if origin not in (SIMULATED, RECORDED):
                raise ConfigError(
                    f"source={origin['source']} and reads={origin['reads']}: expected world and "
                    "simulated, or readers and reader"
                )
            filled_keys = {key: value for key, value in table.items() if value not in EMPTY}
            settings = {
                "experiment": YEAR,
                "tolerance": TOLERANCE,
                **filled_keys,
                "name": name,
                "simulated": origin == SIMULATED,
                "key_order": [*table],
            }
            return filled(cls, settings, partial(_of_conf, conf))

    def table(self) -> dict[str, Any]:
        """The study as conf/studies.yaml has it, with its experiment."""
        values = {
            **{field.name: plain(getattr(self, field.name)) for field in fields(self)},
            **self.origin,
            "train": self.train_text,
            "grids": self.grid_names,
            "cells": [grid.name for grid in self.cells],
            "tolerance": self.tolerance.name,
        }
        defaults = {"tolerance": TOLERANCE, "latency": True}
        table: dict[str, Any] = {}
        # a dict of keys, as a set that keeps their order
        for key in dict.fromkeys(("experiment", *self.key_order, *KEYS)):
            value = values[key]
            is_default = value == defaults[key] if key in defaults else not value
            if key in self.key_order or not is_default:
                table[key] = value
        return table

    @property
    def origin(self) -> Mapping[str, str]:
        """Where its logs come from: the keys `source` and `reads`."""
        return SIMULATED if self.simulated else RECORDED

    @property
    def drives(self) -> tuple[str, ...]:
        """All sequences that are drives: without the 3-D map that may stand for training."""
        return tuple(name for name in self.sequences if not self.map or name not in self.train)

    @property
    def train_text(self) -> str:
        """The training sequences as a stage's command line has them, with blanks between."""
        return " ".join(self.train)

    @property
    def training(self) -> str:
        """What was learned, for a sentence: the training sequences, or a 3-D map."""
        return "a 3-D map" if self.map else self.train_text

    @property
    def tests_over_days(self) -> bool:
        """Whether its experiment is `year` or `robustness`: the tests revisit training's places."""
        return self.experiment in (YEAR, ROBUSTNESS)

    @property
    def learns_further_days(self) -> bool:
        """Whether its experiment is `lifelong`: models learn days after training."""
        return self.experiment == LIFELONG

    @property
    def sequences(self) -> tuple[str, ...]:
        """All sequences: those of training, tests and stress, and further days."""
        return (*self.train, *self.tests, *self.stress, *self.learned, *self.self_training)

    @property
    def query_days(self) -> tuple[str, ...]:
        """The sequences whose queries are judged: tests and stress."""
        return (*self.tests, *self.stress)

    @property
    def grid_names(self) -> list[str]:
        """The names of the cell sizes at which everything is measured."""
        return [grid.name for grid in self.grids]

    @property
    def all_grids(self) -> tuple[CellSize, ...]:
        """All cell sizes, with the further ones at which little is measured."""
        return (*self.grids, *self.cells)

    @property
    def models(self) -> list[ModelName]:
        """The models of all methods, with variants and seeds."""
        return [model for method in self.methods for model in method.models]

    @property
    def bird_view_methods(self) -> list[StudyMethod]:
        """The methods that look at bird-views."""
        return [method for method in self.methods if method.is_on_bird_views]

    def answers_of(self, model: ModelName) -> list[ModelName]:
        """The names of a model's answers: without poses, with poses, and along each path."""
        if model.family not in self.poses:
            return [model]
        posed = replace(model, posed=True)
        return [model, posed, *(replace(posed, path=path) for path in self.paths)]

    @property
    def answerers(self) -> list[ModelName]:
        """The names of all answers of all models, without and with poses and paths."""
        return [answers for model in self.models for answers in self.answers_of(model)]


def _of_conf(conf: Path, kind: Any, value: Any) -> Any:
    """The object that a name of a file of conf/ stands for; a method's table is completed."""
    is_name = isinstance(value, str)
    if kind in (CellSize, Tolerance):
        return kind.read(conf, value) if is_name else value
    table = {"name": value} if is_name else value
    if kind is not StudyMethod or not isinstance(table, Mapping):
        return value
    _refuse_unknown("a method", table, [field.name for field in fields(StudyMethod)])
    if not {"view", "code"} <= table.keys() and isinstance(table.get("name"), str):
        described = StudyMethod.described(conf, table["name"], table.get("view", ""))
        table = {"view": described.view, "code": described.code, **table}
    return {"stage": stage_of(conf, table.get("view", "")), **table}


def _refuse_unknown(what: str, table: Mapping[str, Any], keys: Collection[str]) -> None:
    for key in table:
        if key not in keys:
            raise ConfigError(f"{what} has a key {key}; expected some of {', '.join(keys)}")


@contextmanager
def faults_of(study: str) -> Iterator[None]:
    """Name the study of conf/studies.yaml at the beginning of an error raised in the block."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(
            f"conf/studies.yaml: {study}: {error}; correct it, or `yearloc use {study}` writes the "
            "study again"
        ) from None


def file_of(conf: Path, group: str, name: str, refusal: str = "") -> Path:
    """The path of the file conf/`group`/`name`.yaml.

    If it is missing, raises ConfigError with `refusal` and the names of the files that exist.
    """
    path = conf / group / f"{name}.yaml"
    if not path.is_file():
        choices = sorted(file.stem for file in path.parent.glob("*.yaml"))
        raise ConfigError(f"{refusal or f'{group}={name}: expected one of'} {', '.join(choices)}")
    return path


def settings_of(conf: Path, method: str) -> dict[str, Any]:
    """Read the yaml of a method; raises ConfigError if there is no such method."""
    return read_yaml(file_of(conf, "method", method, f"methods={method}: expected some of"))


def stage_of(conf: Path, view: str) -> Stage:
    """The stage that draws a view: `birdviews` if it is of an octree, which has a memory."""
    path = conf / "view" / f"{view}.yaml"
    return BIRD_VIEWS if path.is_file() and "octree" in read_yaml(path) else VIEWS
