"""Files and folders that are written whole or not at all.

A draft grows in a scratch sibling, is fsynced and renamed into place, so a kill leaves either the
old one, the new one or none, and a scratch sibling that the next draft of the same path removes.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil


@contextmanager
def replace(path: str | Path) -> Iterator[Path]:
    """Give a fresh scratch path that takes the place of `path`, fsynced, if the block ends well."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    _sweep(path)
    scratch = path.with_name(f".{path.name}.{os.getpid()}.scratch")
    try:
        yield scratch
        _fsync(scratch)
        if scratch.is_dir() or path.is_dir():  # no folder can take another's place at once
            _remove(path)
        scratch.replace(path)
        _fsync_one(path.parent)
    finally:
        # after Ctrl-C another thread may still write into it; the next writer sweeps it
        with suppress(OSError):
            _remove(scratch)


def _sweep(path: Path) -> None:
    """Remove the scratch siblings that killed writers of `path` left."""
    for scratch in path.parent.glob(f".{path.name}.*.scratch"):
        writer = scratch.name.removeprefix(f".{path.name}.").removesuffix(".scratch")
        if writer.isdigit() and not _writing(int(writer), scratch):
            _remove(scratch)


def _writing(pid: int, scratch: Path) -> bool:
    """Whether the process `pid` lives and may be the one that writes `scratch`.

    It must be no zombie, and older than the scratch path.
    """
    try:
        process = psutil.Process(pid)
        alive = (
            process.status() != psutil.STATUS_ZOMBIE
            and process.create_time() <= scratch.lstat().st_ctime
        )
    except psutil.NoSuchProcess:
        return False
    return alive and pid != os.getpid()


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _fsync(path: Path) -> None:
    for folder, _, files in (
        os.walk(path) if path.is_dir() else [(str(path.parent), [], [path.name])]
    ):
        for name in files:
            _fsync_one(Path(folder, name))
        _fsync_one(Path(folder))


def _fsync_one(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
