"""Whether DVC works in a project, by DVC's own locks.

A lock file between stages, a table of holders while one runs.
"""

import fcntl
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil

from pipeline.core.errors import ConfigError

TABLE = ".dvc/tmp/rwlock"
"""Which process reads or writes which output."""
LOCK = ".dvc/tmp/lock"
"""Held by DVC whenever none of its stages runs."""


def refuse_at_work(root: Path) -> None:
    """Raise ConfigError if DVC works in the project.

    What it has begun must end with the studies that it began with.
    """
    if _is_held(root / LOCK) or has_holders(root):
        raise ConfigError(
            "`dvc` works in this folder, and nothing was changed: wait until it ends, or end it"
        )


def has_holders(root: Path) -> bool:
    """Whether a process in DVC's table of locks lives; an unreadable table names none."""
    table = root / TABLE
    try:
        written_s = table.stat().st_mtime
        return any(
            _lived(pid, written_s) for pid in _pids(json.loads(table.read_text(encoding="utf-8")))
        )
    except (OSError, ValueError):
        return False


def _pids(node: Any) -> Iterator[int]:
    """Every process that a part of the table names."""
    if isinstance(node, list):
        for item in node:
            yield from _pids(item)
    elif isinstance(node, dict):
        if isinstance(node.get("pid"), int):
            yield node["pid"]
        else:
            yield from _pids(list(node.values()))


def _lived(pid: int, time_s: float) -> bool:
    """Whether a process runs and did so at a time in seconds since 1970.

    A killed one that nobody has waited for yet does not.
    """
    try:
        process = psutil.Process(pid)
        return bool(process.status() != psutil.STATUS_ZOMBIE and process.create_time() <= time_s)
    except psutil.NoSuchProcess:
        return False


def _is_held(lock: Path) -> bool:
    """Whether a process holds a lock file; a killed process holds none."""
    try:
        with lock.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # not there, or on a file system that locks nothing
        return False
    return False
