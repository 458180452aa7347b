"""The numbers that are compared, from weighted queries.

Weights of one give the estimate, a bootstrap's weights give its spread.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.counts import Counts, ExactCounts, right
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

POSES = (
    *(
        "within_2m_5deg",
        "within_05m_2deg",
        "within_1m_10deg",
        "error_m",
        "error_deg",
        "wrong_of_accepted_99",
        "recall_99",
    ),
    *(
        "within_2m_5deg_same_heading",
        "within_2m_5deg_turned",
        "within_2m_5deg_beside",
        "trajectory_m",
    ),
)
NUMBERS = (
    *(
        "recall_at_1",
        "recall_at_5",
        "recall_at_25",
        "recall_at_1_same_heading",
        "recall_at_1_turned",
    ),
    *("oracle", "oracle_same_heading", "oracle_turned"),
    *(
        "auc_top1",
        "auc_top5",
        "auc_top25",
        "auc_exact_top1",
        "f1_max",
        "recall_at_99_precision",
        "auroc",
    ),
    *("precision_at_threshold", "recall_at_threshold", "median_error_m"),
    *("oracle_auc_exact_top1", "median_heading_error_deg", "heading_within_10deg"),
    *POSES,
)
"""recall_at_n: share of the seen queries with a right answer among the first n, rejection ignored;
oracle: the same if each were answered with its nearest training anchor. auc_topn: precision over
recall as the SCI paper draws it, auc_exact_top1 through every threshold there is; of the oracle,
which takes the distance to that anchor for novelty. auroc: how well novelty tells unseen from seen.
…_at_threshold: where the model itself rejects. Beside them stand kept_precision, what that
threshold keeps on held-out blocks, and wanted_precision. …heading…: of the seen that are placed
right and given a heading, since an answer in another street has none to compare. Of poses:
within_…: share of the seen queries, within_1m_10deg of level sweeps alone; error_…: medians over
them; wrong_of_accepted_99: share of the poses that were accepted where .99 was promised, of seen
queries or not, that are off by more than 2 m or 5°, of level sweeps 1 m or 10°; recall_99: share of
the seen queries that were accepted so, and are within; …_same_heading, …_turned, …_beside: of those
that drive as the nearest training pose did, that do not, and that are BESIDE_M or more away from
it; trajectory_m: root mean square of the error over all queries that were given a pose, seen and
accepted or not, as of a whole drive's trajectory."""
MEASURES = (
    "auroc",
    "auc_exact_top1",
    "recall_at_99_precision",
    "precision_at_threshold",
    "recall_at_threshold",
)
"""What is measured of each kind of novelty."""
PRECISE = 0.99
# turned at most this far against the nearest training anchor, a query drives the street as training
# did
SAME_HEADING_DEG = 45.0
GOOD_HEADING_DEG = 10.0
BESIDE_M = 2.0
RIGHT_WITHIN = (2.0, 5.0)
"""Metres and degrees within which a pose is right, where nothing else is said."""
LEVEL_POSES = "within_1m_10deg"
"""The number that says how many poses of level sweeps are right."""
WITHIN = {"within_2m_5deg": RIGHT_WITHIN, "within_05m_2deg": (0.5, 2.0), LEVEL_POSES: (1.0, 10.0)}

Weight = NDArray[np.float64]  # (r, q) how often each of q queries counts in each of r resamples
Number = NDArray[np.float64]  # (r,) a number in each resample, NaN where it is of nothing


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
    heading_error_deg: NDArray[
        np.float64
    ]  # (q,) estimated against true, 0 to 180; NaN where the method estimates none
    pose_error_m: NDArray[np.float64]
    """(q,) of the pose; NaN where there is none."""
    pose_error_deg: NDArray[np.float64]
    """(q,)."""
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
    is_right = {f"recall_at_{n}": right(truth, n) for n in (1, 5, 25)} | {
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
