"""Tables of a report: each cell has a text, a number to sort by and the artifact that it is from."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import fmean, stdev
from typing import Any

import numpy as np

MISSING = "–"
WIDEST = 160
"""Characters that a terminal shows in a line."""


@dataclass(frozen=True)
class Cell:
    """One entry of a table."""

    text: str
    key: float | None = None
    """What the column is sorted by; None for a word or a missing number."""
    small: str = ""
    """An interval or a deviation beside the number, such as `[.76, .83]` or `± .025`."""
    mark: str = ""
    """`+` or `−`: clearly better or worse than the reference."""
    source: str = ""
    """Path of the artifact that the number is from."""

    def __str__(self) -> str:
        return " ".join(part for part in (self.text, self.small, self.mark) if part)


@dataclass(frozen=True)
class Table:
    """A header and rows of cells; the first `words` columns are words, flush left, the others numbers, flush right."""

    kind: str
    """Its key in templates/words.yaml, which holds its caption."""
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    words: int = 1
    values: Mapping[str, object] = field(default_factory=dict)
    """What its caption is filled with."""
    mean: bool = False
    """The last row holds the means of the others and stays below them."""

    def markdown(self) -> str:
        """A GitHub table, padded so that it can be read as it stands."""
        rule = [":" + "-" * (w - 1) if i < self.words else "-" * (w - 1) + ":" for i, w in enumerate(self._widths(least=3))]
        header, *rows = self._padded(least=3)
        return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows)) + "\n"

    def text(self) -> str:
        """The same for a terminal: two blanks between columns; a table that is too wide goes on below."""
        return "\n".join(part._text() for part in self._folded())

    def _text(self) -> str:
        header, *rows = self._padded(least=1)
        rule = ["─" * width for width in self._widths(least=1)]
        return "\n".join("  ".join(cells).rstrip() for cells in (header, rule, *rows)) + "\n"

    def _folded(self) -> Iterator["Table"]:
        """Tables of some of the columns each, as many as fit beside the words."""
        widths = [width + 2 for width in self._widths(least=1)]
        parts: list[list[int]] = [[]]
        for column in range(self.words, len(widths)):
            if parts[-1] and sum(widths[: self.words]) + sum(widths[c] for c in [*parts[-1], column]) > WIDEST + 2:
                parts.append([])
            parts[-1].append(column)
        for part in parts:
            chosen = [*range(self.words), *part]
            rows = tuple(tuple(row[c] for c in chosen) for row in self.rows)
            yield replace(self, header=tuple(self.header[c] for c in chosen), rows=rows)

    def _padded(self, least: int) -> list[list[str]]:
        widths = self._widths(least)
        lines = [list(self.header), *([str(cell) for cell in row] for row in self.rows)]
        return [
            [c.ljust(w) if i < self.words else c.rjust(w) for i, (c, w) in enumerate(zip(line, widths, strict=True))]
            for line in lines
        ]

    def _widths(self, least: int) -> list[int]:
        columns = zip(self.header, *([str(cell) for cell in row] for row in self.rows), strict=True)
        return [max(least, *map(len, column)) for column in columns]


def word(text: object, source: str = "") -> Cell:
    """A cell of words."""
    return Cell(str(text), source=source)


def number(value: float, digits: int, interval: tuple[float, float] | None = None, mark: str = "", source: str = "") -> Cell:
    """A number and its interval; a dash for NaN."""
    if not np.isfinite(value):
        return Cell(MISSING)
    return Cell(fixed(value, digits), float(value), bracket(interval, digits), mark, source)


def count(value: float, source: str = "") -> Cell:
    """A whole number."""
    return number(value, 0, source=source)


def difference(value: float, digits: int, interval: tuple[float, float] | None = None, source: str = "") -> Cell:
    """A difference with its sign: `+0.031 [−0.010, +0.080]`."""
    if not np.isfinite(value):
        return Cell(MISSING)
    there = interval is not None and np.isfinite(interval[0])
    small = f"[{signed(interval[0], digits)}, {signed(interval[1], digits)}]" if interval is not None and there else ""
    return Cell(signed(value, digits), float(value), small, source=source)


def spread(values: Sequence[float], digits: int, source: str = "") -> Cell:
    """Mean and standard deviation of the finite numbers: `0.772 ± .025`; the number alone if there is one."""
    finite = [float(value) for value in values if np.isfinite(value)]
    if not finite:
        return Cell(MISSING)
    small = f"± {short(stdev(finite), digits)}" if len(finite) > 1 else ""
    return Cell(fixed(fmean(finite), digits), fmean(finite), small, source=source)


def average(values: Any) -> float:
    """Of the finite numbers; NaN of none."""
    there = np.asarray(values, float)[np.isfinite(values)]
    return float(there.mean()) if len(there) else np.nan


def fixed(value: float, digits: int) -> str:
    """A number with so many digits after the point and a true minus sign; a dash for NaN."""
    return MISSING if not np.isfinite(value) else f"{value:z.{digits}f}".replace("-", "−")


def signed(value: float, digits: int) -> str:
    """A difference with its sign: `+0.031`, `−0.120`."""
    return MISSING if not np.isfinite(value) else f"{value:+z.{digits}f}".replace("-", "−")


def short(value: float, digits: int) -> str:
    """Without the 0 before the point where there are two digits or more behind it: `.025`, `−.02`, `1.3`."""
    text = fixed(value, digits)
    return text.replace("0.", ".", 1) if digits > 1 and abs(value) < 1 and text.lstrip("−").startswith("0.") else text


def bracket(interval: tuple[float, float] | None, digits: int) -> str:
    """An interval: `[.76, .83]` of a share, `[2.1, 3.4]` of metres; nothing for none."""
    if interval is None or not np.isfinite(interval[0]):
        return ""
    shown = ("1.0" if digits > 1 and 0.995 < value <= 1 else short(value, min(digits, 2)) for value in interval)
    return f"[{', '.join(shown)}]"
