"""Every error this project raises on purpose, each a single line that says which file or value, and what to do.

YearlocError
├── InputError      an array or number handed to the library is not what its docstring asks for
├── ConfigError     a value in conf/ or on the command line
│   └── NotInstalledError   a package of an extra that is needed here
├── ComputeError    workers that compute blocks ended, or cannot be had
├── LogError        a raw log: a missing file, a truncated record, stamps out of order
└── ArtifactError   an artifact on disk is not what its reader expects
"""


class YearlocError(Exception):
    """Base class: a stage that meets one prints its line and exits with code 1."""


class InputError(YearlocError):
    """An array or number handed to the library is not what its docstring asks for."""


class ConfigError(YearlocError):
    """A value in conf/ or on the command line is wrong."""


class NotInstalledError(ConfigError):
    """A package that only some work needs is not installed; the message has the command that installs it."""


class ComputeError(YearlocError):
    """Workers that compute blocks ended, or cannot be had."""


class LogError(YearlocError):
    """A raw log lacks a file, or a file in it cannot be what its format says."""


class ArtifactError(YearlocError):
    """An artifact on disk is missing, or is not what its reader expects."""
