"""The numbers by which methods are compared: queries, their truth and weights in; numbers out.

A weight says how often a query counts: ones give the estimate, those of a bootstrap its spread.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
from pipeline.evaluation.doubts import DOUBTS, VOID
from pipeline.evaluation.protocols import Truth

POSE_MEANINGS = {
    "within_2m_5deg": "share of the seen queries whose pose is within 2 m and 5°",
    "within_05m_2deg": "the same of 0.5 m and 2°",
    "within_1m_10deg": "the same of 1 m and 10°, of level sweeps alone",
    "error_m": "median error of position over the seen queries",
    "error_deg": "median error of heading over the seen queries",
    "wrong_of_accepted_99": "share of the poses accepted where .99 was promised, of seen queries "
    "or not, that are off by more than 2 m or 5°, of level sweeps 1 m or 10°",
    "recall_99": "share of the seen queries whose pose was accepted so, and is within these",
    "within_2m_5deg_same_heading": "within_2m_5deg of those that drive as training did",
    "within_2m_5deg_turned": "within_2m_5deg of those that do not",
    "within_2m_5deg_beside": "within_2m_5deg of those that are BESIDE_M or more away from it",
    "trajectory_m": "root mean square of the error of position over all queries with a pose, seen "
    "and accepted or not, as of a whole drive's trajectory",
}
"""Number of poses to what it says; all are NaN of a method without poses."""
MEANINGS = {
    "recall_at_1": "share of the seen queries with a right first answer, rejected or not",
    "recall_at_5": "the same of a right answer among the first 5",
    "recall_at_25": "the same of a right answer among the first 25",
    "recall_at_1_same_heading": "recall_at_1 of those that drive as the nearest training anchor",
    "recall_at_1_turned": "recall_at_1 of those that do not",
    "oracle": "recall_at_1 if each query were answered with its nearest training anchor",
    "oracle_same_heading": "the same of those that drive as that anchor",
    "oracle_turned": "the same of those that do not",
    "auc_top1": "area under precision over recall of the first answers, as the SCI paper draws it",
    "auc_top5": "the same of the first 5",
    "auc_top25": "the same of the first 25",
    "auc_exact_top1": "auc_top1 through every threshold that there is",
    "f1_max": "largest harmonic mean of precision and recall on that curve",
    "recall_at_99_precision": "largest recall at a precision of .99 on that curve",
    "auroc": "how well novelty tells unseen queries from seen ones",
    "precision_at_threshold": "precision where the model itself rejects; beside it in the table "
    "are kept_precision, what that keeps on held-out blocks, and wanted_precision",
    "recall_at_threshold": "recall where the model itself rejects",
    "median_error_m": "median distance of the first answer over the seen queries",
    "oracle_auc_exact_top1": "auc_exact_top1 of the oracle, whose novelty is the distance to its "
    "anchor",
    "median_heading_error_deg": "median error of heading over the seen queries that are answered "
    "right and given a heading: an answer in another street has none to compare",
    "heading_within_10deg": "share of these whose error is at most 10°",
    **POSE_MEANINGS,
}
"""Number to what it says."""
POSES = tuple(POSE_MEANINGS)
NUMBERS = tuple(MEANINGS)
MEASURES = (
    "auroc",
    "auc_exact_top1",
    "recall_at_99_precision",
    "precision_at_threshold",
    "recall_at_threshold",
)
"""What is measured of each kind of novelty."""
PRECISE = 0.99
"""Precision of `recall_at_99_precision`."""
SAME_HEADING_DEG = 45.0
"""Turned at most this far against the nearest training anchor, a query drives the street as
training did."""
GOOD_HEADING_DEG = 10.0
BESIDE_M = 2.0
RIGHT_WITHIN = (2.0, 5.0)
"""Metres and degrees within which a pose is right, where nothing else is said."""
LEVEL_POSES = "within_1m_10deg"
"""The number that says how many poses of level sweeps are right."""
WITHIN = {"within_2m_5deg": RIGHT_WITHIN, "within_05m_2deg": (0.5, 2.0), LEVEL_POSES: (1.0, 10.0)}

Weight = NDArray[np.float64]
"""(r, q) how often each of q queries counts in each of r resamples."""
Number = NDArray[np.float64]
"""(r,) a number in each resample; NaN where it is of nothing."""


@dataclass(frozen=True)
class Queries:
    """The answers to q queries, and the truth about them that no protocol changes."""

    novelty: NDArray[np.float32]
    """(q, kind); the first kind is the one in use."""
    reject_from: tuple[float, ...]
    """(kind,) the model's own thresholds."""
    thresholds: NDArray[np.float64]
    """(t,) of the SCI paper's curve, over the first kind."""
    error_m: NDArray[np.float64]
    """(q,) from the query to its first answer."""
    turn_deg: NDArray[np.float64]
    """(q,) heading against the nearest training anchor's."""
    nearest_m: NDArray[np.float64]
    """(q,) distance to that anchor."""
    heading_error_deg: NDArray[np.float64]
    """(q,) estimated against true, 0 to 180; NaN where the method estimates none."""
    pose_error_m: NDArray[np.float64]
    """(q,) distance of the pose from the true one; NaN where there is none."""
    pose_error_deg: NDArray[np.float64]
    """(q,) turn of the pose against the true one; NaN where there is none."""
    reject_pose_from: float
    """Reject from this novelty in use on to keep .99 of the poses; NaN of a method without."""
    right_within: tuple[float, float] = RIGHT_WITHIN
    """Metres and degrees."""


