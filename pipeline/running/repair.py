"""Repairs DVC's own files after a kill or an earlier version of yearloc."""

import shutil
from pathlib import Path
from typing import Any

import yaml

from pipeline.running.at_work import TABLE, has_holders
from pipeline.running.dvc_files import Yaml, files

EMPTY = "schema: '2.0'\n"
"""A lock file that records nothing: DVC then finds its finished stages in its run cache."""


def repair(root: Path) -> list[Path]:
    """Empty the lock files that a kill tore, and return them.

    DVC writes these in place. The table of locks is removed if none of its holders lives.
    """
    move_old_locks(root)
    torn = [lock for lock in files(root / "dvc.lock") if not isinstance(_parsed(lock), dict)]
    for lock in torn:
        lock.write_text(EMPTY, encoding="utf-8")
    table = root / TABLE
    if table.is_file() and not has_holders(root):
        table.unlink()
    return torn


def move_old_locks(root: Path) -> None:
    """Move the lock files of an older clone from .dvc/locks to beside their dvc.yaml."""
    old_locks = root / ".dvc/locks"
    for lock in old_locks.glob("*.lock"):
        folder = root if lock.stem == "root" else root / "dag" / lock.stem
        new_lock = folder / "dvc.lock"
        if new_lock.is_symlink():
            new_lock.unlink()
        if not new_lock.exists() and (folder / "dvc.yaml").is_file():
            lock.replace(new_lock)
    if old_locks.is_dir() and not any(old_locks.glob("*.lock")):
        shutil.rmtree(old_locks)


def _parsed(path: Path) -> Any:
    try:
        return yaml.load(path.read_text(encoding="utf-8"), Yaml)
    except (ValueError, yaml.YAMLError):
        return None
