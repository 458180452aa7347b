"""conf/benchmark.yaml, the one list of names that the DAG expands to: studies proposed from what is on disk, and spelled out."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pipeline.errors import ConfigError
from pipeline.studies.discovery import Proposal, parsed, recorded, simulated
from pipeline.studies.expansion import AS_DRIVEN, QUESTIONS, expand, turned

HEAD = """\
# The one list of names. `yearloc use campus town` writes it; change `studies` by hand, and `yearloc use` spells them out anew.
"""
SPELLED_OUT = "  # What the studies come to: dvc.yaml expands to these.\n"
MOST_SEEDS = 100


def text(studies: Mapping[str, Mapping[str, Any]]) -> str:
    """The file's content, one study, drive, view, … a line. Raises ConfigError for a study that lacks a word."""
    try:
        lists = expand(studies)
    except KeyError as error:
        raise ConfigError(f"conf/benchmark.yaml: a study lacks {error.args[0]}; `yearloc use DATASET` writes one anew") from None
    dataset, study = next(iter(studies.items()))
    first = f"  first: {dataset}/{study['grids'][0]}  # what `dvc plots` shows\n"
    listed = "".join(map(_block, lists, lists.values()))
    return f"{HEAD}benchmark:\n{_block('studies', studies)}{SPELLED_OUT}{first}{listed}"


def _block(name: str, members: Mapping[str, Any]) -> str:
    if not members:
        return f"  {name}: {{}}\n"
    lines = [yaml.safe_dump(dict(member), default_flow_style=True, width=10_000, sort_keys=False) for member in members.values()]
    return f"  {name}:\n" + "".join(f"    {key}: {line}" for key, line in zip(members, lines, strict=True))


def propose(conf: Path, name: str, options: Mapping[str, str]) -> Proposal:
    """The study of data set `name`; options are root, log, world, budget, question and seeds, and with commas train, tests,
    methods, variants, altered and cells.

    Raises ConfigError for an unknown data set or option, and where what is on disk does not make a study.
    """
    path = conf / "dataset" / f"{name}.yaml"
    if not path.is_file():
        known = ", ".join(sorted(file.stem for file in path.parent.glob("*.yaml")))
        raise ConfigError(f"no data set {name}: expected one of {known}")
    dataset = parsed(path)
    allowed = {"tests", "methods", "budget", "question", "seeds", "variants", "altered", "cells"} | (
        {"world"} if dataset["simulated"] else {"root", "log", "train"}
    )
    if unknown := sorted(set(options) - allowed):
        raise ConfigError(f"{name} has no option {unknown[0]}: expected {', '.join(sorted(allowed))}")
    study = dataset["study"]
    question = options.get("question", "year")
    if question not in (asked := [word for word in QUESTIONS if word in ("year", "robustness") or word in study]):
        raise ConfigError(f"question={question}: of {name} expected {' or '.join(asked)}")
    if question == "viewpoints":
        study = {**study, "parts": False}
    asked_of_all = conf / "question" / f"{question}.yaml"
    study = {**study, **(parsed(asked_of_all) if asked_of_all.is_file() else {}), **study.get(question, {})}
    found = simulated(conf, name, study, options) if dataset["simulated"] else recorded(name, dataset["reader"], study, options)
    places = found.study
    stress = dict(study.get("stress", {}).get(options.get("world", "demo"), {})) if dataset["simulated"] else {}
    wanted = options["methods"].split(",") if "methods" in options else study["methods"]
    views, instead = {method: _view(conf, method) for method in wanted}, study.get("views", {})
    seeds, variants = _seeds(options, study), _variants(options, study, wanted)
    methods = [entry(conf, method, instead.get(view, view), seeds, variants.get(method)) for method, view in views.items()]
    if question == "viewpoints" and len(turned(methods)) < len(methods):
        raise ConfigError(f"methods={','.join(wanted)}: only methods that look at bird-views can be asked about viewpoints")
    budget = options.get("budget", places["budget"])
    if not (conf / "budget" / f"{budget}.yaml").is_file():
        raise ConfigError(f"budget={budget}: expected tiny, demo or full")
    words = {"submap": study["submap"], "grids": study["grids"], "methods": methods, "budget": budget, "question": question}
    alterable = {name: spread(places["tests"], number) for name, number in study.get("altered", {}).items()}
    altered = {name: alterable[name] for name in _some(options, "altered", list(alterable))}
    grids = [path.stem for path in sorted((conf / "grid").glob("*.yaml")) if path.stem not in study["grids"]]
    besides: dict[str, Any] = {
        "cells": _some(options, "cells", grids) if "cells" in options else study.get("cells"),
        "stress": stress,
        "robustness": altered | ({AS_DRIVEN: list(stress)} if stress else {}),
    }
    return Proposal({**places, **words, **{name: value for name, value in besides.items() if value}}, found.notes)


