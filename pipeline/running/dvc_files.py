"""Reads DVC's own files: dvc.lock and dvc.yaml of the root and of each folder dag/STAGE, as one."""

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
    """Empty where none is recorded."""
    size: int | None
    """Bytes of the file, or of all files of the folder; None where it is not recorded."""
    file_count: int
    """1 of a file."""
    is_folder: bool

    @classmethod
    def of(cls, recorded: Mapping[str, Any]) -> Self:
        """Read an entry of deps or outs."""
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
    deps: tuple[LockedFile, ...]
    params: Mapping[str, Mapping[str, Any]]
    """File of conf/ to the values of its keys."""
    outs: tuple[LockedFile, ...]

    @classmethod
    def of(cls, stage: str, recorded: Mapping[str, Any]) -> Self:
        """Read the entry of a stage."""
        return cls(
            stage=stage,
            command=str(recorded.get("cmd", "")),
            deps=tuple(map(LockedFile.of, recorded.get("deps") or ())),
            params=recorded.get("params") or {},
            outs=tuple(map(LockedFile.of, recorded.get("outs") or ())),
        )


@dataclass(frozen=True)
class DvcLock:
    """All that the lock files record; empty without readable ones."""

    stages: Mapping[str, Mapping[str, Any]]
    """Stage, such as train@campus-10m-sci, to its cmd, deps, params and outs; paths are relative to
    the root."""

    @classmethod
    def read(cls, front: Path) -> Self:
        """Read `front`, the root's dvc.lock, and those of the folders of dag/ beside it."""
        return cls(
            {
                name: stage
                for path in files(front)
                for name, stage in _stages(path, path.stat().st_mtime_ns).items()
            }
        )

    @cached_property
    def entries(self) -> dict[str, LockEntry]:
        """The path of each recorded output, with the entry of the stage that wrote it."""
        entries = (LockEntry.of(stage, recorded) for stage, recorded in self.stages.items())
        return {out.path: entry for entry in entries for out in entry.outs}

    def entry(self, path: Path) -> LockEntry | None:
        """The entry of the stage that wrote `path` or the nearest folder around it, else None."""
        candidates = (folder.as_posix() for folder in (path, *path.parents))
        return next(
            (self.entries[candidate] for candidate in candidates if candidate in self.entries), None
        )

    def of(self, path: str) -> tuple[str, str]:
        """md5 and stage of an artifact, or of the nearest folder around it; empty if unknown."""
        entry = self.entry(Path(path))
        if entry is None:
            return "", ""
        containing = {path, *map(str, Path(path).parents)}
        md5 = next((out.md5 for out in entry.outs if out.path in containing), "")
        return md5, entry.stage

    def params(self, stage: str) -> Mapping[str, Any]:
        """The parameters of a stage, by file."""
        params: Mapping[str, Any] = self.stages.get(stage, {}).get("params", {})
        return params


def files(front: Path) -> list[Path]:
    """The existing files of this name (dvc.lock or dvc.yaml) in the root and in dag/STAGE/."""
    return [
        path
        for path in (front, *sorted(front.parent.glob(f"dag/*/{front.name}")))
        if path.is_file()
    ]


def definition(root: Path) -> dict[str, Any]:
    """The stages of all dvc.yaml files, as parsed: {"stages": {name: body}}.

    Of a stage that is split into parts (`studies.parts`) it is the first part.
    """
    stages: dict[str, Any] = {}
    for path in files(root / "dvc.yaml"):
        content = yaml.load(path.read_text(encoding="utf-8"), Yaml)
        stages = {**content["stages"], **stages}
    return {"stages": stages}


@lru_cache(maxsize=64)
def _stages(path: Path, written_ns: int) -> dict[str, Any]:
    """The entries of one lock file as it was written at that time; none of an unreadable one."""
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Yaml)
    except (UnicodeDecodeError, yaml.YAMLError):
        return {}
    stages = content.get("stages") if isinstance(content, dict) else None
    return stages if isinstance(stages, dict) else {}
