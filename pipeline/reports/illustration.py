"""A figure as a report shows it."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Illustration:
    """One figure file of the report."""

    kind: str
    """A key of the report's words on how to read it."""
    path: str
    """Relative to the report."""
    title: str
