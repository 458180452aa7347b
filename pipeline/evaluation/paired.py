"""Paired comparisons: two evaluations of the same queries in; the difference of a metric out.

On a hard stretch of the path every method does badly. The metric is therefore computed for both
evaluations on the same resamples of the path (`bootstrap`), so that what is hard for both cancels
out. `compare` compares a method with the reference method, `kept_share` a model's answers to
perturbed queries with its answers to the unperturbed queries.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.evaluation.bootstrap import Bootstrap, Estimate, blocks, bounds
from pipeline.evaluation.counts import is_right_at
from pipeline.evaluation.evaluations import Evaluation
from pipeline.evaluation.numbers import Weight, auc_exact, share

COMPARED = ("recall_at_1", "auc_exact_top1")
"""The metrics whose differences are tested."""
LEVEL = 0.05
"""A difference is significant where its p, after Holm's correction, is below this."""
AUC_SHARE_KEPT = "auc_exact_top1_kept"
"""The name of the metric of `kept_share` in the table of results."""


class Difference(NamedTuple):
    """One metric of a method minus the reference's."""

    estimate: Estimate
    """Its interval is NaN where no resample defines the difference."""
    p: float
    """The p value of a two-sided test, never 0; NaN like the interval."""


@dataclass(frozen=True)
class Comparison:
    """A method against the reference on one sequence, by one protocol."""

    differences: tuple[Difference, ...]
    """One for each of COMPARED."""
    only_this: int
    """Seen queries whose first answer is right by the method alone."""
    only_reference: int
    """Seen queries whose first answer is right by the reference alone."""


def compare(
    method: Evaluation, reference: Evaluation, protocol: str, bootstrap: Bootstrap
) -> Comparison:
    """Compare two methods' evaluations of the same queries, by each metric of COMPARED.

    p = min(1, max(2 (1 + k) / (1 + r), 2 / 2**b))

    - r is the number of resamples, and k of those in the smaller tail: with a difference of at
      most, or of at least, 0. The path itself counts as one more resample, so p is at least
      2 / (1 + r): a test of many sequences needs many resamples.
    - b is the number of blocks with seen queries. A sign test of b blocks cannot reach less than
      2 / 2**b: with five, .0625.

    Raises InputError if the two do not judge the same queries.
    """
    method_ground_truth = method.ground_truth(protocol)
    reference_ground_truth = reference.ground_truth(protocol)
    are_same_queries = (
        np.array_equal(method.xy_m, reference.xy_m)
        and np.array_equal(method_ground_truth.seen, reference_ground_truth.seen)
        and np.array_equal(method_ground_truth.unseen, reference_ground_truth.unseen)
    )
    if not are_same_queries:
        raise InputError(
            "two methods can be compared only on the same queries, in the same order and with the "
            "same ground truth"
        )
    method_right = is_right_at(method_ground_truth, 1)
    reference_right = is_right_at(reference_ground_truth, 1)

    def compared_differences(weight: Weight) -> NDArray[np.float64]:
        """The differences (number, resample), in the order of COMPARED.

        `weight` (resample, query) says how often each resample holds each query.
        """
        method_recall = share(method_right, method_ground_truth.seen, weight)
        reference_recall = share(reference_right, reference_ground_truth.seen, weight)
        method_auc = auc_exact(method_ground_truth, method.novelty[:, 0], weight)
        reference_auc = auc_exact(reference_ground_truth, reference.novelty[:, 0], weight)
        return np.stack([method_recall - reference_recall, method_auc - reference_auc])

    # The differences on the path itself, then in the resamples alone.
    values = compared_differences(np.ones((1, len(method.xy_m))))[:, 0].tolist()
    resampled_differences = bootstrap.resampled_values(compared_differences, method.xy_m)
    path_blocks = blocks(method.xy_m, bootstrap.block_m)
    seen_block_count = len(np.unique(path_blocks[method_ground_truth.seen]))
    return Comparison(
        differences=tuple(
            Difference(Estimate(value, *bounds(resampled)), _p(resampled, seen_block_count))
            for value, resampled in zip(values, resampled_differences, strict=True)
        ),
        only_this=int((method_right & ~reference_right).sum()),
        only_reference=int((reference_right & ~method_right).sum()),
    )


def _p(resampled: NDArray[np.float64], seen_block_count: int) -> float:
    """The p value of a difference in resamples (r,), by the definition in `compare`."""
    if not len(resampled):
        return np.nan
    smaller_tail = int(min((resampled <= 0).sum(), (resampled >= 0).sum()))
    sign_test_floor = 2 / 2.0**seen_block_count
    return min(1.0, max(sign_test_floor, 2 * (1 + smaller_tail) / (1 + len(resampled))))


def holm(p: NDArray[np.float64]) -> NDArray[np.float64]:
    """The p values (n,) of n tests, corrected by Holm's method; NaN counts as no test.

    It bounds the probability of any false claim, where scipy's `false_discovery_control` bounds the
    share of false ones among the claims.
    """
    corrected = np.full(len(p), np.nan)
    order = np.argsort(p)[: np.isfinite(p).sum()]  # NaN is sorted behind all others
    # The smallest of n is multiplied by n, the next by n − 1, and so on; none may fall below its
    # predecessor.
    factors = np.arange(len(order), 0, -1)
    corrected[order] = np.maximum.accumulate(p[order] * factors).clip(max=1.0)
    return corrected


def kept_share(
    perturbed: Evaluation, unperturbed: Evaluation, protocol: str, bootstrap: Bootstrap
) -> Estimate:
    """The share of its area under the curve that a model keeps when queries are perturbed.

    The share is `auc_exact_top1` of the perturbed queries divided by that of the same unperturbed
    queries. Returns it with the bounds of its 95 % interval; NaN if the unperturbed area is 0.
    Raises InputError if the two do not judge the same queries.
    """
    if not np.array_equal(perturbed.xy_m, unperturbed.xy_m):
        raise InputError("perturbed queries can be compared only with the same unperturbed queries")
    perturbed_ground_truth = perturbed.ground_truth(protocol)
    unperturbed_ground_truth = unperturbed.ground_truth(protocol)

    def share_of_unperturbed(weight: Weight) -> NDArray[np.float64]:
        """The share (1, resample), by `weight` (resample, query)."""
        perturbed_auc = auc_exact(perturbed_ground_truth, perturbed.novelty[:, 0], weight)
        unperturbed_auc = auc_exact(unperturbed_ground_truth, unperturbed.novelty[:, 0], weight)
        return (perturbed_auc / np.where(unperturbed_auc > 0, unperturbed_auc, np.nan))[None]

    # `estimates` gives the value on the path itself and the bounds from the resamples.
    return Estimate(*bootstrap.estimates(share_of_unperturbed, unperturbed.xy_m)[0].tolist())
