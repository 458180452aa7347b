"""Repairs DVC's own files after a kill, and moves those of an earlier version of yearloc."""

import shutil
from pathlib import Path
from typing import Any

import yaml

from pipeline.running.at_work import TABLE, has_holders
from pipeline.running.dvc_files import Yaml, files

EMPTY_LOCK = "schema: '2.0'\n"
"""A lock file that records nothing: DVC then finds the finished stages in its run cache."""


def repair(root: Path) -> list[Path]:
    """Empty the lock files that a kill left half written, and return their paths.

    DVC writes them in place. Its table of running processes is removed if none of them lives.
    """
    move_old_locks(root)
    half_written = [
        lock for lock in files(root / "dvc.lock") if not isinstance(_parsed(lock), dict)
    ]
    for lock in half_written:
        lock.write_text(EMPTY_LOCK, encoding="utf-8")
    table = root / TABLE
    if table.is_file() and not has_holders(root):
        table.unlink()
    return half_written


def move_old_locks(root: Path) -> None:
    """Move the lock files of an older clone from .dvc/locks beside their dvc.yaml files."""
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
    """The content of a yaml file; None if it is no yaml."""
    try:
        return yaml.load(path.read_text(encoding="utf-8"), Yaml)
    except (ValueError, yaml.YAMLError):
        return None
