"""A study: which days are learned, which days are asked about, and which methods are compared.

A study has one of four questions.
- `year`: how does a localiser last over a year? Methods on bird-views are judged with turned robots
  besides (DOM and PFL, IROS 2018).
- `robustness`: the same, also with altered queries, stress sequences (drives that are hard in one
  way), other cell sizes, and variants of the methods.
- `viewpoints`: turned robots alone, on sequences that share no place with training.
- `lifelong`: what does a model answer after it learned further days (studies.courses)?

`Study.of` reads a study of conf/studies.yaml and checks it; `Study.table` is what is written there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Self

from pipeline.core.errors import ConfigError
from pipeline.core.settings import Count, within
from pipeline.running.texts import read_yaml
from pipeline.studies.models import ModelName

YEAR = "year"
ROBUSTNESS = "robustness"
VIEWPOINTS = "viewpoints"
LIFELONG = "lifelong"
QUESTIONS = (YEAR, ROBUSTNESS, VIEWPOINTS, LIFELONG)
VIEWS = "views"
"""The stage that draws views of single submaps."""
BIRD_VIEWS = "birdviews"
"""The stage that draws bird-views, of an octree of all scans so far."""
VIEW_WORD = "method.view="
"""The beginning of the word by which a variant looks at another view than its method."""
TOLERANCE = "15m"
"""How near an answer must be if a study does not say it: a file of conf/tolerance."""
NEEDED = (
    "world",
    "source",
    "heeds",
    "root",
    "train",
    "tests",
    "budget",
    "submap",
    "grids",
    "methods",
)
"""Keys that every study in conf/studies.yaml must have."""
SIMULATED = {"source": "world", "heeds": "simulated"}
RECORDED = {"source": "readers", "heeds": "reader"}
"""Where the logs of a simulated and of a recorded study come from.

`source` says what provides the logs: a simulated world, or a reader of recorded ones. `heeds` is
the key of the data set's yaml that they depend on: `reader` if they are recorded, else only
`simulated`.
"""
KEYS: Mapping[str, Any] = {
    "question": Literal["year", "robustness", "viewpoints", "lifelong"],
    "world": str,
    "source": Literal["world", "readers"],
    "heeds": Literal["simulated", "reader"],
    "root": str,
    "slam": bool,
    "train": str,
    "tests": Sequence[str],
    "budget": str,
    "learned": Sequence[str],
    "updates": Sequence[str],
    "submap": str,
    "grids": Sequence[str],
    "methods": Sequence[Any],
    "altered": Mapping[str, Any],
    "cells": Sequence[str],
    "stress": Mapping[str, Any],
    "poses": Sequence[str],
    "paths": Sequence[str],
    "tolerance": str,
    "latency": bool,
}
"""The keys of a study in conf/studies.yaml with their types, in the order of writing."""
METHOD_KEYS: Mapping[str, Any] = {
    "name": str,
    "view": str,
    "code": str,
    "stage": Literal["views", "birdviews"],
    "seeds": Count,
    "settings": Mapping[str, Any],
    "variants": Mapping[str, Any],
    "courses": Mapping[str, Any],
}
"""The keys of a method in a study, with their types."""


@dataclass(frozen=True)
class CellSize:
    """The cell size of a study's grid: a file of conf/grid, and the wanted side of its cells."""

    name: str
    cell_m: float

    @classmethod
    def read(cls, conf: Path, study: str, name: str) -> Self:
        """Read conf/grid/`name`.yaml of a study; raises ConfigError as `file_of` does."""
        return cls(name, number_of(conf, study, "grid", name, "cell_m"))


@dataclass(frozen=True)
class Tolerance:
    """How near an answer must be: a file of conf/tolerance, and its distance in metres."""

    name: str
    correct_m: float

    @classmethod
    def read(cls, conf: Path, study: str, name: str) -> Self:
        """Read conf/tolerance/`name`.yaml of a study; raises ConfigError as `file_of` does."""
        return cls(name, number_of(conf, study, "tolerance", name, "distance", "correct_m"))


@dataclass(frozen=True)
class StudyMethod:
    """A method as a study compares it."""

    name: str
    """A file of conf/method."""
    view: str
    """What it looks at: a file of conf/view."""
    code: str
    """The file of its module, or its folder if it has several."""
    stage: str = VIEWS
    """The stage that draws its view."""
    seeds: int = 1
    """How many models are trained that differ in what training draws at random."""
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

    @classmethod
    def of(cls, conf: Path, study: str, entry: Any) -> Self:
        """Read an entry of a study's methods: a name, or a table that may leave out view and code.

        Raises ConfigError for a key or a value that a method cannot have.
        """
        table: Mapping[str, Any] = {"name": entry} if isinstance(entry, str) else entry
        check_value(study, "methods", table, Mapping[str, Any])
        check_method(study, table)
        if not {"view", "code"} <= table.keys():
            described = cls.described(conf, table["name"], table.get("view", ""))
            table = {"view": described.view, "code": described.code, **table}
        stage = table.get("stage", stage_of(conf, table["view"]))
        courses = {
            order: tuple(strategies) for order, strategies in table.get("courses", {}).items()
        }
        return cls(**{**table, "stage": stage, "courses": courses})

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

    def table(self) -> dict[str, Any]:
        """The method as conf/studies.yaml has it, without what has its default."""
        table: dict[str, Any] = {"name": self.name, "view": self.view, "code": self.code}
        if self.stage != VIEWS:
            table["stage"] = self.stage
        if self.seeds > 1:
            table["seeds"] = self.seeds
        if self.settings:
            table["settings"] = dict(self.settings)
        if self.variants:
            table["variants"] = dict(self.variants)
        if self.courses:
            table["courses"] = {
                order: list(strategies) for order, strategies in self.courses.items()
            }
        return table


