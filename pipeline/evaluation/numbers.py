"""The numbers by which methods are compared: recall, areas under curves, errors, and so on.

In: the answers to the queries of one test sequence (`Queries`), what is true of them by one
protocol (`GroundTruth`), and weights. Out: each of NUMBERS, whose meanings MEANINGS lists. A weight
says how often a query counts: ones give the estimate of a number, a bootstrap's draws its
resamples.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import LEVEL_RIGHT_WITHIN, RIGHT_WITHIN
from pipeline.evaluation.counts import Counts, ExactCounts, is_right_at
from pipeline.evaluation.curves import (
    Curve,
    auc,
    auroc,
    f1_max,
    precision_recall,
    ratio,
    recall_at_precision,
)
from pipeline.evaluation.protocols import GroundTruth

POSE_MEANINGS = {
    "within_2m_5deg": "share of the seen queries whose pose is within 2 m and 5° of the true one",
    "within_05m_2deg": "share of the seen queries whose pose is within 0.5 m and 2°",
    "within_1m_10deg": "share of the seen queries whose pose is within 1 m and 10°; for level 2-D "
    "sweeps only",
    "error_m": "median error of position over the seen queries",
    "error_deg": "median error of heading over the seen queries",
    "wrong_of_accepted_99": "share of wrong poses (off by more than 2 m or 5°; for level sweeps "
    "1 m or 10°) among the accepted poses, of seen and unseen queries. Poses are accepted at the "
    "target precision .99 or, if that cannot be kept, at the largest below it that can "
    "(`kept_precision`, a number of its own)",
    "recall_99": "share of the seen queries whose pose is accepted, as above, and right",
    "within_2m_5deg_same_heading": "within_2m_5deg, over the queries driven in the same direction "
    "as training",
    "within_2m_5deg_turned": "within_2m_5deg, over the queries driven in another direction",
    "within_2m_5deg_beside": "within_2m_5deg, over the queries at least BESIDE_M away from the "
    "nearest training anchor",
    "trajectory_m": "root mean square error of position over all queries with a pose, seen or not, "
    "accepted or not: the measure for the trajectory of a whole drive",
}
"""The numbers on poses, and what each says. All are NaN for a method that estimates no poses."""
MEANINGS = {
    "recall_at_1": "share of the seen queries whose first answer is right, rejected or not",
    "recall_at_5": "share of the seen queries with a right answer among the first 5",
    "recall_at_25": "share of the seen queries with a right answer among the first 25",
    "recall_at_1_same_heading": "recall_at_1, over the queries driven in the same direction as the "
    "nearest training anchor",
    "recall_at_1_turned": "recall_at_1, over the queries driven in another direction",
    "oracle": "recall_at_1 if each query were answered with its nearest training anchor",
    "oracle_same_heading": "oracle, over the queries driven in the same direction as that anchor",
    "oracle_turned": "oracle, over the queries driven in another direction",
    "auc_top1": "area under the precision-recall curve of the first answers, at the evenly spaced "
    "thresholds of the SCI paper",
    "auc_top5": "auc_top1, but an answer is right if one of the first 5 is",
    "auc_top25": "auc_top1, but an answer is right if one of the first 25 is",
    "auc_exact_top1": "auc_top1, but with every novelty as a threshold: the exact curve",
    "f1_max": "largest harmonic mean of precision and recall on the exact curve",
    "recall_at_99_precision": "largest recall at a precision of at least .99 on the exact curve",
    "auroc": "probability that an unseen query has a higher novelty than a seen one",
    "precision_at_threshold": "precision at the model's own threshold (the table of results also "
    "has validation_precision, its precision on validation blocks of training, and "
    "target_precision, the precision that it was chosen for)",
    "recall_at_threshold": "recall at the model's own threshold",
    "median_error_m": "median distance of the first answer over the seen queries",
    "oracle_auc_exact_top1": "auc_exact_top1 of the oracle, whose novelty is the distance to the "
    "nearest training anchor",
    "median_heading_error_deg": "median error of heading over the seen queries whose first answer "
    "is right and has a heading; an answer in another street has no heading to compare",
    "heading_within_10deg": "share of those queries whose heading is off by at most 10°",
    **POSE_MEANINGS,
}
"""All numbers, and what each says."""
POSES = tuple(POSE_MEANINGS)
NUMBERS = tuple(MEANINGS)
MEASURES = (
    "auroc",
    "auc_exact_top1",
    "recall_at_99_precision",
    "precision_at_threshold",
    "recall_at_threshold",
)
"""The numbers that are also computed for each further kind of novelty of a method."""
PRECISE = 0.99
"""The precision of `recall_at_99_precision`."""
SAME_HEADING_DEG = 45.0
"""A query is driven in the same direction as training if its heading differs by at most this from
that of the nearest training anchor."""
GOOD_HEADING_DEG = 10.0
BESIDE_M = 2.0
"""From this distance on, a query lies beside the path of training: in another lane, say."""
LEVEL_POSES = "within_1m_10deg"
"""The number that says how many poses of level 2-D sweeps are right."""
WITHIN = {
    "within_2m_5deg": RIGHT_WITHIN,
    "within_05m_2deg": (0.5, 2.0),
    LEVEL_POSES: LEVEL_RIGHT_WITHIN,
}

Weight = NDArray[np.float64]
"""(r, q) how often each of q queries counts in each of r resamples."""
Number = NDArray[np.float64]
"""(r,) a number in each resample; NaN where no query counts."""


@dataclass(frozen=True)
class Queries:
    """The answers to q queries, with their errors, which are the same by both protocols."""

    novelty: NDArray[np.float32]
    """(q, kind) how new each query looks; the first kind is the one in use."""
    reject_from: tuple[float, ...]
    """(kind,) the model's own thresholds: it rejects a query of this novelty or more."""
    thresholds: NDArray[np.float64]
    """(t,) the thresholds of the SCI paper's curve, on the first kind."""
    error_m: NDArray[np.float64]
    """(q,) distance from the query to its first answer."""
    turn_deg: NDArray[np.float64]
    """(q,) heading of the query against that of the nearest training anchor."""
    nearest_m: NDArray[np.float64]
    """(q,) distance from the query to the nearest training anchor."""
    heading_error_deg: NDArray[np.float64]
    """(q,) estimated heading against the true one, 0 to 180; NaN if the method estimates none."""
    pose_error_m: NDArray[np.float64]
    """(q,) distance of the estimated pose from the true one; NaN if there is no pose."""
    pose_error_deg: NDArray[np.float64]
    """(q,) turn of the estimated pose against the true one; NaN if there is no pose."""
    pose_square: NDArray[np.float64]
    """(q,) squared error of the pose, normalised by its covariance; NaN if there is none."""
    reject_pose_from: float
    """Poses of this novelty or more are rejected: the threshold for the target precision .99, or
    for the largest below it that can be kept. NaN if the method estimates no poses."""
    right_within: tuple[float, float] = RIGHT_WITHIN
    """Metres and degrees within which a pose is right."""

    @property
    def is_same_heading(self) -> NDArray[np.bool_]:
        """Which queries (q,) are driven in the same direction as training."""
        return np.abs(self.turn_deg) <= SAME_HEADING_DEG


