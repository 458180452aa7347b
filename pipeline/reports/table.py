"""A table as GitHub markdown and as plain text, and how its numbers are written."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

import numpy as np

MISSING = "–"
WIDEST = 160
"""Characters that a terminal shows in a line."""


@dataclass(frozen=True)
class Table:
    """A heading and rows of text; the first `words` columns are flush left, the numbers after them flush right."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    words: int

    def markdown(self) -> str:
        """A GitHub table, padded so that it can be read as it stands."""
        rule = [":" + "-" * (w - 1) if i < self.words else "-" * (w - 1) + ":" for i, w in enumerate(self._widths(least=3))]
        header, *rows = self._padded(least=3)
        return "\n".join(f"| {' | '.join(cells)} |" for cells in (header, rule, *rows)) + "\n"

    def text(self) -> str:
        """The same for a terminal: a rule under the heading, two blanks between columns; too wide a one goes on below."""
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
            header, *rows = (cells[: self.words] + tuple(cells[c] for c in part) for cells in (self.header, *self.rows))
            yield Table(header, tuple(rows), self.words)

    def _padded(self, least: int) -> list[list[str]]:
        widths = self._widths(least)
        return [
            [cell.ljust(w) if i < self.words else cell.rjust(w) for i, (cell, w) in enumerate(zip(cells, widths, strict=True))]
            for cells in (self.header, *self.rows)
        ]

    def _widths(self, least: int) -> list[int]:
        return [max(least, *map(len, column)) for column in zip(self.header, *self.rows, strict=True)]


def mean(numbers: Sequence[float | None]) -> float | None:
    """The mean of the numbers that are there."""
    there = present(numbers)
    return fmean(there) if there else None


def present(numbers: Sequence[float | None]) -> list[float]:
    """The numbers that are there and finite."""
    return [float(value) for value in numbers if value is not None and np.isfinite(value)]


def number(value: float | None, digits: int) -> str:
    """A number, or a dash for none."""
    return MISSING if value is None or np.isnan(value) else f"{value:.{digits}f}"


def signed(value: float | None, digits: int) -> str:
    """A difference with its sign, typographically: `+0.031`, `−0.120`."""
    return MISSING if value is None or np.isnan(value) else f"{value:+.{digits}f}".replace("-", "−")


def spread(numbers: Sequence[float | None], digits: int) -> str:
    """Mean and standard deviation, as `0.772 ± .025` or `3.3 ± 0.3`; the number alone if there is one."""
    there = present(numbers)
    if len(there) < 2:
        return number(mean(there), digits)
    deviation = f"{stdev(there):.{digits}f}"
    return f"{fmean(there):.{digits}f} ± {deviation.removeprefix('0') if digits > 1 else deviation}"


def bracket(bounds: tuple[float, float] | None, digits: int) -> str:
    """An interval behind its number: ` [.76, .83]` of a share, ` [2.1, 3.4]` of metres; nothing for none."""
    if bounds is None:
        return ""
    return " [" + ", ".join(_bound(value) if digits > 1 else f"{value:.{digits}f}" for value in bounds) + "]"


def _bound(value: float) -> str:
    """Two digits after the point and none before: `.76`, or `1.0`."""
    text = f"{value:.2f}"
    return text[:3] if text[0] == "1" else text[1:]
