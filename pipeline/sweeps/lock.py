"""Checks by dvc.lock whether an artifact and its inputs are up to date.

Command, code, parameters and inputs must be the same.
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


class UpToDate:
    """What DVC's lock files record of the steps of a job, read once."""

    def __init__(self, root: Path) -> None:
        self._root = root
        # without any entry, a sweep builds all that it needs
        self._recipes = DvcLock.read(root / "dvc.lock").entries
        self._recorded = {
            out["path"]: out.get("md5") for entry in self._recipes.values() for out in entry["outs"]
        }
        self._digest = cache(lambda path: digest(root / path))
        self._vouched: dict[str, bool] = {}

    def vouches(self, step: Step, makers: Mapping[str, Step]) -> bool:
        """Whether `dvc status` would report nothing for this step.

        The artifact's own content is checked by `intact`.
        """
        if step.command not in self._vouched:
            self._vouched[step.command] = self._unchanged(step, makers)
        return self._vouched[step.command]

    def _unchanged(self, step: Step, makers: Mapping[str, Step]) -> bool:
        entry = self._recipes.get(step.outs[0])
        if entry is None or entry["cmd"] != step.command:
            return False
        recorded = {dep["path"]: dep["md5"] for dep in entry["deps"]}
        return (
            recorded.keys() == set(step.deps)
            and entry.get("params", {})
            == {file: self._params(file, keys) for file, keys in step.params.items()}
            and all(
                recorded[path] == (self._recorded.get(path) or self._digest(path))
                for path in step.deps
            )
            and all(self.vouches(maker, makers) for maker in inputs(step, makers).values())
        )

    def intact(self, step: Step) -> bool:
        """Whether the artifacts of a step have the digests that dvc.lock recorded."""
        return all(self._digest(out) == self._recorded.get(out) for out in step.outs)

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
