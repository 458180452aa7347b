"""Whether a step is up to date, as `dvc status` would say: dvc.lock and files in; yes or no out.

A job of a sweep may take an artifact that DVC built if the step's command, code, parameters and
inputs are still those that dvc.lock records. DVC itself cannot be asked in a job: it locks the
whole project.
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

IGNORED = ("__pycache__", ".numba")
"""Folders that no digest counts."""


class UpToDate:
    """What DVC's lock files record of the steps of a job, read once."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._entries = DvcLock.read(root / "dvc.lock").entries
        """By output; without any, a sweep builds all that it needs."""
        self._output_md5 = {
            out.path: out.md5 for entry in self._entries.values() for out in entry.outs
        }
        self._digest = cache(lambda path: digest(root / path))
        self._answers: dict[str, bool] = {}
        """Of `is_up_to_date`, by the step's command."""

    def is_up_to_date(self, step: Step, makers: Mapping[str, Step]) -> bool:
        """Whether `dvc status` would report nothing for a step and all steps before it.

        `makers` maps each artifact to its step. The artifact's own content is checked by
        `is_intact`.
        """
        if step.command not in self._answers:
            self._answers[step.command] = self._is_unchanged(step, makers)
        return self._answers[step.command]

    def is_intact(self, step: Step) -> bool:
        """Whether the artifacts of a step have the digests that dvc.lock recorded."""
        return all(self._digest(out) == self._output_md5.get(out) for out in step.outs)

    def _is_unchanged(self, step: Step, makers: Mapping[str, Step]) -> bool:
        entry = self._entries.get(step.outs[0])
        if entry is None or entry.command != step.command:
            return False
        input_md5 = {dep.path: dep.md5 for dep in entry.deps}
        params = {file: self._params(file, keys) for file, keys in step.params.items()}
        if input_md5.keys() != set(step.deps) or entry.params != params:
            return False
        return all(
            input_md5[path] == (self._output_md5.get(path) or self._digest(path))
            for path in step.deps
        ) and all(self.is_up_to_date(maker, makers) for maker in inputs(step, makers).values())

    def _params(self, file: str, keys: tuple[str, ...]) -> dict[str, Any]:
        """The values of these keys in a file, such as `studies.town`, where it has them.

        Without keys it is the whole content.
        """
        content: dict[str, Any] = yaml.load((self._root / file).read_text(encoding="utf-8"), Yaml)
        values: dict[str, Any] = {}
        for key in keys:
            with suppress(KeyError, TypeError):
                values[key] = reduce(getitem, key.split("."), content)
        return values if keys else content


def digest(path: Path) -> str | None:
    """The md5 digest of a file or folder as DVC records it; None where there is neither.

    Of a folder it is the digest of a list of its files' digests.
    """
    if path.is_file():
        return hashlib.md5(path.read_bytes(), usedforsecurity=False).hexdigest()
    if not path.is_dir():
        return None
    files = [
        file for file in path.rglob("*") if file.is_file() and not set(IGNORED) & set(file.parts)
    ]
    listing = [
        {"md5": digest(file), "relpath": file.relative_to(path).as_posix()} for file in files
    ]
    listing.sort(key=itemgetter("relpath"))
    return (
        hashlib.md5(json.dumps(listing, sort_keys=True).encode(), usedforsecurity=False).hexdigest()
        + ".dir"
    )
