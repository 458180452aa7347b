"""Finds out whether DVC works in a project just now, and repairs its files after a kill.

Between two stages DVC holds a lock file. While a stage runs, a table names the processes that read
or write its files.
"""

import fcntl
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import yaml

from pipeline.core.errors import ConfigError
from pipeline.running.dvc_files import Yaml, files

TABLE = ".dvc/tmp/rwlock"
"""The table: which process reads or writes which file."""
LOCK = ".dvc/tmp/lock"
"""The lock file, which DVC holds while it works and no stage runs."""
EMPTY_LOCK = "schema: '2.0'\n"
"""A dvc.lock that records nothing: DVC then finds the finished stages in its run cache."""


def refuse_at_work(root: Path) -> None:
    """Raise ConfigError if DVC works in the project whose folder is `root`.

    Commands that would change the studies call this: a `dvc repro` must end with those that it
    began with.
    """
    if _is_held(root / LOCK) or _has_holders(root):
        raise ConfigError(
            "`dvc` works in this folder, and nothing was changed: wait until it ends, or end it"
        )


def repair(root: Path) -> list[Path]:
    """Empty the lock files that a kill left half written, and return their paths.

    DVC writes them in place. Its table of running processes is removed if none of them lives.
    """
    _move_old_locks(root)
    half_written = [lock for lock in files(root / "dvc.lock") if not _is_whole(lock)]
    for lock in half_written:
        lock.write_text(EMPTY_LOCK, encoding="utf-8")
    table = root / TABLE
    if table.is_file() and not _has_holders(root):
        table.unlink()
    return half_written


def _move_old_locks(root: Path) -> None:
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


def _is_whole(lock: Path) -> bool:
    """Whether a lock file is a yaml table, and not cut off in the middle."""
    try:
        return isinstance(yaml.load(lock.read_text(encoding="utf-8"), Yaml), dict)
    except (ValueError, yaml.YAMLError):
        return False


def _has_holders(root: Path) -> bool:
    """Whether a process in DVC's table lives; False if the table is missing or unreadable."""
    table = root / TABLE
    try:
        written_s = table.stat().st_mtime
        content = json.loads(table.read_text(encoding="utf-8"))
        return any(_has_lived_since(pid, written_s) for pid in _pids(content))
    except (OSError, ValueError):
        return False


def _pids(node: Any) -> Iterator[int]:
    """The ids of all processes that a part of the table names."""
    if isinstance(node, list):
        for item in node:
            yield from _pids(item)
    elif isinstance(node, dict):
        if isinstance(node.get("pid"), int):
            yield node["pid"]
        else:
            yield from _pids(list(node.values()))


def _has_lived_since(pid: int, time_s: float) -> bool:
    """Whether a process runs, and did so at `time_s`, in seconds since 1970."""
    # a younger process got the id of one that has ended; a zombie does not run
    try:
        process = psutil.Process(pid)
        return bool(process.status() != psutil.STATUS_ZOMBIE and process.create_time() <= time_s)
    except psutil.NoSuchProcess:
        return False


def _is_held(lock: Path) -> bool:
    """Whether a process holds a lock file. The system frees it when that process ends."""
    try:
        with lock.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # the file is missing, or its file system has no locks
        return False
    return False
