"""The result of `yearloc inspect`, and its layout on a terminal.

An Inspection has a headline, sections of aligned rows, and warnings. The functions below write
numbers as people read them: bytes, lengths, durations, dates.
"""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pipeline.inspection.point_map import PointMap

SMALL_SITE_M = 60.0
"""A drive that spans less than this is in a building or a yard."""
WIDTH = 118
"""Characters of the longest line; the last cell of a row wraps below itself."""
MIN_LAST_CELL = 20
"""If fewer characters are left beside the other cells, the last cell begins below them."""
FIRST_YEAR_NS = 10**9 * 86_400 * 365
"""A stamp below this counts from the start of a clock, not from 1970."""


@dataclass(frozen=True)
class Section:
    """Rows that belong together; the cells of a column are aligned, the last one may be long.

    A row of one cell, such as a line of a proposed yaml, is never wrapped: somebody will paste it.
    """

    title: str
    rows: tuple[tuple[str, ...], ...]

    def lines(self, width: int = WIDTH) -> list[str]:
        """The title and the rows, indented by two spaces."""
        column_widths: dict[int, int] = {}
        for row in self.rows:
            for column, cell in enumerate(row[:-1]):
                column_widths[column] = max(column_widths.get(column, 0), len(cell))
        lines = [self.title] if self.title else []
        for row in self.rows:
            if len(row) == 1:
                lines.append(f"  {row[0]}".rstrip())
                continue
            prefix = "  "
            for column, cell in enumerate(row[:-1]):
                prefix += cell.ljust(column_widths[column]) + "  "
            if len(prefix) > width - MIN_LAST_CELL:
                lines += _wrapped(" ".join(row[:-1]), "  ", width)
                prefix = "    "
            lines += _wrapped(row[-1], prefix, width)
        return lines


@dataclass
class Inspection:
    """The description of a file or artifact, and warnings on what would break a study."""

    path: Path
    kind: str = ""
    """What the file is, in a few words."""
    sections: tuple[Section, ...] = ()
    warnings: tuple[str, ...] = ()
    next: str = ""
    """The command to go on with; empty if there is none."""
    point_map: "PointMap | None" = None
    """The 3-D map that was read, for a picture of it."""

    @property
    def headline(self) -> str:
        """The path and the kind."""
        return f"{self.path} — {self.kind}"

    def add(self, title: str, *rows: tuple[str, ...]) -> None:
        """Add a section; its title may be empty."""
        self.sections += (Section(title, rows),)

    def warn(self, text: str) -> None:
        """Add a warning."""
        self.warnings += (text,)

    def warn_if(self, condition: object, text: str) -> None:
        """Add a warning if the condition holds, such as a count that is not 0."""
        if condition:
            self.warn(text)

    def warn_of_small_site(
        self, xyz_m: NDArray[np.floating], axes: tuple[int, int] = (0, 1)
    ) -> None:
        """Warn if a drive spans too little for cells of 10 m and errors of 15 m.

        `xyz_m` (n, 3) are its positions, and `axes` are the two level ones among x, y and z.
        """
        if not len(xyz_m):
            return
        sides_m = np.ptp(xyz_m[:, axes], axis=0)
        self.warn_if(
            sides_m.max() < SMALL_SITE_M,
            f"small site: the drive spans {metres(sides_m[0])} × {metres(sides_m[1])}, where "
            "cells of 10 m and errors up to 15 m say little; `yearloc use … scale=indoor` takes "
            "cells of 2 m, a range of 20 m and errors up to 2 m",
        )

    def text(self, width: int = WIDTH) -> str:
        """The text in lines of at most `width`, and never more than WIDTH, characters.

        It has no final newline.
        """
        width = min(width, WIDTH)
        lines = [self.headline]
        for section in self.sections:
            lines += ["", *section.lines(width)]
        counts = {0: "no warnings", 1: "1 warning"}
        lines += ["", counts.get(len(self.warnings), f"{len(self.warnings)} warnings")]
        for warning in self.warnings:
            lines += _wrapped(warning, "  ! ", width)
        if self.next:
            lines += ["", f"next: {self.next}"]  # never wrapped: somebody will paste it
        return "\n".join(lines)


