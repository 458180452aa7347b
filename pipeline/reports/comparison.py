"""Each method against the study's first, sequence by sequence, on the same queries."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.paired import COMPARED, LEVEL, Paired, compare, holm
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.reports.result import Result, by_method
from pipeline.reports.table import Table, number, signed
from pipeline.reports.tables import Marks

HEADINGS = {"recall_at_1": "recall@1", "auc_exact_top1": "exact AUC"}
"""How each of COMPARED is called."""
MARKS = {"better": "+", "worse": "−", "undecided": ""}
SHOWN_AS = {"recall_at_1": "recall_at_1", "auc_exact_top1": "auc_top1"}
"""In whose column of the result tables a mark stands: the papers' area and the exact one differ in the third digit."""


@dataclass(frozen=True)
class Against:
    """One method against the reference on one test sequence, by one protocol."""

    result: Result
    reference: str
    protocol: str
    paired: Paired
    p: tuple[float, ...]
    """Of COMPARED, after Holm's correction over the test sequences."""

    def verdict(self, name: str) -> str:
        """`better`, `worse` or `undecided`, of one of COMPARED."""
        i = COMPARED.index(name)
        if not self.p[i] < LEVEL:
            return "undecided"
        return "better" if self.paired.differences[i].value > 0 else "worse"


def against_first(results: Sequence[Result], bootstrap: Bootstrap) -> list[Against]:
    """Every other method by each protocol on each sequence; raises InputError where they answered other queries."""
    (reference, first), *others = by_method(results).items()
    tested = []
    for _, group in others:
        pairs = [(result, next(r for r in first if r.sequence == result.sequence)) for result in group]
        for protocol in PROTOCOLS:
            found = [compare(this.evaluation, that.evaluation, protocol, bootstrap) for this, that in pairs]
            p = np.stack([holm(np.array([one.differences[i].p for one in found])) for i in range(len(COMPARED))], axis=1)
            tested += [
                Against(result, reference, protocol, one, tuple(map(float, row)))
                for result, one, row in zip(group, found, p, strict=True)
            ]
    return tested


def marks(tested: Sequence[Against]) -> Marks:
    """What stands behind the numbers of the result tables."""
    return {
        (one.result.method, one.result.sequence, one.protocol, SHOWN_AS[name]): MARKS[one.verdict(name)]
        for one in tested
        for name in COMPARED
    }


def table(tested: Sequence[Against], protocol: str) -> Table:
    """A row a method and test sequence: differences to the reference with intervals, p, verdict, and who alone was right."""
    rows, reference = [], ""
    for one in tested:
        if one.protocol == protocol:
            reference = one.reference
            row = [one.result.method, one.result.sequence]
            for name, difference, p in zip(COMPARED, one.paired.differences, one.p, strict=True):
                between = f" [{signed(difference.low, 2)}, {signed(difference.high, 2)}]" if np.isfinite(difference.low) else ""
                row += [signed(difference.value, 3) + between, number(p, 3), one.verdict(name)]
            rows.append((*row, str(one.paired.only_this), str(one.paired.only_reference)))
    columns = [words for name in COMPARED for words in (f"Δ {HEADINGS[name]}", "p", "verdict")]
    return Table(("method", "sequence", *columns, "only it right", f"only {reference} right"), tuple(rows), words=2)
