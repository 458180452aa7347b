"""The papers' Table II, the results by each protocol and the kinds of novelty, as GitHub markdown and as plain text."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

import numpy as np

from pipeline.evaluation.numbers import MEASURES
from pipeline.reports.result import Result, by_method, by_sequence

MISSING = "–"
INTERVAL = len("0.792 [.76, .83]")
SHOWN = (
    ("recall@1", "recall_at_1", 3, True),
    ("oracle", "oracle", 3, False),
    ("AUC top-1", "auc_top1", 3, True),
    ("AUC exact", "auc_exact_top1", 3, False),
    ("F1max", "f1_max", 3, False),
    ("R@99%P", "recall_at_99_precision", 3, False),
    ("AUROC", "auroc", 3, False),
    ("precision", "precision_at_threshold", 3, False),
    ("recall", "recall_at_threshold", 3, False),
    ("error [m]", "median_error_m", 1, False),
)
"""Heading, key in metrics.json, digits after the point, and whether its 95 % interval is shown."""
CELLS = ("cells: seen", "unseen", "share unseen")
DISTANCE = ("distance: seen", "unseen", "not judged")
KINDS = (
    ("AUROC", "auroc"),
    ("AUC exact", "auc_exact_top1"),
    ("R@99%P", "recall_at_99_precision"),
    ("precision", "precision_at_threshold"),
    ("recall", "recall_at_threshold"),
)
"""Heading and measure of a kind of novelty."""


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
    """Table II of the SCI paper: each test sequence's age, and how much of it lies where training went, by both protocols."""
    rows = []
    for name, group in by_sequence(results).items():
        n, queries = group[0].numbers, int(group[0].numbers["queries"])
        (seen, unseen), (near, far) = ((n[protocol]["seen"], n[protocol]["unseen"]) for protocol in ("cells", "distance"))
        counts = (n["days"], queries, seen, unseen)
        share = number(unseen / queries if queries else None, 3)
        rows.append((name, *map(str, counts), share, *map(str, (near, far, queries - near - far))))
    header = ("sequence", "days", "queries", *CELLS, *DISTANCE)
    return Table(header, tuple(rows), words=1)


def outcomes(results: Sequence[Result], protocol: str) -> Table:
    """The numbers of each sequence and method by one protocol; of several sequences each method's mean ± standard deviation."""
    rows = []
    for name, group in by_sequence(results).items():
        rows += [(name, result.method, *(_entry(result, protocol, *shown[1:]) for shown in SHOWN)) for result in group]
    for method, group in by_method(results).items():
        if len(group) > 1:
            means = [_mean([result.number(protocol, key) for result in group], digits, whole) for _, key, digits, whole in SHOWN]
            rows.append(("mean", method, *means))
    return Table(("sequence", "method", *(heading for heading, *_ in SHOWN)), tuple(rows), words=2)


def novelties(results: Sequence[Result], protocol: str) -> Table:
    """How each kind of novelty rejects by one protocol: means over the test sequences, and the sequence it does worst in."""
    rows = []
    for method, group in by_method(results).items():
        for k, kind in enumerate(group[0].evaluation.kinds):
            values = np.stack([r.evaluation.protocol(protocol).rejection[k, :, 0] for r in group])  # (sequence, measure)
            means = [mean(list(values[:, MEASURES.index(measure)])) for _, measure in KINDS]
            auroc = values[:, MEASURES.index("auroc")]
            worst = MISSING
            if np.isfinite(auroc).any():
                at = int(np.nanargmin(auroc))
                worst = f"{auroc[at]:.3f} on {group[at].sequence[:10]}"
            rows.append((method, kind + ("" if k else ", in use"), *(number(value, 3) for value in means), worst))
    return Table(("method", "novelty", *(heading for heading, _ in KINDS), "worst AUROC"), tuple(rows), words=2)


def mean(numbers: Sequence[float | None]) -> float | None:
    """The mean of the numbers that are there."""
    there = present(numbers)
    return fmean(there) if there else None


def present(numbers: Sequence[float | None]) -> list[float]:
    """The numbers that are there and finite."""
    return [float(value) for value in numbers if value is not None and np.isfinite(value)]


def number(value: float | None, digits: int) -> str:
    """A number, or a dash for none."""
    return MISSING if value is None else f"{value:.{digits}f}"


def spread(numbers: Sequence[float | None], digits: int) -> str:
    """Mean and standard deviation, as `0.772 ± .025` or `3.3 ± 0.3`; the number alone if there is one."""
    there = present(numbers)
    if len(there) < 2:
        return number(mean(there), digits)
    deviation = f"{stdev(there):.{digits}f}"
    return f"{fmean(there):.{digits}f} ± {deviation.removeprefix('0') if digits > 1 else deviation}"


def _entry(result: Result, protocol: str, key: str, digits: int, whole: bool) -> str:
    """A number, and its interval as `0.792 [.76, .83]` if the whole is wanted."""
    value = number(result.number(protocol, key), digits)
    bounds = result.interval(protocol, key)
    if not whole or value == MISSING:
        return value
    return value.ljust(INTERVAL) if bounds is None else f"{value} [{_bound(bounds[0])}, {_bound(bounds[1])}]"


def _bound(value: float) -> str:
    """Two digits after the point and none before: `.76`, or `1.0`."""
    text = f"{value:.2f}"
    return text[:3] if text[0] == "1" else text[1:]


def _mean(numbers: Sequence[float | None], digits: int, whole: bool) -> str:
    return spread(numbers, digits).ljust(INTERVAL) if whole else number(mean(numbers), digits)
