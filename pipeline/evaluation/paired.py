"""Whether one method is better than another on the same queries, or only luckier along this path: a paired test."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.evaluation.bootstrap import BOUNDS, Bootstrap
from pipeline.evaluation.counts import right
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.numbers import Number, Weight, auc_exact, share

COMPARED = ("recall_at_1", "auc_exact_top1")
"""The numbers whose differences are tested."""
LEVEL = 0.05


@dataclass(frozen=True)
class Difference:
    """One number of one method minus the reference's."""

    value: float
    low: float
    high: float
    """95 % interval; NaN where no resample tells."""
    p: float
    """Two-sided, and never 0; NaN where no resample tells."""


@dataclass(frozen=True)
class Paired:
    """One method against the reference on one sequence, by one protocol."""

    differences: tuple[Difference, ...]
    """One each of COMPARED."""
    only_this: int
    """Seen queries whose first answer is right by this method alone."""
    only_reference: int


def compare(this: Evaluation, reference: Evaluation, protocol: str, bootstrap: Bootstrap) -> Paired:
    """Both methods meet the same resamples, so what is hard for both cancels out; raises InputError for other queries.

    p inverts the percentile interval: twice the smaller share of the resamples in which the difference is at most, or at least,
    0, counting the path itself as one more: at least 2 / (1 + resamples), so a test of many sequences needs many resamples.
    """
    ours, theirs = this.truth(protocol), reference.truth(protocol)
    same = ((this.xy_m, reference.xy_m), (ours.seen, theirs.seen), (ours.unseen, theirs.unseen))
    if not all(np.array_equal(one, other) for one, other in same):
        raise InputError("two methods can be compared on the same queries only, in the same order and judged alike")

    def difference(weight: Weight) -> NDArray[np.float64]:
        return np.stack(_numbers(this, protocol, weight)) - np.stack(_numbers(reference, protocol, weight))

    values = difference(np.ones((1, len(this.xy_m))))[:, 0]
    spreads = bootstrap.spreads(difference, this.xy_m)
    good, better = right(ours, 1), right(theirs, 1)
    return Paired(
        tuple(_tested(float(value), spread) for value, spread in zip(values, spreads, strict=True)),
        int((good & ~better).sum()),
        int((better & ~good).sum()),
    )


def holm(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Holm's correction of p values (n,) for being the least of n; NaN counts as none.

    It holds the chance of any false claim, where scipy's `false_discovery_control` holds the share of them.
    """
    corrected, order = np.full(len(p), np.nan), np.argsort(p)[: np.isfinite(p).sum()]
    corrected[order] = np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1)).clip(max=1.0)
    return corrected


def _numbers(evaluation: Evaluation, protocol: str, weight: Weight) -> tuple[Number, Number]:
    truth = evaluation.truth(protocol)
    return share(right(truth, 1), truth.seen, weight), auc_exact(truth, evaluation.novelty[:, 0], weight)


def _tested(value: float, spread: NDArray[np.float64]) -> Difference:
    if not len(spread):
        return Difference(value, np.nan, np.nan, np.nan)
    fewer = min((spread <= 0).sum(), (spread >= 0).sum())
    low, high = np.percentile(spread, BOUNDS)
    return Difference(value, float(low), float(high), min(1.0, 2 * (1 + int(fewer)) / (1 + len(spread))))
