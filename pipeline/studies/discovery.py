"""Finds the sequences of a data set, and says which train and which test.

A sequence is one drive on one date. The table of a simulated world lists its sequences; those of a
recorded data set are found on disk. The options of `yearloc use`, such as train= and tests=, choose
among them. `proposal` makes a study of the result.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

from pipeline.core.building import TARGET, build, target_class
from pipeline.core.errors import ConfigError, NotInstalledError
from pipeline.opening.map_files import MapFiles
from pipeline.readers.log import READERS, Reader
from pipeline.readers.splits import Split, names
from pipeline.running.texts import read_yaml
from pipeline.studies.layout import Layout
from pipeline.studies.study import MAP_SEQUENCE

SAFE_PATH = re.compile(r"[\w./~+@ -]+")
"""Paths that no shell or yaml misreads."""
SAFE_NAME = re.compile(r"\w[\w.+-]*")
"""Names of sequences that may become part of the names of stages and of paths."""
BUDGETS = {"tiny": "tiny", "year": "full"}
"""The training budget in each preset of a simulated world; in any other preset it is `demo`."""


@dataclass(frozen=True)
class Drives:
    """The sequences that a study trains and tests on, and where their logs are."""

    world: str
    """A file of conf/world."""
    root: str
    """The folder of the logs."""
    train: str
    """The training sequences, with blanks between."""
    tests: list[str]
    """The test sequences."""
    budget: str
    """The training budget unless the person names another: a file of conf/budget."""
    notes: list[str]
    """Notes for the person on the sequences, such as which cannot be read."""


def simulated_drives(
    conf: Path, name: str, defaults: Mapping[str, Any], options: Mapping[str, str]
) -> Drives:
    """Choose sequences of a simulated world's table, conf/world/NAME_PRESET.yaml.

    Raises ConfigError for a preset that does not exist, or a test sequence that its table lacks.
    """
    tests_of_world: Mapping[str, list[str]] = defaults["tests"]
    world = options.get("world", "demo")
    if world not in tests_of_world:
        raise ConfigError(f"world={world}: expected one of {', '.join(tests_of_world)}")
    sequences = read_yaml(conf / "world" / f"{name}_{world}.yaml")["sequences"]
    tests = options["tests"].split(",") if "tests" in options else list(tests_of_world[world])
    if defaults.get("split"):  # each log is split: the first part, -a, trains, the second tests
        sequences = [f"{log}-b" for log in sequences]
    if unknown := [test for test in tests if test not in sequences]:
        raise ConfigError(
            f"tests={unknown[0]}: conf/world/{name}_{world}.yaml drives {', '.join(sequences)}"
        )
    train = defaults["train"] if isinstance(defaults["train"], str) else defaults["train"][world]
    root = Layout().path("logs", name).as_posix()
    return Drives(
        world=f"{name}_{world}",
        root=root,
        train=train,
        tests=tests,
        budget=BUDGETS.get(world, "demo"),
        notes=[],
    )


@dataclass
class LogFolder:
    """A folder of recorded logs, and the sequences in it that a study may use."""

    root: Path
    missing: Mapping[str, list[str]]
    """Every sequence, with what is missing to read it: an empty list if it can be read."""
    readable: list[str]
    """The sequences that can be read."""
    notes: list[str]
    """Notes for the person on the sequences."""

    @classmethod
    def searched(cls, root: Path, name: str, reader: Mapping[str, Any], expected: str) -> Self:
        """Look for sequences below `root`, as the reader of data set `name` knows them.

        Raises ConfigError if there is none; `expected` then says what should be there.
        """
        missing = _reader(name, reader).sequences(root)
        if not missing:
            raise ConfigError(f"root={root}: no {name} sequence there; expected {expected}")
        unsafe_names = [sequence for sequence in missing if not SAFE_NAME.fullmatch(sequence)]
        for sequence in unsafe_names:
            missing |= {sequence: ["a name of letters, digits and ._+-: rename it"]}
        readable = []
        notes = []
        for sequence, missing_parts in missing.items():
            if missing_parts:
                notes.append(f"{sequence}: lacks {', '.join(missing_parts)}")
            else:
                readable.append(sequence)
        return cls(root, missing, readable, notes)

    @property
    def notes_text(self) -> str:
        """The notes as the end of an error's line."""
        return "".join(f"; {note}" for note in self.notes)


