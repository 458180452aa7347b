"""Finds the sequences of a data set: options of `yearloc use` in; which train and test out.

Of a simulated data set they are those that its world's table drives, of a recorded one those that
lie on disk and can be read. `proposal` makes a study of them.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from pydoc import locate
from typing import Any

from pipeline.core.errors import ConfigError
from pipeline.readers.log import Reader
from pipeline.readers.parts import Part, names
from pipeline.running.texts import read_yaml
from pipeline.studies.layout import Layout

SAFE_PATH = re.compile(r"[\w./~+@ -]+")
"""A root that no shell or yaml misreads."""
SAFE_NAME = re.compile(r"\w[\w.+-]*")
"""Of a sequence, whose name becomes part of stages' names and of paths."""
BUDGETS = {"tiny": "tiny", "year": "full"}
"""Of the presets of simulated worlds; others train as the demo does."""


@dataclass(frozen=True)
class Drives:
    """The sequences that a study trains and tests on, and where their logs are."""

    world: str
    """A file of conf/world."""
    root: str
    """The folder of the logs."""
    train: str
    """Training sequences, with blanks between."""
    tests: list[str]
    budget: str
    """What is usual for them: a file of conf/budget."""
    notes: list[str]
    """What a person should know about them."""


def simulated(
    conf: Path, name: str, defaults: Mapping[str, Any], options: Mapping[str, str]
) -> Drives:
    """The sequences of the world's table that a study is proposed of.

    Raises ConfigError for a preset or a test sequence that it lacks.
    """
    tests_of_world: Mapping[str, list[str]] = defaults["tests"]
    world = options.get("world", "demo")
    if world not in tests_of_world:
        raise ConfigError(f"world={world}: expected one of {', '.join(tests_of_world)}")
    sequences = read_yaml(conf / "world" / f"{name}_{world}.yaml")["sequences"]
    tests = options["tests"].split(",") if "tests" in options else list(tests_of_world[world])
    if defaults.get("parts"):
        sequences = [f"{log}-b" for log in sequences]
    if unknown := [test for test in tests if test not in sequences]:
        raise ConfigError(
            f"tests={unknown[0]}: conf/world/{name}_{world}.yaml drives {', '.join(sequences)}"
        )
    train = defaults["train"] if isinstance(defaults["train"], str) else defaults["train"][world]
    root = Layout().path("logs", name).as_posix()
    return Drives(f"{name}_{world}", root, train, tests, BUDGETS.get(world, "demo"), [])


def recorded(
    name: str, reader: Mapping[str, Any], defaults: Mapping[str, Any], options: Mapping[str, str]
) -> Drives:
    """The sequences below the root that can be read, and that a study is proposed of.

    Options win over the study in the data set's yaml, `defaults`. Raises ConfigError where that
    leaves no training or no test sequence.
    """
    root = _root(name, options)
    lacking = _lacking(name, reader, root, defaults["expected"])
    notes = [
        f"{sequence}: lacks {', '.join(missing_parts)}"
        for sequence, missing_parts in lacking.items()
        if missing_parts
    ]
    readable = [sequence for sequence, missing_parts in lacking.items() if not missing_parts]
    train = defaults["train"]
    tests = list(defaults["tests"])
    named_parts = _named_parts(options, readable)
    rule = _rule(name, defaults, options)
    if rule and readable:
        log = options.get("log", _default_log(train, readable))
        train, *tests = [f"{log}-a", f"{log}-b"] if rule == "halves" else names(log, rule)
        readable = [train, *tests] if log in readable else []
        notes.append(
            f"logs found: {', '.join(lacking)}; each has its own frame, this study is on {log} "
            "(log=NN chooses another, parts=time:2 splits it otherwise)"
        )
    readable = list(dict.fromkeys([*readable, *named_parts]))
    trained = _trained(root, options, train, readable, notes)
    tests = _tested(root, options, tests, trained, readable, lacking, notes)
    return Drives("recorded", str(root), " ".join(trained), tests, "full", notes)


def _root(name: str, options: Mapping[str, str]) -> Path:
    """The folder of the logs; raises ConfigError where it is not given or cannot be."""
    if "root" not in options:
        raise ConfigError(f"where is {name}? Say root=FOLDER")
    root = Path(options["root"]).expanduser()
    if not root.is_dir():
        raise ConfigError(f"root={options['root']}: no such folder")
    root = root.resolve()
    if not SAFE_PATH.fullmatch(str(root)):
        raise ConfigError(
            f"root={root}: a path of letters, digits, blanks and ./_-+@~ is needed; a link with "
            "such a name will do"
        )
    return root


def _lacking(
    name: str, reader: Mapping[str, Any], root: Path, expected: str
) -> dict[str, list[str]]:
    """The sequences below the root, each with what it lacks to be read; nothing where it can be.

    Raises ConfigError where there is no sequence.
    """
    lacking = _reader(name, reader).sequences(root)
    if not lacking:
        raise ConfigError(f"root={root}: no {name} sequence there; expected {expected}")
    odd = [sequence for sequence in lacking if not SAFE_NAME.fullmatch(sequence)]
    lacking |= {sequence: ["a name of letters, digits and ._+-: rename it"] for sequence in odd}
    return lacking


