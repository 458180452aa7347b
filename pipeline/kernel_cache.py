"""Chooses the folder where numba keeps compiled kernels.

It is NUMBA_CACHE_DIR, beside the source or in the user's cache folder, as numba does it. Where none
of these can be written it is a temporary folder of this user, and where that cannot be either, they
are not kept.
"""

import os
import stat
import sys
import tempfile
from pathlib import Path
from typing import Any

CACHE_VARIABLE = "NUMBA_CACHE_DIR"
SOURCE = Path(__file__).parent


def settle() -> str:
    """Point numba to a folder that can be written; called before the first kernel is defined.

    Returns that folder if it is a temporary one, "nowhere" if there is none, else an empty string.
    """
    if any(_is_writable(folder) for folder in _usual_folders()):
        return ""
    if folder := _temporary_folder():
        os.environ[CACHE_VARIABLE] = folder
        if numba := sys.modules.get("numba"):  # has read it already
            numba.config.CACHE_DIR = folder
        return folder
    from numba.core.dispatcher import Dispatcher

    # else `cache=True` is an error
    Dispatcher.enable_caching = lambda self: None  # type: ignore[method-assign]
    return "nowhere"


def cold(kernel: Any) -> bool:
    """Whether a kernel is still to be compiled on this machine.

    It is unless numba's own index has it, compiled for this processor from the source as it is.
    """
    try:
        file = getattr(kernel._cache, "_cache_file", None)
        compiled_for = {processor for _, processor, _ in file._load_index()} if file else set()
        return kernel.targetctx.codegen().magic_tuple() not in compiled_for
    except AttributeError:  # nothing is compiled (NUMBA_DISABLE_JIT), or another numba's inside
        return False


def _usual_folders() -> list[Path]:
    configured = os.environ.get(CACHE_VARIABLE)
    return [*([Path(configured)] if configured else []), SOURCE / "__pycache__", _user_folder()]


def _user_folder() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser(), "numba")


def _is_writable(folder: Path) -> bool:
    """Whether a folder can be written, or made."""
    existing = next(
        parent for parent in (folder.absolute(), *folder.absolute().parents) if parent.exists()
    )
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def _temporary_folder() -> str:
    """A temporary folder that nobody else can write to, as what it holds is run.

    An empty string where there is none.
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