def recorded_drives(
    name: str, reader: Mapping[str, Any], defaults: Mapping[str, Any], options: Mapping[str, str]
) -> Drives:
    """Choose among the sequences below the folder root= that can be read.

    Options win over `defaults`, the study in the data set's yaml. Raises ConfigError if no training
    or no test sequence is left.
    """
    logs = LogFolder.searched(_root(name, options), name, reader, defaults["expected"])
    if MAP_SEQUENCE in options:
        return _drives_on_map(logs, options)
    default_train = defaults["train"]
    default_tests = list(defaults["tests"])
    named_splits = _named_splits(options, logs.readable)
    rule = _rule(name, defaults, options)
    if rule and logs.readable:
        # the study trains and tests on the splits of one log
        default_log = (default_train or "").partition("-")[0]
        if default_log not in logs.readable:
            default_log = logs.readable[0]
        log = options.get("log", default_log)
        splits = [f"{log}-a", f"{log}-b"] if rule == "halves" else names(log, rule)
        default_train, *default_tests = splits
        logs.readable = list(splits) if log in logs.readable else []
        logs.notes.append(
            f"logs found: {', '.join(logs.missing)}; each has its own frame, this study is on "
            f"{log} (log=NN chooses another, split=time:2 splits it otherwise)"
        )
    logs.readable = list(dict.fromkeys([*logs.readable, *named_splits]))
    train = _training_sequences(logs, options, default_train)
    tests = _test_sequences(logs, options, default_tests, train)
    return Drives(
        world="recorded",
        root=str(logs.root),
        train=" ".join(train),
        tests=tests,
        budget="full",
        notes=logs.notes,
    )


def _drives_on_map(logs: LogFolder, options: Mapping[str, str]) -> Drives:
    """The drives that are tested on a 3-D map; raises ConfigError if there is none."""
    if MAP_SEQUENCE in logs.missing:
        raise ConfigError(
            f"{logs.root / MAP_SEQUENCE}: a sequence of this name, which is kept for the map: "
            "rename it"
        )
    return Drives(
        world="recorded",
        root=str(logs.root),
        train=MAP_SEQUENCE,
        tests=_test_sequences(logs, options, [], [MAP_SEQUENCE]),
        budget="full",
        notes=logs.notes,
    )


def map_path(path: str) -> str:
    """The whole path of a 3-D map, as a study has it.

    Raises LogError for a path that is no map, ConfigError for one that cannot be used.
    """
    files = Path(path).expanduser()
    MapFiles.of([files])
    return _safe("map", files.resolve())


def _root(name: str, options: Mapping[str, str]) -> Path:
    """The folder of the logs; raises ConfigError if it is not given, or cannot be used."""
    if "root" not in options:
        raise ConfigError(f"where is {name}? Say root=FOLDER")
    root = Path(options["root"]).expanduser()
    if not root.is_dir():
        raise ConfigError(f"root={options['root']}: no such folder")
    return Path(_safe("root", root.resolve()))


def _safe(option: str, path: Path) -> str:
    """The path as text; raises ConfigError if a shell or yaml would misread it."""
    if not SAFE_PATH.fullmatch(str(path)):
        raise ConfigError(
            f"{option}={path}: a path of letters, digits, blanks and ./_-+@~ is needed; a link "
            "with such a name will do"
        )
    return str(path)


def _named_sequences(options: Mapping[str, str]) -> list[str]:
    """All names that the options train= and tests= give."""
    train = options.get("train", "").replace(",", " ").split()
    tests = options.get("tests", "").replace(",", " ").split()
    return train + tests


def _named_splits(options: Mapping[str, str], readable: Sequence[str]) -> list[str]:
    """The names in train= and tests= that are splits of readable logs, such as drive+path1of2."""
    named_splits = []
    for name in dict.fromkeys(_named_sequences(options)):
        log, split = Split.named(name)
        if split and log in readable:
            named_splits.append(name)
    return named_splits


