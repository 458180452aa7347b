"""What a kill or an earlier version of yearloc left of DVC's own files, put right."""

import shutil
from pathlib import Path
from typing import Any

import yaml

from pipeline.running.at_work import TABLE, has_holders
from pipeline.running.dvc_files import Yaml, files

EMPTY = "schema: '2.0'\n"
"""A lock file that records nothing: DVC then finds its finished stages in its run cache."""


def repair(root: Path) -> list[Path]:
    """Empty the lock files that a kill tore, and return them; remove the table of locks if none of
    its holders lives.

    DVC writes these in place.
    """
    bring_over(root)
    torn = [lock for lock in files(root / "dvc.lock") if not isinstance(_parsed(lock), dict)]
    for lock in torn:
        lock.write_text(EMPTY, encoding="utf-8")
    table = root / TABLE
    if table.is_file() and not has_holders(root):
        table.unlink()
    return torn


def bring_over(root: Path) -> None:
    """Move the lock files of an older clone, which lay in .dvc/locks, to beside their dvc.yaml,
    where DVC wants them."""
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


def _parsed(path: Path) -> Any:
    try:
        return yaml.load(path.read_text(encoding="utf-8"), Yaml)
    except (ValueError, yaml.YAMLError):
        return None
