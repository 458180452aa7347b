"""What a kill or an earlier version of yearloc left of DVC's own files, put right."""

import json
import shutil
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

    DVC writes these in place.
    """
    bring_over(root)
    torn = [lock for lock in files(root / "dvc.lock") if not isinstance(_parsed(lock, _yaml), dict)]
    for lock in torn:
        lock.write_text(EMPTY, encoding="utf-8")
    table = root / ".dvc/tmp/rwlock"
    if table.is_file() and not any(map(_alive, _holders(_parsed(table, json.loads)))):
        table.unlink()
    return torn


def bring_over(root: Path) -> None:
    """Move the lock files of an older clone, which lay in .dvc/locks, to beside their dvc.yaml, where DVC wants them."""
    old = root / ".dvc/locks"
    for lock in old.glob("*.lock"):
        folder = root if lock.stem == "root" else root / "dag" / lock.stem
        beside = folder / "dvc.lock"
        if beside.is_symlink():
            beside.unlink()
        if not beside.exists() and (folder / "dvc.yaml").is_file():
            lock.replace(beside)
    if old.is_dir() and not any(old.glob("*.lock")):
        shutil.rmtree(old)


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
