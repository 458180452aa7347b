"""A study: what is learned on which days, what is asked on which others, and of which methods.

Its question is how a localiser lasts over a `year`; methods on bird-views are judged with turned
robots besides (DOM and PFL, IROS 2018). A study of `robustness` judges also altered queries,
sequences of `stress`, other cells and variants of the methods. A study of `viewpoints` judges
turned robots alone, on sequences that share no place with training; then several may train. A study
of `lifelong` judges what a model answers after it learned further days (studies.courses).

`Study.of` reads a study of conf/studies.yaml and checks it, `Study.table` gives what is written
there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Any, Literal, Self

from pipeline.core.errors import ConfigError
from pipeline.core.settings import Count, within
from pipeline.running.texts import read_yaml
from pipeline.studies.models import ModelName

LIFELONG = "lifelong"
QUESTIONS = ("year", "robustness", "viewpoints", LIFELONG)
VIEWS = "views"
BIRD_VIEWS = "birdviews"
VIEW_WORD = "method.view="
"""The stages that draw views: of a submap alone, and of all scans before."""
TOLERANCE = "15m"
"""How near an answer must be, where a study says nothing: a file of conf/tolerance."""
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
SIMULATED = {"source": "world", "heeds": "simulated"}
RECORDED = {"source": "readers", "heeds": "reader"}
"""Where the logs of a simulated and of a recorded study come from.

`source` is a package of pipeline: who makes the logs. `heeds` is what the logs depend on in the
data set's yaml: the reader, or of a simulated one no more than that it is simulated.
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
"""What a study in conf/studies.yaml may say, in the order in which it is written."""
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


@dataclass(frozen=True)
class CellSize:
    """A grid of a study: a file of conf/grid, and the wanted side of its cells in metres."""

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
    """Its module, or its folder where networks live beside it."""
    stage: str = VIEWS
    """The stage that draws its view."""
    seeds: int = 1
    """Models that differ in what training draws at random."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of its yaml that have another value in this study."""
    variants: Mapping[str, str] = field(default_factory=dict)
    """Name to the words of the command line that make it."""
    courses: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Order of the further days to strategies: files of conf/strategy."""

    @classmethod
    def described(cls, conf: Path, name: str, view: str = "") -> Self:
        """A method by its yaml, looking at `view` instead of the yaml's own.

        Raises ConfigError where there is no such method.
        """
        settings = settings_of(conf, name)
        module = settings["_target_"].split(".")[:-1]
        code = "/".join(module[:3]) + (".py" if len(module) == 3 else "")
        looked_at = view or str(settings["view"])
        return cls(name, looked_at, code, stage_of(conf, looked_at))

    @classmethod
    def of(cls, conf: Path, study: str, entry: Any) -> Self:
        """Read an entry of a study's methods: a name, or a table that may leave out view and code.

        Raises ConfigError for a key or a value that is none of a method.
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
        """What a variant looks at: the file of conf/view that its words name as `method.view`, else
        the method's own."""
        named = [
            word.removeprefix(VIEW_WORD)
            for word in self.variants.get(variant, "").split()
            if word.startswith(VIEW_WORD)
        ]
        return named[-1] if named else self.view

    @property
    def views(self) -> tuple[str, ...]:
        """All that it and its variants look at."""
        return tuple(dict.fromkeys(map(self.view_of, ("", *self.variants))))

    @property
    def models(self) -> list[ModelName]:
        """Its models: its own, then its variants, each with every seed."""
        return [
            ModelName(self.name, variant, seed)
            for variant in ("", *self.variants)
            for seed in range(self.seeds)
        ]

    @property
    def families(self) -> dict[str, list[ModelName]]:
        """Its models by family, its own and that of each variant: one model of each seed."""
        families: dict[str, list[ModelName]] = {}
        for model in self.models:
            families.setdefault(model.family, []).append(model)
        return families

    @property
    def is_on_bird_views(self) -> bool:
        """Whether it looks at bird-views, which are drawn at all headings."""
        return self.stage == BIRD_VIEWS

    def table(self) -> dict[str, Any]:
        """The method as conf/studies.yaml has it: what differs from a method's defaults."""
        courses = {order: list(strategies) for order, strategies in self.courses.items()}
        optional = {
            "stage": self.stage if self.stage != VIEWS else "",
            "seeds": self.seeds if self.seeds > 1 else 0,
            "settings": dict(self.settings),
            "variants": dict(self.variants),
            "courses": courses,
        }
        return {
            "name": self.name,
            "view": self.view,
            "code": self.code,
            **{key: value for key, value in optional.items() if value},
        }


