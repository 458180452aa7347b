"""DVC's own files, read as one: dvc.yaml and dvc.lock in the root, and those of each folder
dag/STAGE."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Self

import yaml

from pipeline.running.texts import LOADER


class Yaml(LOADER):  # type: ignore[misc]
    """Reads numbers as DVC writes them: 2e-05 is one in YAML 1.2, which PyYAML takes for a word."""


Yaml.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+$"), list("-+0123456789")
)


@dataclass(frozen=True)
class DvcLock:
    """All that the lock files record; empty where there is none, or none that can be read."""

    stages: Mapping[str, Mapping[str, Any]]
    """Stage, such as train@campus-10m-sci, to its cmd, deps, params and outs; paths are relative to
    the root."""

    @classmethod
    def read(cls, front: Path) -> Self:
        """Those of `front`, the root's dvc.lock, and of the folders of dag/ beside it."""
        return cls(
            {
                name: stage
                for path in files(front)
                for name, stage in _stages(path, path.stat().st_mtime_ns).items()
            }
        )

    @cached_property
    def entries(self) -> dict[str, dict[str, Any]]:
        """Each recorded output's path to the entry of the stage that wrote it, with its name as
        "stage"."""
        return {
            out["path"]: {"stage": name, **entry}
            for name, entry in self.stages.items()
            for out in entry.get("outs", ())
        }

    def entry(self, path: Path) -> dict[str, Any] | None:
        """The entry of the stage that wrote `path` or the nearest folder around it; None where none
        is recorded."""
        around = (one.as_posix() for one in (path, *path.parents))
        return next((self.entries[one] for one in around if one in self.entries), None)

    def of(self, path: str) -> tuple[str, str]:
        """The md5 and the stage of an artifact, or of the nearest folder around it; empty where it
        is unknown."""
        found = self.entry(Path(path)) or {}
        around = {path, *map(str, Path(path).parents)}
        return next(
            (
                (out.get("md5", ""), found["stage"])
                for out in found.get("outs", ())
                if out["path"] in around
            ),
            ("", ""),
        )

    def params(self, stage: str) -> Mapping[str, Any]:
        """The parameters of a stage, by file."""
        found: Mapping[str, Any] = self.stages.get(stage, {}).get("params", {})
        return found


def files(front: Path) -> list[Path]:
    """The root's file of this name (dvc.lock or dvc.yaml) and those of dag/STAGE/ beside it, as far
    as they are there."""
    return [
        path
        for path in (front, *sorted(front.parent.glob(f"dag/*/{front.name}")))
        if path.is_file()
    ]


def definition(root: Path) -> dict[str, Any]:
    """The stages of dvc.yaml and of each dag/STAGE/dvc.yaml, as parsed: {"stages": {name: body}};
    of parts the first."""
    parsed = [
        yaml.load(path.read_text(encoding="utf-8"), Yaml) for path in files(root / "dvc.yaml")
    ]
    return {
        "stages": {name: body for one in reversed(parsed) for name, body in one["stages"].items()}
    }


@lru_cache(maxsize=64)
def _stages(path: Path, written_ns: int) -> dict[str, Any]:
    """The entries of one lock file as it was written at that time; none of one that a kill has
    torn."""
    try:
        found = yaml.load(path.read_text(encoding="utf-8"), Yaml)
    except (UnicodeDecodeError, yaml.YAMLError):
        return {}
    stages = found.get("stages") if isinstance(found, dict) else None
    return stages if isinstance(stages, dict) else {}
