"""The papers' Table II and the results, as GitHub markdown and as plain text."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.reports.result import Result, by_method, by_sequence

MISSING = "–"
SHOWN = (
    ("top-1", "top1", 3),
    ("top-1 same heading", "top1_same_heading", 3),
    ("oracle", "oracle_top1", 3),
    ("AUC top-1", "auc_top1", 3),
    ("AUC top-5", "auc_top5", 3),
    ("AUC top-25", "auc_top25", 3),
    ("precision", "precision_at_threshold", 3),
    ("recall", "recall_at_threshold", 3),
    ("median error [m]", "median_error_m", 1),
)
"""Heading, key in metrics.json, digits after the point."""


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
        """The same for a terminal: a rule under the heading, two blanks between columns."""
        header, *rows = self._padded(least=1)
        rule = ["─" * width for width in self._widths(least=1)]
        return "\n".join("  ".join(cells).rstrip() for cells in (header, rule, *rows)) + "\n"

    def _padded(self, least: int) -> list[list[str]]:
        widths = self._widths(least)
        return [
            [cell.ljust(w) if i < self.words else cell.rjust(w) for i, (cell, w) in enumerate(zip(cells, widths, strict=True))]
            for cells in (self.header, *self.rows)
        ]

    def _widths(self, least: int) -> list[int]:
        return [max(least, *map(len, column)) for column in zip(self.header, *self.rows, strict=True)]


def sequences(results: Sequence[Result]) -> Table:
    """Table II of the SCI paper: each test sequence's age, and how much of it lies where training never went."""
    rows = []
    for name, group in by_sequence(results).items():
        n = group[0].numbers
        share = None if not n["queries"] else (n["unseen"] or 0) / n["queries"]
        rows.append((name, *(_number(n[key], 0) for key in ("days", "queries", "seen", "unseen")), _number(share, 3)))
    return Table(("sequence", "days", "queries", "seen", "unseen", "unseen share"), tuple(rows), words=1)


def outcomes(results: Sequence[Result]) -> Table:
    """The numbers of each sequence and method, and each method's mean over the sequences where there are several."""
    rows = []
    for name, group in by_sequence(results).items():
        rows += [(name, r.method, *(_number(r.numbers[key], digits) for _, key, digits in SHOWN)) for r in group]
    for method, group in by_method(results).items():
        if len(group) > 1:
            means = [_mean([r.numbers[key] for r in group]) for _, key, _ in SHOWN]
            rows.append(("mean", method, *(_number(mean, digits) for mean, (_, _, digits) in zip(means, SHOWN, strict=True))))
    return Table(("sequence", "method", *(heading for heading, _, _ in SHOWN)), tuple(rows), words=2)


def _mean(numbers: Sequence[float | None]) -> float | None:
    """The mean over the sequences that have the number."""
    there = [number for number in numbers if number is not None]
    return sum(there) / len(there) if there else None


def _number(number: float | None, digits: int) -> str:
    return MISSING if number is None else f"{number:.{digits}f}"
