"""The errors that this project raises on purpose.

The message of each is a single line that says which file or value is wrong, and what to do.

YearlocError
├── InputError      an array or number handed to the library is not what its docstring asks for
├── ConfigError     a value in conf/ or on the command line
│   └── NotInstalledError   a package of an extra that is needed here
├── ComputeError    workers that compute blocks ended, or cannot be had
├── LogError        a raw log: a missing file, a truncated record, stamps out of order
└── ArtifactError   an artifact on disk is not what its reader expects
"""

import errno
from collections.abc import Iterator
from contextlib import contextmanager

MACHINE_ERRNOS = {
    getattr(errno, name)
    for name in (
        "EACCES",
        "EDQUOT",
        "EFBIG",
        "EIO",
        "EMFILE",
        "ENAMETOOLONG",
        "ENFILE",
        "ENOMEM",
        "ENOSPC",
        "EPERM",
        "EROFS",
    )
    if hasattr(errno, name)
}
"""Error numbers of a machine that refuses: a full disk, no permission, a medium that fails.

These are no bugs of this project, so they too are printed as one line, not as a traceback.
"""


def machine_refusal(error: BaseException) -> str:
    """One line on what the machine refused, with the file; empty for any other error."""
    if isinstance(error, MemoryError):
        return "not enough memory: fewer workers or a smaller view need less"
    if isinstance(error, OSError) and error.errno in MACHINE_ERRNOS:
        place = error.filename or "a file"
        return f"{place}: {str(error.strerror).lower()}; fix that and run it again"
    return ""


class YearlocError(Exception):
    """Base class: a stage that meets one prints its line and exits with code 1."""


class InputError(YearlocError):
    """An array or number handed to the library is not what its docstring asks for."""


class ConfigError(YearlocError):
    """A value in conf/ or on the command line is wrong."""


class NotInstalledError(ConfigError):
    """A package that only some work needs is not installed; the message says how to install it."""


@contextmanager
def needed(extra: str, size: str = "") -> Iterator[None]:
    """Import the packages of an extra in here; raises NotInstalledError if one is missing.

    `size` says what the extra takes up on disk, such as 36 MB.
    """
    try:
        yield
    except ImportError as error:
        on_disk = f" ({size})" if size else ""
        raise NotInstalledError(
            f"{error.name}: not installed; `pip install 'yearloc[{extra}]'`{on_disk}"
        ) from None


class ComputeError(YearlocError):
    """Workers that compute blocks ended, or cannot be had."""


class LogError(YearlocError):
    """A raw log lacks a file, or a file in it cannot be what its format says."""


class ArtifactError(YearlocError):
    """An artifact on disk is missing, or is not what its reader expects."""
