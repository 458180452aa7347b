"""Precision-recall curves and their summaries, by the SCI authors' rules and by the usual ones.

Two consequences of the authors' rules (METHODS.md 2.7): a seen query that is accepted but misplaced
is a false alarm and leaves recall's denominator, so recall reaches 1 once everything is accepted;
and there precision is the share of *all* queries that are right. The usual recall is of all seen
queries, so a misplaced one counts against it.

Every function takes counts with the thresholds along the last axis, in rising order.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.counts import Counts

Curve = NDArray[np.float64]


def precision_recall(counts: Counts, seen: Any = None) -> tuple[Curve, Curve]:
    """Precision and recall, shaped as the counts.

    0/0 is precision 1 (nothing accepted, nothing wrong) and recall 0. Recall is hits / (hits +
    misses); where the number of `seen` queries is given, of all those.
    """
    hits = np.asarray(counts.hits, np.float64)
    precision = ratio(hits, hits + counts.false_alarms, empty=1.0)
    recall = ratio(
        hits, hits + counts.misses if seen is None else np.asarray(seen, np.float64), empty=0.0
    )
    return precision, recall


def auc(precision: Curve, recall: Curve) -> NDArray[np.float64]:
    """Area under precision over recall by trapezoids in the order of the thresholds."""
    return np.asarray(np.trapezoid(precision, recall, axis=-1))


def f1_max(precision: Curve, recall: Curve) -> NDArray[np.float64]:
    """The largest harmonic mean of precision and recall; 0 where both are 0."""
    return np.asarray(ratio(2 * precision * recall, precision + recall, empty=0.0).max(axis=-1))


def recall_at_precision(precision: Curve, recall: Curve, least: float) -> NDArray[np.float64]:
    """The largest recall at a precision of `least` or more; 0 where no threshold reaches it."""
    return np.asarray(np.where(precision >= least, recall, 0.0).max(axis=-1))


def auroc(counts: Counts) -> NDArray[np.float64]:
    """Chance that an unseen query's novelty is above a seen one's, ties counting half.

    NaN without seen or without unseen queries. The counts run from all rejected to all accepted,
    past every distinct novelty: so the trapezoids count a tie half.
    """
    misses = np.asarray(counts.misses, np.float64)
    correct_rejections = np.asarray(counts.correct_rejections, np.float64)
    in_order = np.asarray(np.trapezoid(misses[..., :1] - misses, -correct_rejections, axis=-1))
    return ratio(in_order, misses[..., 0] * correct_rejections[..., 0], empty=np.nan)


def ratio(part: Curve, whole: Curve, empty: float) -> Curve:
    """`part` / `whole`, and `empty` where the whole is 0."""
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1.0), empty)
