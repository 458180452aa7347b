"""Whether an artifact is up to date by dvc.lock: same command, code, parameters and inputs, and its inputs up to date too."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from pipeline.running.dvc_files import DvcLock, Yaml
from pipeline.sweeps.chain import Step, code, inputs

IGNORED = ("__pycache__", ".numba")


class UpToDate:
    """What DVC's lock files say of the steps of a job, read once."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._recipes = DvcLock.read(root / "dvc.lock").entries  # without any, a sweep builds all that it needs
        self._digest = cache(lambda path: digest(root / path))
        self._vouched: dict[str, bool] = {}

    def vouches(self, step: Step, makers: Mapping[str, Step]) -> bool:
        """Whether `dvc status` would report nothing for this step; the artifact's own content is checked by `intact`."""
        if step.command not in self._vouched:
            self._vouched[step.command] = self._unchanged(step, makers)
        return self._vouched[step.command]

    def _unchanged(self, step: Step, makers: Mapping[str, Step]) -> bool:
        entry = self._recipes.get(step.outs[0]) if step.outs else None
        if entry is None or entry["cmd"] != step.command:
            return False
        recorded = {dep["path"]: dep["md5"] for dep in entry["deps"]}
        needed, sources = inputs(step, makers), {path.as_posix() for path in code(step)}
        read = [path for path in step.deps if path not in sources]
        return (
            recorded.keys() == set(step.deps)
            and entry.get("params", {}) == {file: self._params(file, keys) for file, keys in step.params.items()}
            and all(recorded[path] == self._digest(path) for path in sources)
            and all(recorded[path] == (self._recorded(path) or self._digest(path)) for path in read)
            and all(self.vouches(maker, makers) for maker in needed.values())
        )

    def intact(self, step: Step) -> bool:
        """Whether the artifacts of a step have the digests that dvc.lock recorded."""
        return all(self._digest(out) == self._recorded(out) for out in step.outs)

    def _recorded(self, path: str) -> str | None:
        outs = self._recipes.get(path, {}).get("outs", ())
        return next((out["md5"] for out in outs if out["path"] == path), None)

    def _params(self, file: str, keys: tuple[str, ...]) -> dict[str, Any]:
        found: dict[str, Any] = yaml.load((self._root / file).read_text(), Yaml)
        named = {key: _within(found, key.split(".")) for key in keys}
        return {key: value[0] for key, value in named.items() if value} if keys else found


def digest(path: Path) -> str | None:
    """The digest of a file or folder as DVC records it (md5; of a folder, that of a list of its files' ones); None of neither."""
    if path.is_file():
        return hashlib.md5(path.read_bytes(), usedforsecurity=False).hexdigest()
    if not path.is_dir():
        return None
    files = [file for file in path.rglob("*") if file.is_file() and not set(IGNORED) & set(file.parts)]
    listing = sorted(({"md5": digest(file), "relpath": file.relative_to(path).as_posix()} for file in files), key=_relpath)
    return hashlib.md5(json.dumps(listing, sort_keys=True).encode(), usedforsecurity=False).hexdigest() + ".dir"


def _within(values: Any, path: Sequence[str]) -> list[Any]:
    """The value at the end of a path of keys; none where there is no such end."""
    for part in path:
        if not isinstance(values, dict) or part not in values:
            return []
        values = values[part]
    return [values]


def _relpath(entry: Mapping[str, str | None]) -> str:
    return str(entry["relpath"])