def _named(options: Mapping[str, str]) -> list[str]:
    """All names after train= and tests=."""
    return [
        name
        for option in ("train", "tests")
        for name in options.get(option, "").replace(",", " ").split()
    ]


def _named_parts(options: Mapping[str, str], readable: Sequence[str]) -> list[str]:
    """The names after train= and tests= that are parts of readable logs."""
    log_of = {name: Part.named(name) for name in _named(options)}
    return [name for name, (log, part) in log_of.items() if part and log in readable]


def _rule(name: str, defaults: Mapping[str, Any], options: Mapping[str, str]) -> str | None:
    """How a log is split into parts, of which a study trains on one; None where it is not.

    Raises ConfigError for options that contradict it.
    """
    rule: str | None = options.get("parts", defaults.get("parts"))
    if "log" in options and not rule:
        raise ConfigError(
            f"log={options['log']}: {name} splits no log; give parts= too, or train= and tests= "
            "instead"
        )
    if options.get("parts") and {"train", "tests"} <= options.keys():
        raise ConfigError(
            f"parts={rule}: train= and tests= name the parts already; leave one of the two out"
        )
    return rule


def _default_log(train: str | None, readable: Sequence[str]) -> str:
    """The log to split: that of the data set's usual training part, else the first readable one."""
    log = (train or "").partition("-")[0]
    return log if log in readable else readable[0]


def _trained(
    root: Path,
    options: Mapping[str, str],
    default: str | None,
    readable: Sequence[str],
    notes: list[str],
) -> list[str]:
    """The training sequences; of several only those that can be read, and a note on the others.

    They are those after train=, or the data set's `default` one, or the first that can be read.
    Raises ConfigError where none can be read, or a test sequence holds what one is a part of.
    """
    first = readable[0] if readable else ""
    trained = options.get("train", default or first).replace(",", " ").split()
    if len(trained) > 1:
        notes += [
            f"{sequence}: not below {root}, not trained on"
            for sequence in trained
            if sequence not in readable
        ]
        trained = [sequence for sequence in trained if sequence in readable]
    train = " ".join(trained)
    logs = [Part.named(sequence)[0] for sequence in trained]
    if overlapping := [name for name in _named(options) if name in logs and name not in trained]:
        raise ConfigError(
            f"tests={overlapping[0]}: holds what the training sequence {train} is a part of; "
            "give another part"
        )
    if not trained or not set(trained) <= set(readable):
        advice = (
            f"give train=, one of {', '.join(readable)}" if readable else "no sequence there can"
        )
        raise ConfigError(
            f"the training sequence {train} cannot be read below {root}: {advice}{_listed(notes)}"
        )
    return trained


def _tested(
    root: Path,
    options: Mapping[str, str],
    default: Sequence[str],
    trained: Sequence[str],
    readable: Sequence[str],
    lacking: Mapping[str, list[str]],
    notes: list[str],
) -> list[str]:
    """The test sequences that can be read, and a note on each other one that is asked for.

    They are those after tests=, or the data set's `default` ones, or all that training leaves.
    Raises ConfigError where none is left.
    """
    trained_logs = [Part.named(sequence)[0] for sequence in trained]
    tests = (
        options["tests"].split(",")
        if "tests" in options
        else default or [name for name in readable if name not in (*trained, *trained_logs)]
    )
    train = " ".join(trained)
    if tests == [train]:
        raise ConfigError(f"tests={train}: is the training sequence; give others")
    listed_notes = _listed(notes)
    notes += [
        f"{sequence}: not below {root}, left out"
        for sequence in tests
        if sequence not in readable and sequence not in lacking
    ]
    readable_tests = [test for test in tests if test in readable and test not in trained]
    if not readable_tests:
        other_sequences = ", ".join(sequence for sequence in readable if sequence not in trained)
        measure = "time" if options.get("poses") == "slam" else "path"  # poses tell a path
        need = (
            f"one more is needed, or parts={measure}:2 splits it, without train="
            if len(readable) == 1
            else "one more is needed"
        )
        advice = f"give tests=, some of {other_sequences}" if other_sequences else need
        raise ConfigError(f"no test sequence can be read below {root}: {advice}{listed_notes}")
    return readable_tests


def _listed(notes: Sequence[str]) -> str:
    """The notes behind an error's line."""
    return "".join(f"; {note}" for note in notes)


def _reader(name: str, settings: Mapping[str, Any]) -> Reader:
    kind: Any = locate(settings.get("_target_", ""))
    if kind is None:
        raise ConfigError(
            f"conf/dataset/{name}.yaml: reader._target_={settings.get('_target_')}: no such reader"
        )
    keys = [field.name for field in fields(kind)]
    if unknown := [key for key in settings if key not in (*keys, "_target_")]:
        raise ConfigError(
            f"conf/dataset/{name}.yaml: reader has no key {unknown[0]}: expected {', '.join(keys)}"
        )
    reader: Reader = kind(**{key: value for key, value in settings.items() if key != "_target_"})
    return reader