def spread(tests: list[str], number: int) -> list[str]:
    """So many of the test sequences, evenly from the first to the last; all, if there are no more."""
    if number >= len(tests):
        return list(tests)
    return [tests[round(i * (len(tests) - 1) / max(number - 1, 1))] for i in range(number)]


def _seeds(options: Mapping[str, str], study: Mapping[str, Any]) -> int:
    """How many models of each method that draws at random."""
    seeds = options.get("seeds", str(study.get("seeds", 1)))
    if not (seeds.isdecimal() and 1 <= int(seeds) <= MOST_SEEDS):
        raise ConfigError(f"seeds={seeds}: expected a number from 1 to {MOST_SEEDS}")
    return int(seeds)


def _variants(options: Mapping[str, str], study: Mapping[str, Any], methods: list[str]) -> dict[str, dict[str, str]]:
    """Of each of the methods the variants that are wanted: name to the words that make it."""
    known: dict[str, Mapping[str, str]] = {name: own for name, own in study.get("variants", {}).items() if name in methods}
    wanted = _some(options, "variants", sorted({name for own in known.values() for name in own}))
    return {method: {name: own[name] for name in own if name in wanted} for method, own in known.items()}


def _some(options: Mapping[str, str], option: str, known: list[str]) -> list[str]:
    """Those of the known names that an option wants: all, if it is not there, and none, if it is empty."""
    wanted = [name for name in dict.fromkeys(options[option].split(",")) if name] if option in options else known
    if unknown := [name for name in wanted if name not in known]:
        expected = f"expected some of {', '.join(known)}" if known else "this question and these methods have none"
        raise ConfigError(f"{option}={unknown[0]}: {expected}")
    return wanted


def entry(conf: Path, method: str, view: str, seeds: int = 1, variants: Mapping[str, str] | None = None) -> dict[str, Any]:
    """A method as a study lists it: what it looks at, which stage draws that, if not `views`, how often it is trained, and its
    variants."""
    path = conf / "view" / f"{view}.yaml"
    drawn = {"stage": "birdviews"} if path.is_file() and "octree" in parsed(path) else {}
    settings = parsed(conf / "method" / f"{method}.yaml")
    trained = {"seeds": seeds} if seeds > 1 and "seed" in settings else {}
    return {
        "name": method,
        "view": view,
        "code": code(settings["_target_"]),
        **drawn,
        **trained,
        **({"variants": dict(variants)} if variants else {}),
    }


def code(target: str) -> str:
    """The file of a method, or its folder where its networks live beside it, such as pipeline/methods/pfl."""
    parts = target.split(".")[:-1]
    return "/".join(parts[:3]) + (".py" if len(parts) == 3 else "")


def _view(conf: Path, method: str) -> str:
    """What a method looks at."""
    path = conf / "method" / f"{method}.yaml"
    if not path.is_file():
        raise ConfigError(
            f"methods={method}: expected some of {', '.join(sorted(file.stem for file in path.parent.glob('*.yaml')))}"
        )
    return str(parsed(path)["view"])


def check(conf: Path, studies: Mapping[str, Mapping[str, Any]]) -> None:
    """Raise ConfigError for a study, maybe written by hand, that names a file which conf/ lacks."""
    for dataset, study in studies.items():
        named = [("dataset", dataset), *((word, study[word]) for word in ("world", "submap", "budget"))]
        named += [("grid", grid) for grid in study["grids"]]
        named += [(word, method[key]) for method in study["methods"] for word, key in (("method", "name"), ("view", "view"))]
        for group, name in named:
            if not (conf / group / f"{name}.yaml").is_file():
                known = ", ".join(sorted(path.stem for path in (conf / group).glob("*.yaml")))
                raise ConfigError(f"conf/benchmark.yaml: {dataset} names the {group} {name}; expected one of {known}")