@dataclass(frozen=True)
class Study:
    """One data set's training sequences, its test sequences, and what is compared on them."""

    name: str
    """The name of the data set, a file of conf/dataset; the study is called the same."""
    question: str
    """One of QUESTIONS."""
    simulated: bool
    """Whether the logs were driven in a simulated world, not recorded."""
    world: str
    """The simulated world, or `recorded`: a file of conf/world."""
    root: str
    """The folder of the logs."""
    train: tuple[str, ...]
    """The training sequences; a study of viewpoints may have several."""
    tests: tuple[str, ...]
    """The test sequences."""
    budget: str
    """How long methods train: a file of conf/budget."""
    submap: str
    """How a drive is cut into submaps: a file of conf/submap."""
    grids: tuple[CellSize, ...]
    """The cell sizes at which everything is measured."""
    methods: tuple[StudyMethod, ...]
    """The methods that are compared."""
    tolerance: Tolerance
    """How near an answer must be to be right."""
    learned: tuple[str, ...] = ()
    """Sequences with surveyed poses that models learn after training."""
    updates: tuple[str, ...] = ()
    """Sequences that a site learns by its own poses."""
    altered: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """For each alteration (a file of conf/alteration) the test sequences that it alters."""
    cells: tuple[CellSize, ...] = ()
    """Further cell sizes, at which only the methods' own models are asked."""
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
    key_order: tuple[str, ...] = field(default=(), compare=False)
    """The keys that conf/studies.yaml has, in its order, so that they are written so again."""

    @classmethod
    def of(cls, conf: Path, name: str, table: Mapping[str, Any]) -> Self:
        """Read the study `name` of conf/studies.yaml.

        Whoever writes it by hand may leave out the question, and each method's view, code and
        stage. Raises ConfigError for a key that is missing or unknown, for a value of a wrong type,
        and for a grid, tolerance or method that conf/ has no file of.
        """
        check_keys(name, table)
        altered = table.get("altered", {})
        return cls(
            name=name,
            question=table.get("question", YEAR),
            simulated=table["source"] == SIMULATED["source"],
            world=table["world"],
            root=table["root"],
            train=tuple(table["train"].split()),
            tests=tuple(table["tests"]),
            budget=table["budget"],
            submap=table["submap"],
            grids=tuple(CellSize.read(conf, name, grid) for grid in table["grids"]),
            methods=tuple(StudyMethod.of(conf, name, entry) for entry in table["methods"]),
            tolerance=Tolerance.read(conf, name, table.get("tolerance", TOLERANCE)),
            learned=tuple(table.get("learned", ())),
            updates=tuple(table.get("updates", ())),
            altered={alteration: tuple(sequences) for alteration, sequences in altered.items()},
            cells=tuple(CellSize.read(conf, name, grid) for grid in table.get("cells", ())),
            stress=dict(table.get("stress", {})),
            poses=tuple(table.get("poses", ())),
            paths=tuple(table.get("paths", ())),
            latency=table.get("latency", True),
            slam=table.get("slam", False),
            key_order=tuple(table),
        )

    def table(self) -> dict[str, Any]:
        """The study as conf/studies.yaml has it, with its question."""
        altered = {name: list(sequences) for name, sequences in self.altered.items()}
        values = {
            "question": self.question,
            "world": self.world,
            **self.origin,
            "root": self.root,
            "slam": self.slam,
            "train": self.train_text,
            "tests": list(self.tests),
            "budget": self.budget,
            "learned": list(self.learned),
            "updates": list(self.updates),
            "submap": self.submap,
            "grids": [grid.name for grid in self.grids],
            "methods": [method.table() for method in self.methods],
            "altered": altered,
            "cells": [grid.name for grid in self.cells],
            "stress": dict(self.stress),
            "poses": list(self.poses),
            "paths": list(self.paths),
            "tolerance": self.tolerance.name,
            "latency": self.latency,
        }
        defaults = {"tolerance": TOLERANCE, "latency": True}
        table: dict[str, Any] = {}
        # a dict of keys, as a set that keeps their order
        for key in dict.fromkeys(("question", *self.key_order, *values)):
            value = values[key]
            is_default = value == defaults[key] if key in defaults else not value
            if key in self.key_order or not is_default:
                table[key] = value
        return table

    @property
    def origin(self) -> Mapping[str, str]:
        """Where its logs come from: the keys `source` and `heeds`."""
        return SIMULATED if self.simulated else RECORDED

    @property
    def train_text(self) -> str:
        """The training sequences as a stage's command line has them, with blanks between."""
        return " ".join(self.train)

    @property
    def asks_about_the_year(self) -> bool:
        """Whether its question is `year` or `robustness`: the tests revisit training's places."""
        return self.question in (YEAR, ROBUSTNESS)

    @property
    def learns_further_days(self) -> bool:
        """Whether its question is `lifelong`: models learn days after training."""
        return self.question == LIFELONG

    @property
    def sequences(self) -> tuple[str, ...]:
        """All sequences: those of training, tests and stress, and further days."""
        return (*self.train, *self.tests, *self.stress, *self.learned, *self.updates)

    @property
    def asked_days(self) -> tuple[str, ...]:
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

    def model_named(self, name: str) -> ModelName:
        """The model whose artifacts have this name."""
        return next(model for model in self.models if model.name == name)

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