def numbers(ground_truth: GroundTruth, queries: Queries, weight: Weight) -> dict[str, Number]:
    """Each of NUMBERS by name, with a value for each resample."""
    exact = ExactCounts(ground_truth, queries.novelty[:, 0], weight)
    columns = exact.columns(queries.thresholds)
    seen_weight = weight @ ground_truth.seen
    values = answers(ground_truth, queries, weight) | poses(ground_truth, queries, weight)
    values |= rejection(ground_truth, exact, queries.reject_from[0], seen_weight)
    for n in (1, 5, 25):
        precision, recall = curve(ground_truth, exact.count(n, columns), seen_weight)
        values[f"auc_top{n}"] = where(seen_weight, auc(precision, recall))
    # The oracle's first answer is right or not; its novelty is the distance to training.
    oracle = replace(ground_truth, true_rank=np.where(ground_truth.oracle_right, 0, -1))
    values["oracle_auc_exact_top1"] = auc_exact(oracle, queries.nearest_m, weight)
    return {name: values[name] for name in NUMBERS}


def measures(
    ground_truth: GroundTruth, queries: Queries, kind: int, weight: Weight
) -> dict[str, Number]:
    """Each of MEASURES by name, for the novelty of this kind (its index)."""
    exact = ExactCounts(ground_truth, queries.novelty[:, kind], weight)
    values = rejection(ground_truth, exact, queries.reject_from[kind], weight @ ground_truth.seen)
    return {name: values[name] for name in MEASURES}


