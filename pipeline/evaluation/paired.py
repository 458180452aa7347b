"""A paired test: is one method better than another on the same queries, or luckier on this path?"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.evaluation.bootstrap import Bootstrap, blocks, bounds
from pipeline.evaluation.counts import right
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.numbers import Weight, auc_exact, share

COMPARED = ("recall_at_1", "auc_exact_top1")  # the numbers whose differences are tested
LEVEL = 0.05
KEPT = "auc_exact_top1_kept"
"""The number of `kept_share` in the table of results."""


@dataclass(frozen=True)
class Difference:
    """One number of one method minus the reference's."""

    value: float
    low: float  # of the 95 % interval; NaN where no resample defines the difference
    high: float
    p: float  # two-sided, and never 0; NaN like the interval


@dataclass(frozen=True)
class Paired:
    """One method against the reference on one sequence, by one protocol."""

    differences: tuple[Difference, ...]  # one each of COMPARED
    only_this: int  # seen queries whose first answer is right by this method alone
    only_reference: int


def compare(this: Evaluation, reference: Evaluation, protocol: str, bootstrap: Bootstrap) -> Paired:
    """Compare two evaluations of the same queries, number by number, on the same resamples.

    What is hard for both methods cancels out. p is twice the smaller share of resamples with a
    difference of at most, or at least, 0; the path itself counts as one resample. So p is at least
    2 / (1 + resamples): a test of many sequences needs many. It is also at least 2 / 2**blocks, the
    least that a sign test of the blocks with seen queries can reach: with five, .0625. Raises
    InputError for other queries.
    """
    this_truth = this.truth(protocol)
    reference_truth = reference.truth(protocol)
    same_queries = (
        np.array_equal(this.xy_m, reference.xy_m)
        and np.array_equal(this_truth.seen, reference_truth.seen)
        and np.array_equal(this_truth.unseen, reference_truth.unseen)
    )
    if not same_queries:
        raise InputError(
            "two methods can be compared on the same queries only, in the same order and judged "
            "alike"
        )
    this_right = right(this_truth, 1)
    reference_right = right(reference_truth, 1)

    def difference(weight: Weight) -> NDArray[np.float64]:
        this_recall = share(this_right, this_truth.seen, weight)
        reference_recall = share(reference_right, reference_truth.seen, weight)
        this_auc = auc_exact(this_truth, this.novelty[:, 0], weight)
        reference_auc = auc_exact(reference_truth, reference.novelty[:, 0], weight)
        return np.stack([this_recall - reference_recall, this_auc - reference_auc])

    values = difference(np.ones((1, len(this.xy_m))))[:, 0].tolist()
    spreads = bootstrap.spreads(difference, this.xy_m)
    block = blocks(this.xy_m, bootstrap.block_m)
    return Paired(
        differences=tuple(
            Difference(value, *bounds(spread), _p(spread, this_truth.seen, block))
            for value, spread in zip(values, spreads, strict=True)
        ),
        only_this=int((this_right & ~reference_right).sum()),
        only_reference=int((reference_right & ~this_right).sum()),
    )


def kept_share(
    altered: Evaluation, driven: Evaluation, protocol: str, bootstrap: Bootstrap
) -> tuple[float, float, float]:
    """The share of its area as driven that a model keeps on altered queries, with its bounds.

    The area is `auc_exact_top1`. Both are of the same queries and drawn together, so what is hard
    in both cancels out. NaN where there is no area as driven. Raises InputError for other queries.
    """
    truths = altered.truth(protocol), driven.truth(protocol)
    if not np.array_equal(altered.xy_m, driven.xy_m):
        raise InputError("altered queries are compared with the same queries as driven")
    novelties = altered.novelty[:, 0], driven.novelty[:, 0]

    def share_of_driven(weight: Weight) -> NDArray[np.float64]:
        of_altered, of_driven = map(auc_exact, truths, novelties, (weight, weight))
        return (of_altered / np.where(of_driven > 0, of_driven, np.nan))[None]

    ((value, low, high),) = bootstrap.estimates(share_of_driven, driven.xy_m)
    return float(value), float(low), float(high)


def holm(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """Holm's correction of p values (n,) for being the least of n; NaN counts as none.

    It holds the chance of any false claim, where scipy's `false_discovery_control` holds the share
    of them.
    """
    corrected = np.full(len(p), np.nan)
    order = np.argsort(p)[: np.isfinite(p).sum()]
    corrected[order] = np.maximum.accumulate(p[order] * np.arange(len(order), 0, -1)).clip(max=1.0)
    return corrected


def _p(spread: NDArray[np.float64], seen: NDArray[np.bool_], block: NDArray[np.int64]) -> float:
    """The p value of differences (resample,), by the definition in `compare`."""
    if not len(spread):
        return np.nan
    smaller_tail = int(min((spread <= 0).sum(), (spread >= 0).sum()))
    sign_test_floor = 2 / 2.0 ** len(np.unique(block[seen]))
    return min(1.0, max(sign_test_floor, 2 * (1 + smaller_tail) / (1 + len(spread))))
