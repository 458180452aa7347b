"""Checks, before the work starts, that a command will be able to write its output."""

import os
from pathlib import Path
from tempfile import TemporaryFile

from pipeline.core.errors import ConfigError


def check_file(out: Path | None, is_written_whole: bool = True) -> None:
    """Raise ConfigError if the output file `out` cannot be written; None is standard output.

    A file that is written whole is written beside its path and moved there at the end, so `out`
    must be a plain file. Otherwise lines are written as they come, so `out` may be a device or a
    pipe.
    """
    if out is None:
        return
    _check_parent(out)
    if out.is_dir():
        raise ConfigError(f"{out}: is a folder, expected a file")
    if is_written_whole and out.exists() and not out.is_file():
        raise ConfigError(f"{out}: is not a regular file")
    if not is_written_whole and out.exists():
        if not os.access(out, os.W_OK):
            raise ConfigError(f"{out}: cannot be written (permission denied)")
        return
    _try_folder(out, out.parent)


def check_folder(out: Path) -> None:
    """Raise ConfigError if the output folder `out` cannot be made or written to."""
    _check_parent(out)
    if out.exists() and not out.is_dir():
        raise ConfigError(f"{out}: is a file, expected a folder")
    _try_folder(out, out if out.is_dir() else out.parent)


def _check_parent(out: Path) -> None:
    if not out.parent.is_dir():
        raise ConfigError(f"{out}: no folder {out.parent}")


def _try_folder(out: Path, folder: Path) -> None:
    """Raise ConfigError, which names `out`, unless a file can be written into the folder."""
    try:
        with TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise ConfigError(f"{out}: cannot be written ({str(error.strerror).lower()})") from None