def auc_exact(ground_truth: GroundTruth, novelty: NDArray[Any], weight: Weight) -> Number:
    """Area under the exact precision-recall curve of the first answers.

    Its thresholds are all values of `novelty` (q,).
    """
    seen_weight = weight @ ground_truth.seen
    counts = ExactCounts(ground_truth, novelty, weight).count(1)
    precision, recall = curve(ground_truth, counts, seen_weight)
    return where(seen_weight, auc(precision, recall))


def answers(ground_truth: GroundTruth, queries: Queries, weight: Weight) -> dict[str, Number]:
    """Recall, errors and headings of the answers to the seen queries, rejected or not."""
    seen = ground_truth.seen
    is_same_heading = queries.is_same_heading
    is_right = {f"recall_at_{n}": is_right_at(ground_truth, n) for n in (1, 5, 25)}
    is_right["oracle"] = ground_truth.oracle_right
    values = {name: share(flags, seen, weight) for name, flags in is_right.items()}
    for name in ("recall_at_1", "oracle"):
        values[f"{name}_same_heading"] = share(is_right[name], seen & is_same_heading, weight)
        values[f"{name}_turned"] = share(is_right[name], seen & ~is_same_heading, weight)
    values["median_error_m"] = median(queries.error_m[seen], weight[:, seen])
    error_deg = queries.heading_error_deg
    has_heading = is_right["recall_at_1"] & np.isfinite(error_deg)
    values["median_heading_error_deg"] = median(error_deg[has_heading], weight[:, has_heading])
    values["heading_within_10deg"] = share(error_deg <= GOOD_HEADING_DEG, has_heading, weight)
    return values


def poses(ground_truth: GroundTruth, queries: Queries, weight: Weight) -> dict[str, Number]:
    """Each of POSES by name; a query without a pose counts as one with a wrong pose.

    All are NaN for a method that estimates no poses.
    """
    undefined = np.full(len(weight), np.nan)
    if np.isnan(queries.reject_pose_from):
        return dict.fromkeys(POSES, undefined)
    seen = ground_truth.seen
    error_m = queries.pose_error_m
    error_deg = queries.pose_error_deg
    values: dict[str, Number] = {}

    # All poses of seen queries.
    for name, limits in WITHIN.items():
        values[name] = share(within(limits, error_m, error_deg), seen, weight)
    if queries.right_within != WITHIN[LEVEL_POSES]:
        values[LEVEL_POSES] = undefined
    values["error_m"] = median(error_m[seen], weight[:, seen])
    values["error_deg"] = median(error_deg[seen], weight[:, seen])

    # Accepted poses.
    is_accepted = queries.novelty[:, 0].astype(np.float64) < queries.reject_pose_from
    is_right = within(queries.right_within, error_m, error_deg)
    values["wrong_of_accepted_99"] = share(~is_right, is_accepted, weight)
    values["recall_99"] = share(is_accepted & is_right, seen, weight)

    # Poses by the heading of the query and its distance from the training path.
    is_within = within(WITHIN["within_2m_5deg"], error_m, error_deg)
    groups = {
        "same_heading": queries.is_same_heading,
        "turned": ~queries.is_same_heading,
        "beside": queries.nearest_m >= BESIDE_M,
    }
    for name, is_in_group in groups.items():
        values[f"within_2m_5deg_{name}"] = share(is_within, seen & is_in_group, weight)

    has_pose = np.isfinite(error_m)
    pose_weight = weight[:, has_pose]
    square_sum = pose_weight @ error_m[has_pose] ** 2
    values["trajectory_m"] = np.sqrt(ratio(square_sum, pose_weight.sum(axis=1), empty=np.nan))
    return values


