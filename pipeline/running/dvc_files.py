"""Reads what DVC recorded of the stages: dvc.lock, and dvc.yaml, of the whole project as one.

There is one of each in the root and one in each folder dag/STAGE.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Self

import yaml

from pipeline.running.texts import LOADER


class Yaml(LOADER):  # type: ignore[misc]
    """Reads numbers as DVC writes them: PyYAML takes 2e-05, a number in YAML 1.2, for a word."""


Yaml.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


@dataclass(frozen=True)
class LockedFile:
    """A file or folder that a stage read or wrote, as a lock file records it."""

    path: str
    """Relative to the root."""
    md5: str
    """Empty if it is not recorded."""
    size: int | None
    """Bytes of the file, or of all files in the folder; None if it is not recorded."""
    file_count: int
    """The number of files in the folder; 1 if it is a file."""
    is_folder: bool

    @classmethod
    def of(cls, recorded: Mapping[str, Any]) -> Self:
        """Read an item of a stage's deps or outs."""
        return cls(
            path=str(recorded.get("path")),
            md5=str(recorded.get("md5") or ""),
            size=int(recorded["size"]) if "size" in recorded else None,
            file_count=int(recorded.get("nfiles", 1)),
            is_folder="nfiles" in recorded,
        )


@dataclass(frozen=True)
class LockEntry:
    """A finished stage as a lock file records it."""

    stage: str
    """Its name, such as train@campus-10m-sci."""
    command: str
    """The command line that DVC ran."""
    deps: tuple[LockedFile, ...]
    """What it read."""
    params: Mapping[str, Mapping[str, Any]]
    """For each file of conf/ that it depends on, the values of its keys."""
    outs: tuple[LockedFile, ...]
    """What it wrote."""

    @classmethod
    def of(cls, stage: str, recorded: Mapping[str, Any]) -> Self:
        """Read the entry of a stage by its name."""
        return cls(
            stage=stage,
            command=str(recorded.get("cmd", "")),
            deps=tuple(map(LockedFile.of, recorded.get("deps") or ())),
            params=recorded.get("params") or {},
            outs=tuple(map(LockedFile.of, recorded.get("outs") or ())),
        )


@dataclass(frozen=True)
class DvcLock:
    """All that the lock files record; nothing where none can be read."""

    stages: Mapping[str, Mapping[str, Any]]
    """For each stage, such as train@campus-10m-sci, its cmd, deps, params and outs. Paths are
    relative to the root."""

    @classmethod
    def read(cls, front: Path) -> Self:
        """Read `front`, the root's dvc.lock, and those of the folders of dag/ beside it."""
        stages: dict[str, Mapping[str, Any]] = {}
        for path in files(front):
            stages |= _stages(path, path.stat().st_mtime_ns)
        return cls(stages)

    @cached_property
    def entries(self) -> dict[str, LockEntry]:
        """For the path of each recorded output, the entry of the stage that wrote it."""
        entry_by_path = {}
        for stage, recorded in self.stages.items():
            entry = LockEntry.of(stage, recorded)
            for out in entry.outs:
                entry_by_path[out.path] = entry
        return entry_by_path

    def entry(self, path: Path) -> LockEntry | None:
        """The entry of the stage that wrote `path`, or the nearest folder around it, if any."""
        for candidate in (path, *path.parents):
            if candidate.as_posix() in self.entries:
                return self.entries[candidate.as_posix()]
        return None

    def of(self, path: str) -> tuple[str, str]:
        """The md5 and the stage of an artifact, or of the nearest folder around it.

        Both are empty if no stage is recorded as having written it.
        """
        entry = self.entry(Path(path))
        if entry is None:
            return "", ""
        containing = {path, *map(str, Path(path).parents)}
        md5 = next((out.md5 for out in entry.outs if out.path in containing), "")
        return md5, entry.stage

    def params(self, stage: str) -> Mapping[str, Any]:
        """The parameters of a stage, by the file of conf/ that they are in."""
        params: Mapping[str, Any] = self.stages.get(stage, {}).get("params", {})
        return params


def files(front: Path) -> list[Path]:
    """`front`, the root's dvc.lock or dvc.yaml, and those in dag/STAGE/, as far as they exist."""
    in_stages = sorted(front.parent.glob(f"dag/*/{front.name}"))
    return [path for path in (front, *in_stages) if path.is_file()]


def definition(root: Path) -> dict[str, Any]:
    """The stages of all dvc.yaml files as one, parsed: {"stages": {name: body}}.

    A stage that is split into parts (`studies.parts`) is represented by its first part.
    """
    stages: dict[str, Any] = {}
    for path in files(root / "dvc.yaml"):
        content = yaml.load(path.read_text(encoding="utf-8"), Yaml)
        stages = {**content["stages"], **stages}
    return {"stages": stages}


@lru_cache(maxsize=64)
def _stages(path: Path, written_ns: int) -> dict[str, Any]:
    """The entries of one lock file as it was at `written_ns`, none if it is unreadable."""
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Yaml)
    except (UnicodeDecodeError, yaml.YAMLError):
        return {}
    stages = content.get("stages") if isinstance(content, dict) else None
    return stages if isinstance(stages, dict) else {}