def _wrapped(text: str, prefix: str, width: int) -> list[str]:
    """The lines of a text, the first one after `prefix`, the others indented as far."""
    wrapper = textwrap.TextWrapper(
        width,
        initial_indent=prefix,
        subsequent_indent=" " * len(prefix),
        break_on_hyphens=False,
        break_long_words=False,
    )
    return wrapper.wrap(text) or [prefix.rstrip()]


def nbytes(count: int) -> str:
    """A number of bytes: 12.3 MB."""
    value = float(count)
    unit = "B"
    for larger_unit in ("kB", "MB", "GB", "TB"):
        if value < 999.5:  # from here on three digits would round to 1e+03
            break
        value = value / 1000
        unit = larger_unit
    return f"{value:.0f} {unit}" if unit == "B" else f"{value:.3g} {unit}"


def metres(length_m: float) -> str:
    """A length: 0.53 m, 12.3 m, 6.31 km."""
    if abs(length_m) >= 1000:
        return f"{length_m / 1000:.2f} km"
    return f"{length_m:.3g} m" if abs(length_m) < 100 else f"{length_m:.0f} m"


def typographic(text: str) -> str:
    """A text with numbers, in which each - becomes a minus sign, −."""
    return text.replace("-", "−")


def stamp_rows(times_s: NDArray[np.floating]) -> list[tuple[str, str]]:
    """Rows on stamps (n,) in seconds: the first one, the span and the rate."""
    if not len(times_s):
        return []
    steps_s = np.diff(times_s)
    median_s = float(np.median(steps_s)) if len(steps_s) else 0.0
    rate = "unknown"
    if median_s > 0:
        rate = f"{1 / median_s:.3g} a second, longest step {duration(float(steps_s.max()))}"
    return [
        ("from", moment(int(times_s[0] * 1e9))),
        ("span", duration(float(times_s[-1] - times_s[0]))),
        ("rate", rate),
    ]


def path_length(steps_m: NDArray[np.floating]) -> str:
    """The length of a path, and of its median step, from its steps (n, 3) in metres."""
    lengths_m = np.linalg.norm(steps_m, axis=1)
    median_m = float(np.median(lengths_m)) if len(lengths_m) else 0.0
    return f"{metres(float(lengths_m.sum()))}, median step {metres(median_m)}"


def box(xyz_m: NDArray[np.floating], names: Sequence[str], digits: int = 1) -> str:
    """The extent of positions (n, axis) in metres along each named axis."""
    if not len(xyz_m):
        return "unknown"
    sides = [
        f"{name} {low_m:.{digits}f} … {high_m:.{digits}f} m"
        for name, low_m, high_m in zip(names, xyz_m.min(axis=0), xyz_m.max(axis=0), strict=True)
    ]
    return typographic(", ".join(sides))


def duration(seconds: float) -> str:
    """A time span: 1.6 s, 12 min 05 s, 1 h 33 min."""
    if seconds < 60:
        return f"{seconds:.3g} s"
    if seconds < 3600:
        return f"{int(seconds) // 60} min {int(seconds) % 60:02d} s"
    return f"{int(seconds) // 3600} h {int(seconds) % 3600 // 60:02d} min"


def moment(stamp_ns: int) -> str:
    """A stamp as UTC date and time, or as seconds if its clock starts at 0."""
    if 0 <= stamp_ns < FIRST_YEAR_NS:
        return f"{stamp_ns / 1e9:.3f} s (a clock that starts at 0, no date)"
    try:
        return f"{datetime.fromtimestamp(stamp_ns // 10**9, UTC):%Y-%m-%d %H:%M:%S} UTC"
    except (ValueError, OverflowError, OSError):
        return f"{stamp_ns} ns (no date)"
