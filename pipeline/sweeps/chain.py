"""The chain as a sweep sees it: dvc.yaml and its lists in; a step for each instance of a stage out.

A job of a sweep runs single steps without DVC, with other settings than dvc.yaml has.
"""

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from operator import getitem
from pathlib import Path, PurePosixPath
from typing import Any

from pipeline.core.errors import ConfigError
from pipeline.studies.layout import ARTIFACTS

REFERENCE = re.compile(r"\$\{([\w.]+)\}")
"""A name that dvc.yaml has for a value: ${item.dataset}."""


@dataclass(frozen=True)
class Step:
    """One instance of a stage, such as the training of one method at one cell size."""

    stage: str
    command: str
    """python -m stages.STAGE KEY=VALUE …"""
    deps: tuple[str, ...]
    """What it reads: files and folders of code, and artifacts."""
    params: Mapping[str, tuple[str, ...]]
    """File of conf/ to the keys in it that count; without keys all count."""
    outs: tuple[str, ...]
    """The artifacts that it writes."""

    @cached_property
    def overrides(self) -> dict[str, str]:
        """The key=value words of its command line, unquoted."""
        pairs = (word.partition("=") for word in shlex.split(self.command)[3:])
        return {key: value.strip("'") for key, _, value in pairs}

    @cached_property
    def choices(self) -> dict[str, str]:
        """Overrides that choose a file of a group, such as grid=10m."""
        return {
            key: value
            for key, value in self.overrides.items()
            if f"conf/{key}/{value}.yaml" in self.params
        }

    @cached_property
    def fields(self) -> dict[str, str]:
        """The other overrides: paths, and names such as the sequence's."""
        return {key: value for key, value in self.overrides.items() if key not in self.choices}


def expand(definition: Mapping[str, Any], lists: Mapping[str, Any]) -> list[Step]:
    """The steps of dvc.yaml as parsed, with `lists` as conf/lists.yaml has them, or others.

    Raises ConfigError for a name in dvc.yaml that the lists have not.
    """
    return [
        _step(stage, _filled(body.get("do", body), {"lists": lists, "key": key, "item": item}))
        for stage, body in definition["stages"].items()
        for key, item in _items(body, lists).items()
    ]


def _items(body: Mapping[str, Any], lists: Mapping[str, Any]) -> Mapping[str, Any]:
    """What a stage's `foreach` goes through; of a stage without one a single item."""
    items: Mapping[str, Any] = {"": None}
    if "foreach" in body:
        items = _filled(body["foreach"], {"lists": lists})
    return items


def _step(stage: str, instance: Mapping[str, Any]) -> Step:
    """The step of an instance of a stage, as dvc.yaml has it with all names filled in."""
    params = {
        file: tuple(keys or ())
        for entry in instance.get("params", ())
        for file, keys in entry.items()
    }
    # an entry of outs is a path, or a mapping of it to settings such as `cache: false`
    entries = (*instance.get("outs", ()), *instance.get("metrics", ()))
    outs = [out for entry in entries for out in ([entry] if isinstance(entry, str) else entry)]
    return Step(stage, instance["cmd"], tuple(instance["deps"]), params, tuple(outs))


def producers(steps: Sequence[Step]) -> dict[str, Step]:
    """Map each artifact to the step that makes it."""
    return {out: step for step in steps for out in step.outs}


def inputs(step: Step, makers: Mapping[str, Step]) -> dict[str, Step]:
    """Map the artifacts that a step reads to the steps that make them.

    It may read an artifact whole, a part of it, or a folder of several.
    """
    read_paths = [PurePosixPath(dep) for dep in step.deps if dep.startswith(f"{ARTIFACTS}/")]
    return {
        artifact: maker
        for artifact, maker in makers.items()
        if any(
            dep.is_relative_to(artifact) or PurePosixPath(artifact).is_relative_to(dep)
            for dep in read_paths
        )
    }


def code(step: Step) -> list[Path]:
    """The project's own files and folders that a step runs."""
    return [Path(dep) for dep in step.deps if not dep.startswith(f"{ARTIFACTS}/")]


def _filled(node: Any, values: Mapping[str, Any]) -> Any:
    """A part of a yaml with every ${a.b} replaced by what `values` have under that path.

    A text that is nothing but a reference becomes the value itself, such as a list.
    """
    if isinstance(node, Mapping):
        return {_filled(key, values): _filled(value, values) for key, value in node.items()}
    if isinstance(node, list):
        return [_filled(value, values) for value in node]
    if not isinstance(node, str):
        return node
    if reference := REFERENCE.fullmatch(node):
        return _look_up(reference[1], values)
    return REFERENCE.sub(lambda reference: str(_look_up(reference[1], values)), node)


def _look_up(path: str, values: Mapping[str, Any]) -> Any:
    try:
        return reduce(getitem, path.split("."), values)
    except (KeyError, TypeError):
        raise ConfigError(f"dvc.yaml: ${{{path}}} names nothing in conf/lists.yaml") from None