@dataclass(frozen=True)
class Study:
    """One data set's training sequences, its test sequences, and what is compared on them."""

    name: str
    """Of the data set, a file of conf/dataset; and so of the study."""
    question: str
    """One of QUESTIONS."""
    simulated: bool
    """Whether the logs are driven in a simulated world, not recorded."""
    world: str
    """A file of conf/world: which simulated world, or `recorded`."""
    root: str
    """The folder of the logs."""
    train: tuple[str, ...]
    """Training sequences; several for a study of viewpoints."""
    tests: tuple[str, ...]
    """Test sequences."""
    budget: str
    """How long methods train: a file of conf/budget."""
    submap: str
    """A file of conf/submap."""
    grids: tuple[CellSize, ...]
    """Its own cell sizes."""
    methods: tuple[StudyMethod, ...]
    """What is compared."""
    tolerance: Tolerance
    """How near an answer must be."""
    learned: tuple[str, ...] = ()
    """Surveyed sequences that are learned after training."""
    updates: tuple[str, ...] = ()
    """Sequences that a site learns by itself."""
    altered: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """A file of conf/alteration to the test sequences whose queries are altered."""
    cells: tuple[CellSize, ...] = ()
    """Further cell sizes, which the methods' own models are asked about."""
    stress: Mapping[str, str] = field(default_factory=dict)
    """A sequence that is hard in one way to a description of it."""
    poses: tuple[str, ...] = ()
    """Families of models whose answers are registered with the map: `sci`, `sci-4way`."""
    paths: tuple[str, ...] = ()
    """Files of conf/path: how the poses of a drive are joined."""
    latency: bool = True
    """Whether the cost of a query is measured."""
    slam: bool = False
    """Whether poses are estimated from the scans, not read from the logs."""
    key_order: tuple[str, ...] = field(default=(), compare=False)
    """The keys that conf/studies.yaml says, in its order; written in that order again."""

    @classmethod
    def of(cls, conf: Path, name: str, table: Mapping[str, Any]) -> Self:
        """Read the study `name` of conf/studies.yaml.

        A hand may leave out the question, and each method's view, code and stage. Raises
        ConfigError for a key that is missing or unknown, for a value that cannot be meant, and for
        a grid, tolerance or method that conf/ has no file of.
        """
        check_keys(name, table)
        altered = table.get("altered", {})
        return cls(
            name=name,
            question=table.get("question", QUESTIONS[0]),
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
        keys = dict.fromkeys(("question", *self.key_order, *values))
        return {
            key: values[key]
            for key in keys
            if key in self.key_order
            or (values[key] != defaults[key] if key in defaults else values[key])
        }

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
        """Whether the tests show the training sequence's places."""
        return self.question in QUESTIONS[:2]

    @property
    def learns_further_days(self) -> bool:
        """Whether models learn days after training."""
        return self.question == LIFELONG

    @property
    def sequences(self) -> tuple[str, ...]:
        """All sequences: of training, tests, stress, and further days."""
        return (*self.train, *self.tests, *self.stress, *self.learned, *self.updates)

    @property
    def asked_days(self) -> tuple[str, ...]:
        """The sequences whose queries are judged: tests and stress."""
        return (*self.tests, *self.stress)

    @property
    def grid_names(self) -> list[str]:
        """The names of its own cell sizes."""
        return [grid.name for grid in self.grids]

    @property
    def all_grids(self) -> tuple[CellSize, ...]:
        """Its own cell sizes, and those of its study of cell sizes."""
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
        """A model's own answers, those with poses if the study has them, and along each path."""
        if model.family not in self.poses:
            return [model]
        posed = replace(model, posed=True)
        return [model, posed, *(replace(posed, path=path) for path in self.paths)]

    @property
    def answerers(self) -> list[ModelName]:
        """All answers at the study's own cell sizes: of each model, with poses and paths too."""
        return [answers for model in self.models for answers in self.answers_of(model)]


def check_keys(study: str, table: Mapping[str, Any]) -> None:
    """Raise ConfigError for a key of a study that is missing or unknown, or has a wrong value."""
    if lacks := [key for key in NEEDED if key not in table]:
        raise ConfigError(
            f"conf/studies.yaml: {study} has no {lacks[0]}; `yearloc use {study}` writes the study "
            "anew"
        )
    if unknown := [key for key in table if key not in KEYS]:
        raise ConfigError(
            f"conf/studies.yaml: {study} has a key {unknown[0]}; expected some of {', '.join(KEYS)}"
        )
    for key, value in table.items():
        check_value(study, key, value, KEYS[key])
    for alteration, sequences in table.get("altered", {}).items():
        check_value(study, f"altered.{alteration}", sequences, Sequence[str])
    if empty := [key for key in NEEDED if not table[key]]:
        raise ConfigError(
            f"conf/studies.yaml: {study}: {empty[0]} is empty; `yearloc use {study}` writes the "
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
    if unknown := [key for key in table if key not in METHOD_KEYS]:
        raise ConfigError(
            f"conf/studies.yaml: {study}: a method has a key {unknown[0]}; expected some of "
            f"{', '.join(METHOD_KEYS)}"
        )
    check_value(study, "methods.name", table.get("name"), str)
    for key, value in table.items():
        check_value(study, f"methods.{table['name']}.{key}", value, METHOD_KEYS[key])


def check_value(study: str, key: str, value: Any, hint: Any) -> None:
    """Raise ConfigError unless a value of a study is of the type that its key expects."""
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
    """The number at a path of keys in a file of conf/ that a study names.

    Raises ConfigError as `file_of` does.
    """
    content: Any = read_yaml(named_file(conf, study, group, name))
    return float(reduce(getitem, keys, content))


def file_of(conf: Path, group: str, name: str, refusal: str) -> Path:
    """The path of a file of conf/.

    Where it is missing, raises ConfigError with `refusal` and the names that there are.
    """
    path = conf / group / f"{name}.yaml"
    if not path.is_file():
        raise ConfigError(
            f"{refusal} {', '.join(sorted(file.stem for file in path.parent.glob('*.yaml')))}"
        )
    return path


def settings_of(conf: Path, method: str) -> dict[str, Any]:
    """The yaml of a method; raises ConfigError where there is no such method."""
    return read_yaml(file_of(conf, "method", method, f"methods={method}: expected some of"))


def stage_of(conf: Path, view: str) -> str:
    """The stage that draws a view: an octree has memory, and so eats scans in their order."""
    path = conf / "view" / f"{view}.yaml"
    return BIRD_VIEWS if path.is_file() and "octree" in read_yaml(path) else VIEWS
