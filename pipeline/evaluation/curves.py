"""Precision, recall and the area under their curve, by the SCI authors' rules (METHODS.md 2.7).

Two consequences of those rules: a seen query that is accepted but misplaced is a false alarm and leaves recall's denominator,
so recall reaches 1 once everything is accepted; and there precision is the share of *all* queries that are right.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.counts import Counts

Curve = NDArray[np.float64]


def precision_recall(counts: Counts) -> tuple[Curve, Curve]:
    """Precision and recall, each (top_n, threshold); 0/0 is precision 1 (nothing accepted, nothing wrong) and recall 0."""
    hits = np.asarray(counts.hits, np.float64)
    precision = _ratio(hits, hits + counts.false_alarms, empty=1.0)
    recall = _ratio(hits, hits + counts.misses, empty=0.0)
    return precision, recall


def auc(precision: Curve, recall: Curve) -> NDArray[np.float64]:
    """Area under precision over recall, (top_n,), by trapezoids in the order of the thresholds (the last axis)."""
    return np.asarray(np.trapezoid(precision, recall, axis=-1))


def _ratio(part: Curve, whole: Curve, empty: float) -> Curve:
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1.0), empty)
