"""Says whether a step of the chain is up to date, as `dvc status` would, by dvc.lock and the files.

A job of a sweep may take an artifact that DVC built if the step's command, code, parameters and
inputs are still those that dvc.lock records. It cannot ask DVC itself, which locks the whole
project.
"""

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from functools import cache, reduce
from operator import getitem, itemgetter
from pathlib import Path
from typing import Any

import yaml

from pipeline.running.dvc_files import DvcLock, Yaml
from pipeline.sweeps.chain import Step, inputs

IGNORED_FOLDERS = ("__pycache__", ".numba")
"""Folders whose files no digest counts: compiled code, which .dvcignore leaves out too."""


class UpToDate:
    """Compares steps with what DVC's lock files record, which are read once."""

    def __init__(self, root: Path) -> None:
        """`root` is the project's folder."""
        self._root = root
        self._entries = DvcLock.read(root / "dvc.lock").entries
        """The recorded steps by their outputs; if there are none, a sweep builds all it needs."""
        self._output_md5 = {
            out.path: out.md5 for entry in self._entries.values() for out in entry.outs
        }
        self._digest = cache(lambda path: digest(root / path))  # each file is read once
        self._answers: dict[str, bool] = {}
        """The answers of `is_up_to_date`, by the step's command."""

    def is_up_to_date(self, step: Step, step_of_artifact: Mapping[str, Step]) -> bool:
        """Whether `dvc status` would report nothing for a step and all steps before it.

        `step_of_artifact` are the `producers` of the chain. The step's own artifacts are not
        checked: `is_intact` does so.
        """
        if step.command not in self._answers:
            self._answers[step.command] = self._is_unchanged(step, step_of_artifact)
        return self._answers[step.command]

    def is_intact(self, step: Step) -> bool:
        """Whether the artifacts of a step still have the digests that dvc.lock records."""
        return all(self._digest(out) == self._output_md5.get(out) for out in step.outs)

    def _is_unchanged(self, step: Step, step_of_artifact: Mapping[str, Step]) -> bool:
        """Compare a step with its record: command, parameters, inputs, and the steps before it."""
        entry = self._entries.get(step.outs[0])
        if entry is None or entry.command != step.command:
            return False
        recorded_md5 = {dep.path: dep.md5 for dep in entry.deps}
        params = {file: self._params(file, keys) for file, keys in step.params.items()}
        if recorded_md5.keys() != set(step.deps) or entry.params != params:
            return False
        for path in step.deps:
            # the output of another step has the digest that its own record says
            if recorded_md5[path] != (self._output_md5.get(path) or self._digest(path)):
                return False
        producers = inputs(step, step_of_artifact).values()
        return all(self.is_up_to_date(producer, step_of_artifact) for producer in producers)

    def _params(self, file: str, keys: tuple[str, ...]) -> dict[str, Any]:
        """The values of `keys`, such as `studies.town`, that a file has; without keys all of it."""
        content: dict[str, Any] = yaml.load((self._root / file).read_text(encoding="utf-8"), Yaml)
        if not keys:
            return content
        values: dict[str, Any] = {}
        for key in keys:
            with suppress(KeyError, TypeError):
                values[key] = reduce(getitem, key.split("."), content)
        return values


def digest(path: Path) -> str | None:
    """The md5 digest of a file or folder as DVC records it; None if there is neither.

    The digest of a folder is that of a list of its files and their digests, with the ending .dir.
    """
    if path.is_file():
        return _md5(path.read_bytes())
    if not path.is_dir():
        return None
    files = [
        file
        for file in path.rglob("*")
        if file.is_file() and not set(IGNORED_FOLDERS) & set(file.parts)
    ]
    listing = [
        {"md5": digest(file), "relpath": file.relative_to(path).as_posix()} for file in files
    ]
    listing.sort(key=itemgetter("relpath"))
    return f"{_md5(json.dumps(listing, sort_keys=True).encode())}.dir"


def _md5(content: bytes) -> str:
    return hashlib.md5(content, usedforsecurity=False).hexdigest()
