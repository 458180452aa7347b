"""Tells whether DVC works in a project just now, by DVC's own locks.

Between two stages DVC holds a lock file. While a stage runs, a table names the processes that read
or write its files.
"""

import fcntl
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil

from pipeline.core.errors import ConfigError

TABLE = ".dvc/tmp/rwlock"
"""The table: which process reads or writes which file."""
LOCK = ".dvc/tmp/lock"
"""The lock file, which DVC holds while it works and no stage runs."""


def refuse_at_work(root: Path) -> None:
    """Raise ConfigError if DVC works in the project whose folder is `root`.

    Commands that would change the studies call this: a `dvc repro` must end with those that it
    began with.
    """
    if _is_held(root / LOCK) or has_holders(root):
        raise ConfigError(
            "`dvc` works in this folder, and nothing was changed: wait until it ends, or end it"
        )


def has_holders(root: Path) -> bool:
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
    """Whether a process runs, and did so at `time_s`, in seconds since 1970.

    If it began later, its id belonged to another process then. A killed process for which nobody
    has waited yet does not run.
    """
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
