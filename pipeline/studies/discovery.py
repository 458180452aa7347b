"""Which sequences of a data set a study can be driven on: of a simulated world's table, or of what
lies on disk."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from pydoc import locate
from typing import Any

from pipeline.errors import ConfigError
from pipeline.readers.log import Reader
from pipeline.readers.parts import Part, names
from pipeline.running.texts import read_yaml

SAFE_PATH = re.compile(r"[\w./~+@ -]+")
SAFE_NAME = re.compile(r"\w[\w.+-]*")  # of a sequence: it becomes part of stage names and paths


BUDGETS = {"tiny": "tiny", "year": "full"}
"""Of the presets of simulated worlds; others train as the demo does."""


@dataclass(frozen=True)
class Proposal:
    """A study for conf/studies.yaml, and what a person should know about it."""

    study: dict[str, Any]
    notes: list[str]


def simulated(
    conf: Path, name: str, study: Mapping[str, Any], options: Mapping[str, str]
) -> Proposal:
    """What the world's table drives; raises ConfigError for a preset or a test sequence that it
    lacks."""
    usual: Mapping[str, list[str]] = study["tests"]
    world = options.get("world", "demo")
    if world not in usual:
        raise ConfigError(f"world={world}: expected one of {', '.join(usual)}")
    driven = read_yaml(conf / "world" / f"{name}_{world}.yaml")["sequences"]
    tests = options["tests"].split(",") if "tests" in options else list(usual[world])
    if study.get("parts"):
        driven = [f"{log}-b" for log in driven]
    if unknown := [test for test in tests if test not in driven]:
        raise ConfigError(
            f"tests={unknown[0]}: conf/world/{name}_{world}.yaml drives {', '.join(driven)}"
        )
    drive = {
        "world": f"{name}_{world}",
        "source": "world",
        "heeds": "simulated",
        "root": f"artifacts/logs/{name}",
    }
    train = study["train"] if isinstance(study["train"], str) else study["train"][world]
    return Proposal(
        {**drive, "train": train, "tests": tests, "budget": BUDGETS.get(world, "demo")}, []
    )


def recorded(
    name: str, reader: Mapping[str, Any], study: Mapping[str, Any], options: Mapping[str, str]
) -> Proposal:
    """What can be read below the root, matched with the study of the data set's yaml or the one
    asked for.

    Raises ConfigError where that leaves no training or no test sequence.
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
        raise ConfigError(f"root={root}: no {name} sequence there; expected {study['expected']}")
    odd = [sequence for sequence in lacking if not SAFE_NAME.fullmatch(sequence)]
    lacking |= {sequence: ["a name of letters, digits and ._+-: rename it"] for sequence in odd}
    whole = [sequence for sequence, missing in lacking.items() if not missing]
    notes = [
        f"{sequence}: lacks {', '.join(missing)}"
        for sequence, missing in lacking.items()
        if missing
    ]
    train = study["train"]
    tests = list(study["tests"])
    asked = [
        name
        for option in ("train", "tests")
        for name in options.get(option, "").replace(",", " ").split()
    ]
    own = [
        name for name in dict.fromkeys(asked) if (part := Part.named(name))[1] and part[0] in whole
    ]
    rule = options.get("parts", study.get("parts"))
    if "log" in options and not rule:
        raise ConfigError(
            f"log={options['log']}: {name} splits no log; give parts= too, or train= and tests= "
            "instead"
        )
    if options.get("parts") and {"train", "tests"} <= options.keys():
        raise ConfigError(
            f"parts={rule}: train= and tests= name the parts already; leave one of the two out"
        )
    if rule and whole:
        log = options.get(
            "log",
            train.partition("-")[0]
            if train and train.partition("-")[0] in whole
            else (whole or [""])[0],
        )
        parts = [f"{log}-a", f"{log}-b"] if rule == "halves" else names(log, rule)
        train = parts[0]
        tests = parts[1:]
        whole = parts if log in whole else []
        notes += [
            f"logs found: {', '.join(lacking)}; each has its own frame, this study is on {log} "
            "(log=NN chooses another, parts=time:2 splits it otherwise)"
        ]
    whole = list(dict.fromkeys([*whole, *own]))
    trained = options.get("train", train or (whole or [""])[0]).replace(",", " ").split()
    if len(trained) > 1:
        notes += [
            f"{sequence}: not below {root}, not trained on"
            for sequence in trained
            if sequence not in whole
        ]
        trained = [sequence for sequence in trained if sequence in whole]
    train = " ".join(trained)
    logs = [Part.named(sequence)[0] for sequence in trained]
    if held := [name for name in asked if name in logs and name not in trained]:
        raise ConfigError(
            f"tests={held[0]}: holds what the training sequence {train} is a part of; give another "
            "part"
        )
    tests = (
        options["tests"].split(",")
        if "tests" in options
        else tests or [name for name in whole if name not in (*trained, *logs)]
    )
    why = "".join(f"; {note}" for note in notes)
    if not trained or not set(trained) <= set(whole):
        known = f"give train=, one of {', '.join(whole)}" if whole else "no sequence there can"
        raise ConfigError(
            f"the training sequence {train} cannot be read below {root}: {known}{why}"
        )
    if tests == [train]:
        raise ConfigError(f"tests={train}: is the training sequence; give others")
    absent = [sequence for sequence in tests if sequence not in whole]
    notes += [
        f"{sequence}: not below {root}, left out" for sequence in absent if sequence not in lacking
    ]
    tests = [test for test in tests if test in whole and test not in trained]
    if not tests:
        others = ", ".join(sequence for sequence in whole if sequence not in trained)
        needed = (
            "one more is needed, or parts=path:2 splits it"
            if len(whole) == 1
            else "one more is needed"
        )
        known = f"give tests=, some of {others}" if others else needed
        raise ConfigError(f"no test sequence can be read below {root}: {known}{why}")
    drive = {"world": "recorded", "source": "readers", "heeds": "reader", "root": str(root)}
    return Proposal({**drive, "train": train, "tests": tests, "budget": "full"}, notes)


def _reader(name: str, settings: Mapping[str, Any]) -> Reader:
    kind: Any = locate(settings.get("_target_", ""))
    if kind is None:
        raise ConfigError(
            f"conf/dataset/{name}.yaml: reader._target_={settings.get('_target_')}: no such reader"
        )
    known = [field.name for field in fields(kind)]
    if unknown := [key for key in settings if key not in (*known, "_target_")]:
        raise ConfigError(
            f"conf/dataset/{name}.yaml: reader has no key {unknown[0]}: expected {', '.join(known)}"
        )
    reader: Reader = kind(**{key: value for key, value in settings.items() if key != "_target_"})
    return reader
