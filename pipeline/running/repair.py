"""What a kill may leave of DVC's own files, put right."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import yaml

from pipeline.running.dvc_files import Yaml, files

EMPTY = "schema: '2.0'\n"
"""A lock file that records nothing: DVC then finds its finished stages in its run cache."""


def repair(root: Path) -> list[Path]:
    """Empty the lock files that a kill tore, and return them; remove the table of locks if none of its holders lives.

    DVC writes these in place. The project's lock files are links into .dvc/locks, which git ignores; a fresh clone has links
    alone, and the files that they name are written here.
    """
    torn = [lock for lock in files(root / "dvc.lock") if not isinstance(_parsed(lock, _yaml), dict)]
    for lock in torn:
        lock.resolve().write_text(EMPTY, encoding="utf-8")
    add_missing_locks(root)
    table = root / ".dvc/tmp/rwlock"
    if table.is_file() and not any(map(_alive, _holders(_parsed(table, json.loads)))):
        table.unlink()
    return torn


def add_missing_locks(root: Path) -> None:
    """Write the lock files that a fresh clone's links name: DVC refuses a link that leads nowhere."""
    for link in (path.with_name("dvc.lock") for path in files(root / "dvc.yaml")):
        if link.is_symlink() and not link.exists():
            path = link.resolve()
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(EMPTY, encoding="utf-8")


def _yaml(text: str) -> Any:
    return yaml.load(text, Yaml)


def _parsed(path: Path, parse: Callable[[str], Any]) -> Any:
    try:
        return parse(path.read_text(encoding="utf-8"))
    except (ValueError, yaml.YAMLError):
        return None


def _holders(node: Any) -> list[int]:
    """Every pid in DVC's table of locks."""
    if isinstance(node, list):
        return [pid for item in node for pid in _holders(item)]
    if isinstance(node, dict):
        return [node["pid"]] if isinstance(node.get("pid"), int) else _holders(list(node.values()))
    return []


def _alive(pid: int) -> bool:
    """Whether a process runs; a killed one that nobody has waited for yet does not."""
    try:
        return bool(psutil.Process(pid).status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False
