"""Chooses the folder where numba keeps compiled kernels, so that they are compiled only once.

numba itself takes the folder NUMBA_CACHE_DIR, or one beside the source, or the user's cache folder.
If it can write none of them, this module gives it a temporary folder of this user. If there is none
either, kernels are not kept, and are compiled at every start.
"""

import os
import stat
import sys
import tempfile
from pathlib import Path
from typing import Any

CACHE_VARIABLE = "NUMBA_CACHE_DIR"
"""The environment variable by which numba is given a folder."""
SOURCE = Path(__file__).parent
"""The folder of the library's source."""


def choose_folder() -> str:
    """Point numba to a folder that can be written, before the first kernel is defined.

    Returns the folder if it is a temporary one, "nowhere" if there is none, and an empty string if
    numba finds a folder by itself.
    """
    if any(_is_writable(folder) for folder in _folders_of_numba()):
        return ""
    if folder := _temporary_folder():
        os.environ[CACHE_VARIABLE] = folder
        if numba := sys.modules.get("numba"):  # it has read the variable already
            numba.config.CACHE_DIR = folder
        return folder
    from numba.core.dispatcher import Dispatcher

    # without this, a kernel with `cache=True` raises an error
    Dispatcher.enable_caching = lambda self: None  # type: ignore[method-assign]
    return "nowhere"


def cold(kernel: Any) -> bool:
    """Whether a numba kernel must still be compiled on this machine.

    It need not be if numba's index lists it as compiled for this processor from the present source.
    """
    try:
        # numba has no public way to ask; the index of its file names the processor of each entry
        file = getattr(kernel._cache, "_cache_file", None)
        compiled_for = {processor for _, processor, _ in file._load_index()} if file else set()
        return kernel.targetctx.codegen().magic_tuple() not in compiled_for
    except AttributeError:  # NUMBA_DISABLE_JIT compiles nothing; or this numba differs inside
        return False


def _folders_of_numba() -> list[Path]:
    """The folders that numba tries by itself."""
    folders = [SOURCE / "__pycache__", _user_folder()]
    if configured := os.environ.get(CACHE_VARIABLE):
        folders.insert(0, Path(configured))
    return folders


def _user_folder() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser(), "numba")


def _is_writable(folder: Path) -> bool:
    """Whether a folder can be written to, or can be made."""
    path = folder.absolute()
    existing = next(parent for parent in (path, *path.parents) if parent.exists())
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def _temporary_folder() -> str:
    """A temporary folder that only this user can write to; an empty string if there is none.

    The kernels in it are run, so nobody else may put one there.
    """
    try:
        folder = Path(tempfile.gettempdir(), f"yearloc-kernels-{os.getuid()}")
        folder.mkdir(0o700, exist_ok=True)
        status = folder.lstat()
    except OSError:
        return ""
    is_private = (
        stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077
    )
    return str(folder) if is_private else ""
