"""Whether one method is better than another on the same queries, or only luckier along this path: a
paired test."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.evaluation.bootstrap import Bootstrap, blocks, bounds
from pipeline.evaluation.counts import right
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.numbers import Weight, auc_exact, share

COMPARED = ("recall_at_1", "auc_exact_top1")  # the numbers whose differences are tested
LEVEL = 0.05


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
    """Both methods meet the same resamples, so what is hard for both cancels out; raises InputError
    for other queries.

    p inverts the percentile interval: twice the smaller share of the resamples in which the
    difference is at most, or at least, 0, counting the path itself as one more: at least 2 / (1 +
    resamples), so a test of many sequences needs many resamples. Nor is it less than a sign test of
    the blocks that hold seen queries can reach, 2 / 2**blocks: five blocks never say .05.
    """
    ours = this.truth(protocol)
    theirs = reference.truth(protocol)
    same = ((this.xy_m, reference.xy_m), (ours.seen, theirs.seen), (ours.unseen, theirs.unseen))
    if not all(np.array_equal(one, other) for one, other in same):
        raise InputError(
            "two methods can be compared on the same queries only, in the same order and judged "
            "alike"
        )
    good = right(ours, 1)
    better = right(theirs, 1)

    def difference(weight: Weight) -> NDArray[np.float64]:
        recall = share(good, ours.seen, weight) - share(better, theirs.seen, weight)
        return np.stack(
            [
                recall,
                auc_exact(ours, this.novelty[:, 0], weight)
                - auc_exact(theirs, reference.novelty[:, 0], weight),
            ]
        )

    values = difference(np.ones((1, len(this.xy_m))))[:, 0].tolist()
    tested = (
        Difference(
            one, *bounds(spread), _p(spread, ours.seen, blocks(this.xy_m, bootstrap.block_m))
        )
        for one, spread in zip(values, bootstrap.spreads(difference, this.xy_m), strict=True)
    )
    return Paired(tuple(tested), int((good & ~better).sum()), int((better & ~good).sum()))


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
    fewer = min((spread <= 0).sum(), (spread >= 0).sum())
    least = 2 / 2.0 ** len(np.unique(block[seen]))
    return min(1.0, max(least, 2 * (1 + int(fewer)) / (1 + len(spread)))) if len(spread) else np.nan
