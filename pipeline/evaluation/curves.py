"""Precision-recall curves: counts at rising thresholds in; curves, and areas under them, out.

Every function takes counts (…, t) with the t thresholds along the last axis, in rising order. A
query is accepted if its novelty is below the threshold, so the last one accepts the most.

Precision is true positives / (true positives + false positives), where a seen query that is
accepted but misplaced is a false positive. Recall has two rules. The usual one is true positives /
all seen queries. The SCI authors' rule (METHODS.md 2.7) is true positives / (true positives + false
negatives), which leaves misplaced queries out of the denominator. So recall reaches 1 once
everything is accepted, and there precision is the share of *all* queries that are right.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.counts import Counts

Curve = NDArray[np.float64]
"""(…, t) a value at each threshold."""


def precision_recall(counts: Counts, seen: Any = None) -> tuple[Curve, Curve]:
    """Precision and recall, shaped as the counts.

    Recall is true positives / `seen` where the number of seen queries is given, else by the
    authors' rule true positives / (true positives + false negatives). 0/0 is precision 1 (nothing
    accepted, nothing wrong) and recall 0.
    """
    true_positives = np.asarray(counts.true_positives, np.float64)
    recall_whole = (
        true_positives + counts.false_negatives if seen is None else np.asarray(seen, np.float64)
    )
    precision = ratio(true_positives, true_positives + counts.false_positives, empty=1.0)
    recall = ratio(true_positives, recall_whole, empty=0.0)
    return precision, recall


def auc(precision: Curve, recall: Curve) -> NDArray[np.float64]:
    """Area (…) under precision over recall by trapezoids in the order of the thresholds."""
    return np.asarray(np.trapezoid(precision, recall, axis=-1))


def f1(precision: Curve, recall: Curve) -> Curve:
    """The harmonic mean (…, t) of precision and recall; 0 where both are 0."""
    return ratio(2 * precision * recall, precision + recall, empty=0.0)


def f1_max(precision: Curve, recall: Curve) -> NDArray[np.float64]:
    """The largest F1 score (…) at any threshold."""
    return np.asarray(f1(precision, recall).max(axis=-1))


def recall_at_precision(precision: Curve, recall: Curve, least: float) -> NDArray[np.float64]:
    """The largest recall (…) at a precision of `least` or more; 0 where no threshold reaches it."""
    return np.asarray(np.where(precision >= least, recall, 0.0).max(axis=-1))


def auroc(counts: Counts) -> NDArray[np.float64]:
    """Area (…) under the ROC curve: how often an unseen query has more novelty than a seen one.

    Ties count half. NaN without seen or without unseen queries. The counts must run from all
    rejected to all accepted, past every distinct novelty, so that the trapezoids count ties half.
    """
    false_negatives = np.asarray(counts.false_negatives, np.float64)
    true_negatives = np.asarray(counts.true_negatives, np.float64)
    # At the first threshold all are rejected.
    seen = false_negatives[..., 0]
    unseen = true_negatives[..., 0]
    # When the rising threshold passes an unseen query, the seen ones accepted so far have less
    # novelty: the integral of their number over the unseen queries counts these pairs.
    seen_accepted = false_negatives[..., :1] - false_negatives
    unseen_accepted = -true_negatives  # up to a constant, which the integral does not see
    pairs_in_order = np.trapezoid(seen_accepted, unseen_accepted, axis=-1)
    return ratio(np.asarray(pairs_in_order), seen * unseen, empty=np.nan)


def ratio(part: Curve, whole: Curve, empty: float) -> Curve:
    """`part` / `whole`, and `empty` where the whole is 0."""
    return np.where(whole > 0, part / np.where(whole > 0, whole, 1.0), empty)