def within(
    limits: tuple[float, float], error_m: NDArray[np.float64], error_deg: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which poses (q,) are within limits, in metres and degrees, given their errors (q,).

    A missing pose, whose errors are NaN, is not.
    """
    limit_m, limit_deg = limits
    return (error_m < limit_m) & (error_deg < limit_deg)


def rejection(
    ground_truth: GroundTruth, exact: ExactCounts, reject_from: float, seen_weight: Number
) -> dict[str, Number]:
    """How well a novelty separates right first answers from wrong ones and unseen queries.

    Returns MEASURES and f1_max. `seen_weight` (r,) is the weight of all seen queries.
    """
    counts = exact.count(1)
    (column,) = exact.columns(np.array([reject_from]))
    precision, recall = curve(ground_truth, counts, seen_weight)
    accepted_weight = counts.true_positives[:, column] + counts.false_positives[:, column]
    return {
        "auroc": auroc(counts),
        "auc_exact_top1": where(seen_weight, auc(precision, recall)),
        "f1_max": where(seen_weight, f1_max(precision, recall)),
        "recall_at_99_precision": where(
            seen_weight, recall_at_precision(precision, recall, PRECISE)
        ),
        "precision_at_threshold": where(accepted_weight, precision[:, column]),
        "recall_at_threshold": where(seen_weight, recall[:, column]),
    }


def curve(ground_truth: GroundTruth, counts: Counts, seen_weight: Number) -> tuple[Curve, Curve]:
    """Precision and recall (r, t) by the protocol's rule (`GroundTruth.recall_of_all_seen`).

    `seen_weight` (r,) is the weight of all seen queries.
    """
    if ground_truth.recall_of_all_seen:
        return precision_recall(counts, seen_weight[:, None])
    return precision_recall(counts)


def average(values: Any, axis: int | None = None) -> Any:
    """The mean of the finite values along an axis, or of all of them; NaN where there is none."""
    mean = np.ma.masked_invalid(np.asarray(values, np.float64)).mean(axis=axis)
    return np.ma.filled(mean, np.nan)[()]


def deviation(values: Any) -> float:
    """Standard deviation of the finite values; NaN for fewer than two."""
    values = np.asarray(values, np.float64)
    finite = values[np.isfinite(values)]
    return float(finite.std(ddof=1)) if len(finite) > 1 else np.nan


def share(flags: NDArray[np.bool_], among: NDArray[np.bool_], weight: Weight) -> Number:
    """The share of the queries `among` (q,) that have a flag (q,)."""
    return ratio(weight @ (flags & among), weight @ among, empty=np.nan)


def median(values: NDArray[np.float64], weight: Weight) -> Number:
    """The median of values (q,), each counted as often as its weight, a whole number.

    NaN without any. A value that is NaN, since an answer has no position, counts as the largest.
    """
    ascending = np.r_[np.sort(values), np.nan]  # NaN is taken where no query counts
    running = np.cumsum(weight[:, np.argsort(values)], axis=1)
    total = weight.sum(axis=1)
    # Of an even number of values the median is the mean of the two in the middle.
    lower_rank = np.ceil(total / 2) - 1
    upper_rank = np.floor(total / 2)
    lower = ascending[(running <= lower_rank[:, None]).sum(axis=1)]
    upper = ascending[(running <= upper_rank[:, None]).sum(axis=1)]
    return where(total, (lower + upper) / 2)


def where(whole: Number, value: Number) -> Number:
    """The value where `whole`, the weight of the queries behind it, is above 0, else NaN."""
    return np.where(whole > 0, value, np.nan)
