"""What stands above an artifact's arrays, as each kind of artifact fills it in."""

from dataclasses import dataclass

from pipeline.inspection.inspection import Section


@dataclass(frozen=True)
class Highlights:
    """What stands above the arrays, and what is wrong."""

    sections: tuple[Section, ...] = ()
    warnings: tuple[str, ...] = ()