def check_keys(study: str, table: Mapping[str, Any]) -> None:
    """Raise ConfigError for a key of a study that is missing or unknown, or has a wrong value."""
    for key in NEEDED:
        if key not in table:
            raise ConfigError(
                f"conf/studies.yaml: {study} has no {key}; `yearloc use {study}` writes the study "
                "anew"
            )
    for key in table:
        if key not in KEYS:
            raise ConfigError(
                f"conf/studies.yaml: {study} has a key {key}; expected some of {', '.join(KEYS)}"
            )
    for key, value in table.items():
        check_value(study, key, value, KEYS[key])
    for alteration, sequences in table.get("altered", {}).items():
        check_value(study, f"altered.{alteration}", sequences, Sequence[str])
    for key in NEEDED:
        if not table[key]:
            raise ConfigError(
                f"conf/studies.yaml: {study}: {key} is empty; `yearloc use {study}` writes the "
                "study anew"
            )
    origin = SIMULATED if table["source"] == SIMULATED["source"] else RECORDED
    if table["heeds"] != origin["heeds"]:
        raise ConfigError(
            f"conf/studies.yaml: {study}: heeds={table['heeds']}: expected {origin['heeds']} "
            f"beside source={table['source']}"
        )


def check_method(study: str, table: Mapping[str, Any]) -> None:
    """Raise ConfigError for a key of a study's method that is unknown, or has a wrong value."""
    for key in table:
        if key not in METHOD_KEYS:
            raise ConfigError(
                f"conf/studies.yaml: {study}: a method has a key {key}; expected some of "
                f"{', '.join(METHOD_KEYS)}"
            )
    check_value(study, "methods.name", table.get("name"), str)
    for key, value in table.items():
        check_value(study, f"methods.{table['name']}.{key}", value, METHOD_KEYS[key])


def check_value(study: str, key: str, value: Any, hint: Any) -> None:
    """Raise ConfigError unless a value of a study has the type that its key expects."""
    try:
        within(key, value, hint)
    except ConfigError as error:
        raise ConfigError(
            f"conf/studies.yaml: {study}: {error}; mend it, or `yearloc use {study}` writes the "
            "study anew"
        ) from None


def named_file(conf: Path, study: str, group: str, name: str) -> Path:
    """The path of a file of conf/ that a study names; raises ConfigError as `file_of` does."""
    return file_of(
        conf, group, name, f"conf/studies.yaml: {study} names the {group} {name}; expected one of"
    )


def number_of(conf: Path, study: str, group: str, name: str, *keys: str) -> float:
    """Read a number in a file of conf/ that a study names; `keys` lead to it, table by table.

    Raises ConfigError as `file_of` does.
    """
    value: Any = read_yaml(named_file(conf, study, group, name))
    for key in keys:
        value = value[key]
    return float(value)


def file_of(conf: Path, group: str, name: str, refusal: str) -> Path:
    """The path of the file conf/`group`/`name`.yaml.

    If it is missing, raises ConfigError with `refusal` and the names of the files that exist.
    """
    path = conf / group / f"{name}.yaml"
    if not path.is_file():
        choices = sorted(file.stem for file in path.parent.glob("*.yaml"))
        raise ConfigError(f"{refusal} {', '.join(choices)}")
    return path


def settings_of(conf: Path, method: str) -> dict[str, Any]:
    """Read the yaml of a method; raises ConfigError if there is no such method."""
    return read_yaml(file_of(conf, "method", method, f"methods={method}: expected some of"))


def stage_of(conf: Path, view: str) -> str:
    """The stage that draws a view: `birdviews` if it is of an octree, which has a memory."""
    path = conf / "view" / f"{view}.yaml"
    return BIRD_VIEWS if path.is_file() and "octree" in read_yaml(path) else VIEWS
