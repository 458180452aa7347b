"""Reads DVC's own files as one: those in the root and those of each folder dag/STAGE."""

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
    def entries(self) -> dict[str, dict[str, Any]]:
        """Each recorded output's path, with the entry of the stage that wrote it.

        The stage's name is in it as "stage".
        """
        return {
            out["path"]: {"stage": name, **entry}
            for name, entry in self.stages.items()
            for out in entry.get("outs", ())
        }

    def entry(self, path: Path) -> dict[str, Any] | None:
        """The entry of the stage that wrote `path` or the nearest folder around it, else None."""
        candidates = (folder.as_posix() for folder in (path, *path.parents))
        return next(
            (self.entries[candidate] for candidate in candidates if candidate in self.entries), None
        )

    def of(self, path: str) -> tuple[str, str]:
        """md5 and stage of an artifact, or of the nearest folder around it; empty if unknown."""
        entry = self.entry(Path(path)) or {}
        containing = {path, *map(str, Path(path).parents)}
        return next(
            (
                (out.get("md5", ""), entry["stage"])
                for out in entry.get("outs", ())
                if out["path"] in containing
            ),
            ("", ""),
        )

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

    Of parts the first.
    """
    parsed = [
        yaml.load(path.read_text(encoding="utf-8"), Yaml) for path in files(root / "dvc.yaml")
    ]
    return {
        "stages": {
            name: body for content in reversed(parsed) for name, body in content["stages"].items()
        }
    }


@lru_cache(maxsize=64)
def _stages(path: Path, written_ns: int) -> dict[str, Any]:
    """The entries of one lock file as it was written at that time; none of an unreadable one."""
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Yaml)
    except (UnicodeDecodeError, yaml.YAMLError):
        return {}
    stages = content.get("stages") if isinstance(content, dict) else None
    return stages if isinstance(stages, dict) else {}
