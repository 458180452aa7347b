"""conf/benchmark.yaml, the one list of names that the DAG expands to: proposed from what is on disk."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from pydoc import locate
from typing import Any

import yaml

from pipeline.errors import ConfigError
from pipeline.readers.log import Reader

HEAD = "# The one list of names, which dvc.yaml expands to; `yearloc use campus|nclt|kitti` writes it anew.\n"
SAFE_PATH = re.compile(r"[\w./~+@ -]+")


@dataclass(frozen=True)
class Proposal:
    """A list for conf/benchmark.yaml, and what a person should know about it."""

    names: dict[str, Any]
    notes: list[str]

    def text(self) -> str:
        """The file's content, one name a line."""
        lines = []
        for name, value in self.names.items():
            shown = yaml.safe_dump(value, default_flow_style=True, width=1_000).removesuffix("...\n").strip()
            lines.append(f"  {name}: {shown}\n")
        return f"{HEAD}benchmark:\n{''.join(lines)}"


def propose(conf: Path, name: str, options: Mapping[str, str]) -> Proposal:
    """The list for data set `name`; options are root, log, train, tests (with commas), world and budget.

    Raises ConfigError for an unknown data set or option, and where what is on disk does not make a study.
    """
    path = conf / "dataset" / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in path.parent.glob("*.yaml")))
        raise ConfigError(f"no data set {name}: expected one of {known}")
    dataset = yaml.safe_load(path.read_text())
    allowed = {"world", "budget"} if dataset["simulated"] else {"root", "log", "train", "tests", "budget"}
    if unknown := sorted(set(options) - allowed):
        raise ConfigError(f"{name} has no option {unknown[0]}: expected {', '.join(sorted(allowed))}")
    found = _simulated(name, dataset, options) if dataset["simulated"] else _recorded(name, dataset, options)
    study, places = dataset["study"], found.names
    views = {method: yaml.safe_load((conf / "method" / f"{method}.yaml").read_text())["view"] for method in study["methods"]}
    names = {
        "dataset": name,
        "formats": study["formats"],
        "world": places["world"],
        "source": places["source"],
        "options": places["options"],
        "root": places["root"],
        "train": places["train"],
        "tests": places["tests"],
        "sequences": [places["train"], *places["tests"]],
        "submap": study["submap"],
        "views": sorted(set(views.values())),
        "grids": study["grids"],
        "methods": [{"name": method, "view": view} for method, view in views.items()],
        "budget": options.get("budget", places["budget"]),
    }
    if not (conf / "budget" / f"{names['budget']}.yaml").is_file():
        raise ConfigError(f"budget={names['budget']}: expected tiny, demo or full")
    return Proposal(names, found.notes)


def _simulated(name: str, dataset: Mapping[str, Any], options: Mapping[str, str]) -> Proposal:
    world = options.get("world", "demo")
    if world not in dataset["study"]["tests"]:
        raise ConfigError(f"world={world}: expected one of {', '.join(dataset['study']['tests'])}")
    places = {
        "world": world,
        "source": "world",
        "options": "",
        "root": f"artifacts/logs/{name}",
        "train": dataset["study"]["train"],
        "tests": list(dataset["study"]["tests"][world]),
        "budget": {"tiny": "tiny", "demo": "demo"}.get(world, "full"),
    }
    return Proposal(places, [])


def _recorded(name: str, dataset: Mapping[str, Any], options: Mapping[str, str]) -> Proposal:
    """What can be read below the root, matched with the study of the data set's yaml or the one asked for."""
    if "root" not in options:
        raise ConfigError(f"where is {name}? Say root=FOLDER")
    root = Path(options["root"]).expanduser()
    if not root.is_dir():
        raise ConfigError(f"root={options['root']}: no such folder")
    root = root.resolve()
    if not SAFE_PATH.fullmatch(str(root)):
        raise ConfigError(
            f"root={root}: a path of letters, digits, blanks and ./_-+@~ is needed; a link with such a name will do"
        )
    settings = dict(dataset["reader"])
    reader: Reader = locate(settings.pop("_target_"))(**settings)  # type: ignore[operator]
    lacking = reader.sequences(root)
    if not lacking:
        raise ConfigError(f"root={root}: no {name} sequence there; expected its folders as the archives unpack")
    whole = [sequence for sequence, missing in lacking.items() if not missing]
    notes = [f"{sequence}: lacks {', '.join(missing)}" for sequence, missing in lacking.items() if missing]
    train, tests = dataset["study"]["train"], list(dataset["study"]["tests"])
    if name == "kitti":
        log = options.get("log", train.partition("-")[0] if train.partition("-")[0] in whole else (whole or [""])[0])
        train, tests, whole = f"{log}-a", [f"{log}-b"], [f"{log}-a", f"{log}-b"] if log in whole else []
        notes += [f"logs found: {', '.join(lacking)}; each has its own frame, this study is on {log} (log=NN chooses another)"]
    train, tests = options.get("train", train), options["tests"].split(",") if "tests" in options else tests
    if train not in whole:
        known = ", ".join(whole) or "none"
        raise ConfigError(f"the training sequence {train} cannot be read below {root}: give train=, one of {known}")
    absent = [sequence for sequence in tests if sequence not in whole]
    notes += [f"{sequence}: not below {root}, left out" for sequence in absent if sequence not in lacking]
    tests = [test for test in tests if test in whole and test != train]
    if not tests:
        raise ConfigError(f"no test sequence can be read below {root}: give tests=, some of {', '.join(whole)}")
    places = {
        "world": name,
        "source": "readers",
        "options": f"\"world.root='{root}'\"",
        "root": str(root),
        "train": train,
        "tests": tests,
        "budget": "full",
    }
    return Proposal(places, notes)
