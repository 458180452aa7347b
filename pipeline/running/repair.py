"""Puts right what a kill may leave of DVC's own files, which it writes in place."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import yaml

from pipeline.running.dvc_files import files


def repair() -> Iterator[str]:
    """Remove torn lock files and the table of locks whose holders are dead; yields a line for each lock file.

    Without a lock file, DVC finds finished stages in its run cache.
    """
    table = Path(".dvc/tmp/rwlock")
    for lock in files(Path("dvc.lock")):
        if not isinstance(_parsed(lock, yaml.safe_load), dict):
            lock.unlink()
            yield f"{lock}: was torn by a kill, removed; what is finished comes back from DVC's cache"
    if table.is_file() and not any(map(_alive, _holders(_parsed(table, json.loads)))):
        table.unlink()


def _parsed(path: Path, parse: Callable[[str], Any]) -> Any:
    try:
        return parse(path.read_text())
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
