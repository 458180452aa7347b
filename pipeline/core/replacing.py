"""Writes files and folders whole or not at all.

A draft grows beside its final path, under a scratch name, and is fsynced and renamed into place
when it is done. A kill therefore leaves the old file, the new one or none, never half of one. It
may also leave the scratch, which the next writer of the same path removes.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil


@contextmanager
def replace(path: str | Path) -> Iterator[Path]:
    """Yield a fresh scratch path, which takes the place of `path` if the block raises nothing."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    _remove_old_scratches(path)
    scratch = path.with_name(f".{path.name}.{os.getpid()}.scratch")
    try:
        yield scratch
        _fsync(scratch)
        if scratch.is_dir() or path.is_dir():  # no folder can take another's place at once
            _remove(path)
        scratch.replace(path)
        _fsync_one(path.parent)
    finally:
        # after Ctrl-C another thread may still write into it; the next writer removes it
        with suppress(OSError):
            _remove(scratch)


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, whole or not at all."""
    with replace(path) as scratch:
        scratch.write_text(text, encoding="utf-8")


def _remove_old_scratches(path: Path) -> None:
    """Remove the scratches that killed writers of `path` left behind."""
    for scratch in path.parent.glob(f".{path.name}.*.scratch"):
        writer = scratch.name.removeprefix(f".{path.name}.").removesuffix(".scratch")
        if writer.isdigit() and not _is_writing(int(writer), scratch):
            _remove(scratch)


def _is_writing(pid: int, scratch: Path) -> bool:
    """Whether another process, `pid`, is alive and may be the one that writes `scratch`."""
    # a process that is younger than the scratch has only got its writer's number
    try:
        process = psutil.Process(pid)
        is_alive = process.status() != psutil.STATUS_ZOMBIE
        is_older = process.create_time() <= scratch.lstat().st_ctime
    except psutil.NoSuchProcess:
        return False
    return is_alive and is_older and pid != os.getpid()


def _remove(path: Path) -> None:
    """Remove a file, a link or a whole folder, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _fsync(path: Path) -> None:
    """Flush a file, or a folder with all that it holds, to the disk."""
    if not path.is_dir():
        _fsync_one(path)
        _fsync_one(path.parent)
        return
    for folder, _, files in os.walk(path):
        for name in files:
            _fsync_one(Path(folder, name))
        _fsync_one(Path(folder))


def _fsync_one(path: Path) -> None:
    """Flush the content of one file, or the list of names of one folder, to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
