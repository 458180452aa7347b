"""Where numba keeps compiled kernels: in NUMBA_CACHE_DIR, beside the source or in the user's cache
folder, as numba does it.

Where none of these can be written it is a temporary folder of this user, and where that cannot be
either, they are not kept.
"""

import os
import stat
import sys
import tempfile
from pathlib import Path

GIVEN = "NUMBA_CACHE_DIR"
SOURCE = Path(__file__).parent
LOOKED_AT = "views"
"""The package whose kernels every first scan needs."""


def settle() -> str:
    """Let numba find a folder that can be written; returns it where it is a temporary one,
    "nowhere", or nothing.

    To be called before the first kernel is defined.
    """
    if any(_writable(folder) for folder in _usual()):
        return ""
    if folder := _temporary():
        os.environ[GIVEN] = folder
        if numba := sys.modules.get("numba"):  # has read it already
            numba.config.CACHE_DIR = folder
        return folder
    from numba.core.dispatcher import Dispatcher

    # else `cache=True` is an error
    Dispatcher.enable_caching = lambda self: None  # type: ignore[method-assign]
    return "nowhere"


def cold() -> bool:
    """Whether the kernels of a scan are still to be compiled: none is kept, or the source is
    newer."""
    folders = [SOURCE / LOOKED_AT / "__pycache__"]
    for folder in (os.environ.get(GIVEN), str(_user())):
        folders += Path(folder).glob(f"{LOOKED_AT}_*") if folder else ()
    kept = [file.stat().st_mtime for folder in folders for file in folder.glob("*.nbi")]
    return max(kept, default=0.0) < max(
        file.stat().st_mtime for file in (SOURCE / LOOKED_AT).glob("*.py")
    )


def _usual() -> list[Path]:
    given = os.environ.get(GIVEN)
    return [*([Path(given)] if given else []), SOURCE / "__pycache__", _user()]


def _user() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser(), "numba")


def _writable(folder: Path) -> bool:
    """Whether it can be written, or made."""
    there = next(
        parent for parent in (folder.absolute(), *folder.absolute().parents) if parent.exists()
    )
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)


def _temporary() -> str:
    """A temporary folder that nobody else can write to, as what is kept there is run; nothing where
    there is none."""
    try:
        folder = Path(tempfile.gettempdir(), f"yearloc-kernels-{os.getuid()}")
        folder.mkdir(0o700, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return ""
    own = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o077
    return str(folder) if own else ""
