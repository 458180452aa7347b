"""Expands dvc.yaml as DVC does: its stages and lists in; a step for each instance of a stage out.

A job of a sweep runs single steps without DVC, with other settings than dvc.yaml has. For that it
must know each step's command, what it reads and what it writes.
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
"""A reference in dvc.yaml to a value, such as ${item.dataset}."""


@dataclass(frozen=True)
class Step:
    """One instance of a stage, such as the training of one method at one cell size."""

    stage: str
    command: str
    """python -m stages.STAGE KEY=VALUE …"""
    deps: tuple[str, ...]
    """The files and folders of code that it runs, and the artifacts that it reads."""
    params: Mapping[str, tuple[str, ...]]
    """Files of conf/, each with the keys in it that its result depends on; if empty, all keys."""
    outs: tuple[str, ...]
    """The artifacts that it writes."""

    # a cached property writes the object's dictionary itself, which a frozen dataclass allows
    @cached_property
    def overrides(self) -> dict[str, str]:
        """The values of the words KEY=VALUE of its command line, by key, unquoted."""
        _, _, _, *words = shlex.split(self.command)  # python -m stages.STAGE KEY=VALUE …
        pairs = (word.partition("=") for word in words)
        return {key: value.strip("'") for key, _, value in pairs}

    @cached_property
    def choices(self) -> dict[str, str]:
        """The overrides that choose a file of a group of conf/, such as grid=10m."""
        return {
            key: value
            for key, value in self.overrides.items()
            if f"conf/{key}/{value}.yaml" in self.params
        }

    @cached_property
    def fields(self) -> dict[str, str]:
        """The other overrides: paths of artifacts, and names such as the sequence's."""
        return {key: value for key, value in self.overrides.items() if key not in self.choices}


def expand(definition: Mapping[str, Any], lists: Mapping[str, Any]) -> list[Step]:
    """The steps of a parsed dvc.yaml, `definition`, with the lists that it expands to.

    A stage has a step for each item of the list that its `foreach` names, or a single one. Raises
    ConfigError for a reference in dvc.yaml that `lists` cannot fill.
    """
    steps = []
    for stage, body in definition["stages"].items():
        template = body.get("do", body)  # a stage with `foreach` has its command and files in `do`
        for key, item in _items(body, lists).items():
            values = {"lists": lists, "key": key, "item": item}
            steps.append(_step(stage, _filled(template, values)))
    return steps


def _items(body: Mapping[str, Any], lists: Mapping[str, Any]) -> Mapping[str, Any]:
    """The list that a stage's `foreach` names; without `foreach` a list of one empty item."""
    items: Mapping[str, Any] = {"": None}
    if "foreach" in body:
        items = _filled(body["foreach"], {"lists": lists})
    return items


def _step(stage: str, instance: Mapping[str, Any]) -> Step:
    """The step of an instance of a stage, given as dvc.yaml has it with all references filled."""
    params = {}
    for entry in instance.get("params", ()):
        for file, keys in entry.items():
            params[file] = tuple(keys or ())
    outs: list[str] = []
    for out in (*instance.get("outs", ()), *instance.get("metrics", ())):
        # an output is a path, or maps the path to settings such as `cache: false`
        outs += [out] if isinstance(out, str) else [*out]
    return Step(stage, instance["cmd"], tuple(instance["deps"]), params, tuple(outs))


def producers(steps: Sequence[Step]) -> dict[str, Step]:
    """The step that makes each artifact, by the artifact's path."""
    return {out: step for step in steps for out in step.outs}


def inputs(step: Step, step_of_artifact: Mapping[str, Step]) -> dict[str, Step]:
    """The artifacts that a step reads, each with the step that makes it.

    `step_of_artifact` are the `producers` of the whole chain.
    """
    read_paths = [PurePosixPath(dep) for dep in step.deps if dep.startswith(f"{ARTIFACTS}/")]
    return {
        artifact: producer
        for artifact, producer in step_of_artifact.items()
        # a path is the artifact itself, a part of it, or a folder that it is in
        if any(
            path.is_relative_to(artifact) or PurePosixPath(artifact).is_relative_to(path)
            for path in read_paths
        )
    }


def code(step: Step) -> list[Path]:
    """The project's own files and folders that a step runs."""
    return [Path(dep) for dep in step.deps if not dep.startswith(f"{ARTIFACTS}/")]


def _filled(node: Any, values: Mapping[str, Any]) -> Any:
    """A part of a parsed yaml with every reference ${a.b} replaced by the value at that path."""
    if isinstance(node, Mapping):
        return {_filled(key, values): _filled(value, values) for key, value in node.items()}
    if isinstance(node, list):
        return [_filled(value, values) for value in node]
    if not isinstance(node, str):
        return node
    if reference := REFERENCE.fullmatch(node):
        return _look_up(reference[1], values)  # group 1: the path between the brackets
    return REFERENCE.sub(lambda reference: str(_look_up(reference[1], values)), node)


def _look_up(path: str, values: Mapping[str, Any]) -> Any:
    """The value at a path of keys with dots between; raises ConfigError if there is none."""
    try:
        return reduce(getitem, path.split("."), values)
    except (KeyError, TypeError):
        raise ConfigError(f"dvc.yaml: ${{{path}}} names nothing in conf/lists.yaml") from None