def _rule(name: str, defaults: Mapping[str, Any], options: Mapping[str, str]) -> str | None:
    """How one log is split; the first split trains. None if no log is split."""
    rule: str | None = options.get("split", defaults.get("split"))
    if "log" in options and not rule:
        raise ConfigError(
            f"log={options['log']}: {name} splits no log; give split= too, or train= and tests= "
            "instead"
        )
    if options.get("split") and {"train", "tests"} <= options.keys():
        raise ConfigError(
            f"split={rule}: train= and tests= name the splits already; leave one of the two out"
        )
    return rule


def _training_sequences(
    logs: LogFolder, options: Mapping[str, str], default: str | None
) -> list[str]:
    """The training sequences: of train=, else the data set's default, else the first readable."""
    first_readable = logs.readable[0] if logs.readable else ""
    sequences = options.get("train", default or first_readable).replace(",", " ").split()
    if len(sequences) > 1:
        for sequence in sequences:
            if sequence not in logs.readable:
                logs.notes.append(f"{sequence}: not below {logs.root}, not trained on")
        sequences = [sequence for sequence in sequences if sequence in logs.readable]
    train = " ".join(sequences)
    whole_logs = _whole_logs(sequences)
    for name in _named_sequences(options):
        if name in whole_logs and name not in sequences:
            raise ConfigError(
                f"tests={name}: the training sequence {train} is a split of it; give another split"
            )
    if not sequences or not set(sequences) <= set(logs.readable):
        advice = "no sequence there can"
        if logs.readable:
            advice = f"give train=, one of {', '.join(logs.readable)}"
        raise ConfigError(
            f"the training sequence {train} cannot be read below {logs.root}: {advice}"
            f"{logs.notes_text}"
        )
    return sequences


def _whole_logs(sequences: Sequence[str]) -> list[str]:
    """The log that each sequence is, or is a split of."""
    whole_logs = []
    for sequence in sequences:
        log, _ = Split.named(sequence)
        whole_logs.append(log)
    return whole_logs


def _test_sequences(
    logs: LogFolder, options: Mapping[str, str], default: Sequence[str], train: Sequence[str]
) -> list[str]:
    """The test sequences: of tests=, else the data set's default, else all that do not train."""
    if "tests" in options:
        tests = options["tests"].split(",")
    elif default:
        tests = list(default)
    else:
        training_names = (*train, *_whole_logs(train))
        tests = [name for name in logs.readable if name not in training_names]
    train_text = " ".join(train)
    if tests == [train_text]:
        raise ConfigError(f"tests={train_text}: is the training sequence; give others")
    earlier_notes = logs.notes_text
    for sequence in tests:
        if sequence not in logs.readable and sequence not in logs.missing:
            logs.notes.append(f"{sequence}: not below {logs.root}, left out")
    readable_tests = [test for test in tests if test in logs.readable and test not in train]
    if not readable_tests:
        raise ConfigError(
            f"no test sequence can be read below {logs.root}: "
            f"{_advice_on_tests(logs, options, train)}{earlier_notes}"
        )
    return readable_tests


def _advice_on_tests(logs: LogFolder, options: Mapping[str, str], train: Sequence[str]) -> str:
    """Advice if no test sequence can be read."""
    choices = [sequence for sequence in logs.readable if sequence not in train]
    if choices:
        return f"give tests=, some of {', '.join(choices)}"
    if len(logs.readable) == 1:
        # a split by path needs poses, which slam has not estimated yet
        measure = "time" if options.get("poses") == "slam" else "path"
        return f"one more is needed, or split={measure}:2 splits it, without train="
    return "one more is needed"


def _reader(name: str, settings: Mapping[str, Any]) -> Reader:
    """Build the reader in a data set's yaml; raises ConfigError for a wrong class or key."""
    target = settings.get(TARGET)
    try:
        kind = target_class(str(target), READERS)
    except NotInstalledError:
        raise
    except ConfigError:
        raise ConfigError(
            f"conf/dataset/{name}.yaml: reader.{TARGET}={target}: no such reader"
        ) from None
    keys = [field.name for field in fields(kind)]
    if unknown := [key for key in settings if key not in (*keys, TARGET)]:
        raise ConfigError(
            f"conf/dataset/{name}.yaml: reader has no key {unknown[0]}: expected {', '.join(keys)}"
        )
    reader: Reader = build(settings, READERS)
    return reader