def numbers(truth: Truth, queries: Queries, weight: Weight) -> dict[str, Number]:
    """Each of NUMBERS by name, a value a resample."""
    exact = ExactCounts(truth, queries.novelty[:, 0], weight)
    columns = exact.columns(queries.thresholds)
    seen = weight @ truth.seen
    values = answers(truth, queries, weight) | poses(truth, queries, weight)
    values |= rejection(truth, exact, queries.reject_from[0], seen)
    for n in (1, 5, 25):
        values[f"auc_top{n}"] = where(seen, auc(*curve(truth, exact.count(n, columns), seen)))
    oracle = replace(truth, true_rank=np.where(truth.oracle_right, 0, -1))
    values["oracle_auc_exact_top1"] = auc_exact(oracle, queries.nearest_m, weight)
    return {name: values[name] for name in NUMBERS}


def measures(truth: Truth, queries: Queries, kind: int, weight: Weight) -> dict[str, Number]:
    """Each of MEASURES of one kind of novelty, by name."""
    exact = ExactCounts(truth, queries.novelty[:, kind], weight)
    values = rejection(truth, exact, queries.reject_from[kind], weight @ truth.seen)
    return {name: values[name] for name in MEASURES}


def auc_exact(truth: Truth, novelty: NDArray[Any], weight: Weight) -> Number:
    """Area under precision over recall of the first answers through every novelty (q,)."""
    seen = weight @ truth.seen
    return where(seen, auc(*curve(truth, ExactCounts(truth, novelty, weight).count(1), seen)))


def answers(truth: Truth, queries: Queries, weight: Weight) -> dict[str, Number]:
    """Recall, errors and headings of the answers to the seen queries, rejection ignored."""
    seen = truth.seen
    same_heading = np.abs(queries.turn_deg) <= SAME_HEADING_DEG
    is_right = {f"recall_at_{n}": is_right_at(truth, n) for n in (1, 5, 25)} | {
        "oracle": truth.oracle_right
    }
    values = {name: share(flags, seen, weight) for name, flags in is_right.items()}
    for name in ("recall_at_1", "oracle"):
        values[f"{name}_same_heading"] = share(is_right[name], seen & same_heading, weight)
        values[f"{name}_turned"] = share(is_right[name], seen & ~same_heading, weight)
    values["median_error_m"] = median(queries.error_m[seen], weight[:, seen])
    off_deg = queries.heading_error_deg
    has_heading = is_right["recall_at_1"] & np.isfinite(queries.heading_error_deg)
    values["median_heading_error_deg"] = median(off_deg[has_heading], weight[:, has_heading])
    values["heading_within_10deg"] = share(off_deg <= GOOD_HEADING_DEG, has_heading, weight)
    return values


