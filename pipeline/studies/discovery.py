"""Which sequences of a data set a study can use.

From a simulated world's table, or from what lies on disk.
"""

import re
from collections.abc import Mapping
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
SAFE_NAME = re.compile(r"\w[\w.+-]*")  # of a sequence: it becomes part of stage names and paths


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
    lacking = _reader(name, reader).sequences(root)
    if not lacking:
        raise ConfigError(f"root={root}: no {name} sequence there; expected {defaults['expected']}")
    odd = [sequence for sequence in lacking if not SAFE_NAME.fullmatch(sequence)]
    lacking |= {sequence: ["a name of letters, digits and ._+-: rename it"] for sequence in odd}
    readable = [sequence for sequence, missing_parts in lacking.items() if not missing_parts]
    notes = [
        f"{sequence}: lacks {', '.join(missing_parts)}"
        for sequence, missing_parts in lacking.items()
        if missing_parts
    ]
    train = defaults["train"]
    tests = list(defaults["tests"])
    named = [
        name
        for option in ("train", "tests")
        for name in options.get(option, "").replace(",", " ").split()
    ]
    named_parts = [
        name
        for name in dict.fromkeys(named)
        if (part := Part.named(name))[1] and part[0] in readable
    ]
    rule = options.get("parts", defaults.get("parts"))
    if "log" in options and not rule:
        raise ConfigError(
            f"log={options['log']}: {name} splits no log; give parts= too, or train= and tests= "
            "instead"
        )
    if options.get("parts") and {"train", "tests"} <= options.keys():
        raise ConfigError(
            f"parts={rule}: train= and tests= name the parts already; leave one of the two out"
        )
    if rule and readable:
        log = options.get(
            "log",
            train.partition("-")[0]
            if train and train.partition("-")[0] in readable
            else (readable or [""])[0],
        )
        parts = [f"{log}-a", f"{log}-b"] if rule == "halves" else names(log, rule)
        train = parts[0]
        tests = parts[1:]
        readable = parts if log in readable else []
        notes += [
            f"logs found: {', '.join(lacking)}; each has its own frame, this study is on {log} "
            "(log=NN chooses another, parts=time:2 splits it otherwise)"
        ]
    readable = list(dict.fromkeys([*readable, *named_parts]))
    trained = options.get("train", train or (readable or [""])[0]).replace(",", " ").split()
    if len(trained) > 1:
        notes += [
            f"{sequence}: not below {root}, not trained on"
            for sequence in trained
            if sequence not in readable
        ]
        trained = [sequence for sequence in trained if sequence in readable]
    train = " ".join(trained)
    logs = [Part.named(sequence)[0] for sequence in trained]
    if overlapping := [name for name in named if name in logs and name not in trained]:
        raise ConfigError(
            f"tests={overlapping[0]}: holds what the training sequence {train} is a part of; "
            "give another part"
        )
    tests = (
        options["tests"].split(",")
        if "tests" in options
        else tests or [name for name in readable if name not in (*trained, *logs)]
    )
    all_notes = "".join(f"; {note}" for note in notes)
    if not trained or not set(trained) <= set(readable):
        advice = (
            f"give train=, one of {', '.join(readable)}" if readable else "no sequence there can"
        )
        raise ConfigError(
            f"the training sequence {train} cannot be read below {root}: {advice}{all_notes}"
        )
    if tests == [train]:
        raise ConfigError(f"tests={train}: is the training sequence; give others")
    absent = [sequence for sequence in tests if sequence not in readable]
    notes += [
        f"{sequence}: not below {root}, left out" for sequence in absent if sequence not in lacking
    ]
    tests = [test for test in tests if test in readable and test not in trained]
    if not tests:
        other_sequences = ", ".join(sequence for sequence in readable if sequence not in trained)
        need = (
            "one more is needed, or parts=path:2 splits it"
            if len(readable) == 1
            else "one more is needed"
        )
        advice = f"give tests=, some of {other_sequences}" if other_sequences else need
        raise ConfigError(f"no test sequence can be read below {root}: {advice}{all_notes}")
    return Drives("recorded", str(root), train, tests, "full", notes)


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