def poses(truth: Truth, queries: Queries, weight: Weight) -> dict[str, Number]:
    """Each of POSES by name; a missing pose counts as wrong.

    All are NaN for a method that gives no poses.
    """
    if np.isnan(queries.reject_pose_from):
        return dict.fromkeys(POSES, np.full(len(weight), np.nan))
    off = {"error_m": queries.pose_error_m, "error_deg": queries.pose_error_deg}
    is_within = {name: within(limits, *off.values()) for name, limits in WITHIN.items()}
    accepted = queries.novelty[:, 0].astype(np.float64) < queries.reject_pose_from
    is_right = within(queries.right_within, *off.values())
    values = {name: share(flags, truth.seen, weight) for name, flags in is_within.items()}
    if queries.right_within != WITHIN[LEVEL_POSES]:
        values[LEVEL_POSES] = np.full(len(weight), np.nan)
    values |= {
        name: median(errors[truth.seen], weight[:, truth.seen]) for name, errors in off.items()
    }
    values["wrong_of_accepted_99"] = share(~is_right, accepted, weight)
    values["recall_99"] = share(accepted & is_right, truth.seen, weight)
    has_pose = np.isfinite(queries.pose_error_m)
    values["trajectory_m"] = np.sqrt(
        ratio(
            weight[:, has_pose] @ queries.pose_error_m[has_pose] ** 2,
            weight[:, has_pose].sum(axis=1),
            empty=np.nan,
        )
    )
    same_heading = np.abs(queries.turn_deg) <= SAME_HEADING_DEG
    for name, chosen in (
        ("same_heading", same_heading),
        ("turned", ~same_heading),
        ("beside", queries.nearest_m >= BESIDE_M),
    ):
        values[f"within_2m_5deg_{name}"] = share(
            is_within["within_2m_5deg"], truth.seen & chosen, weight
        )
    return values


def within(
    limits: tuple[float, float], error_m: NDArray[np.float64], error_deg: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which poses (q,) are within metres and degrees of the truth, given their errors (q,).

    A missing pose, NaN, is not.
    """
    far_m, far_deg = limits
    return (error_m < far_m) & (error_deg < far_deg)


def rejection(
    truth: Truth, exact: ExactCounts, reject_from: float, seen: Number
) -> dict[str, Number]:
    """How well one novelty separates right first answers from wrong ones and from unseen queries.

    Gives MEASURES and F1max. `seen` (r,) is the weight of the seen queries.
    """
    counts = exact.count(1)
    column = exact.columns(np.array([reject_from]))[0]
    precision, recall = curve(truth, counts, seen)
    accepted = counts.hits[:, column] + counts.false_alarms[:, column]
    return {
        "auroc": auroc(counts),
        "auc_exact_top1": where(seen, auc(precision, recall)),
        "f1_max": where(seen, f1_max(precision, recall)),
        "recall_at_99_precision": where(seen, recall_at_precision(precision, recall, PRECISE)),
        "precision_at_threshold": where(accepted, precision[:, column]),
        "recall_at_threshold": where(seen, recall[:, column]),
    }


def curve(truth: Truth, counts: Counts, seen: Number) -> tuple[Curve, Curve]:
    """Precision and recall (r, t) by the protocol's rule; `seen` (r,) weighs the seen queries."""
    return precision_recall(counts, seen[:, None] if truth.recall_of_all_seen else None)


def share(flags: NDArray[np.bool_], among: NDArray[np.bool_], weight: Weight) -> Number:
    """The share of queries with a flag (q,) among those of `among` (q,)."""
    return ratio(weight @ (flags & among), weight @ among, empty=np.nan)


def median(values: NDArray[np.float64], weight: Weight) -> Number:
    """The median of values (q,), each counted as often as its weight; NaN without any.

    Weights are whole numbers. A value that is NaN, an answer without a position, counts as the
    largest.
    """
    ascending = np.r_[np.sort(values), np.nan]
    running = np.cumsum(weight[:, np.argsort(values)], axis=1)
    total = weight.sum(axis=1)
    middle = [
        (running <= half[:, None]).sum(axis=1)
        for half in (np.ceil(total / 2) - 1, np.floor(total / 2))
    ]
    return where(total, (ascending[middle[0]] + ascending[middle[1]]) / 2)


def where(whole: Number, value: Number) -> Number:
    """The value where `whole`, what it is a share of, is above 0, else NaN."""
    return np.where(whole > 0, value, np.nan)


def line(numbers: Mapping[str, float | None]) -> str:
    """The main numbers of an evaluation and its doubts, as one line."""
    shown = ("auc_top1", "recall_at_1", "auroc")
    texts = (
        f"{name} {numbers[name]:.3f}" if numbers[name] is not None else f"{name} none"
        for name in shown
    )
    doubted = [
        name.removeprefix("doubt_").replace("_", " ") for name in (VOID, *DOUBTS) if name in numbers
    ]
    return " ".join(texts) + (f" ({', '.join(doubted)})" if doubted else "")
