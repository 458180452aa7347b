"""Small evaluations and judgements for the tests of evaluation, with outcomes worked out by hand,
and functions that write them as artifacts."""

from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.frames import pose
from pipeline.core.schemas import Labels
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.counts import TOP_N, Counts, is_right_at
from pipeline.evaluation.evaluations import Evaluation, Evaluations
from pipeline.evaluation.judge import judge
from pipeline.evaluation.protocols import Distance, GroundTruth
from pipeline.evaluation.viewpoint_matches import ViewpointMatches
from pipeline.matching.ranking import Ranking
from pipeline.perturbations import Case

SEEN = np.array([1, 1, 1, 0, 1, 0], bool)
TOY = GroundTruth(SEEN, ~SEEN, np.array([0, 1, 0, -1, 0, -1]), np.array([1, 1, 1, 0, 0, 0], bool))
NOVELTY = np.array([0.1, 0.2, 0.3, 0.4, 0.6, 0.7], np.float32)
THRESHOLDS = np.array([0.15, 0.25, 0.35, 0.5, 0.65, 1.0])
"""The toy of METHODS.md 2.7: six queries. The second is placed wrong: its true place is ranked
2nd."""

XY_M = np.array([(0, 0), (10, 0), (20, 0), (30, 0), (40, 0), (40, 100), (40, 120)], float)
BOOTSTRAP = Bootstrap(block_m=15.0, resamples=40)
NAN = np.full(7, np.nan, np.float32)
COST = np.array([0.05, 0.75, 0.15, 0.25, 0.05, 0.45, 0.95], np.float32)
AWAY_M = np.array([(1, 300), (1, 300), (200, 300), (6, 300), (1, 300), (1, 300), (1, 300)], float)
SCI = Ranking(
    places=np.array([[1, 2], [2, 3], [9, 3], [5, 4], [5, 1], [1, 2], [1, 2]]),
    costs=np.stack([COST, np.ones_like(COST)], axis=1),
    xy_m=np.stack([XY_M[:, :1] + AWAY_M, XY_M[:, 1:] + 0 * AWAY_M], axis=2),
    novelty=np.array(
        [[0.1, 1], [0.8, 2], [0.2, 3], [0.3, 4], [0.05, 5], [0.4, 8], [0.9, 9]], np.float32
    ),
    confidence=1 - COST / 2,
    heading_deg=NAN[:, None],
    kinds=("entropy", "energy"),
)
"""The outcomes by cells: true positive, false negative, false positive (200 m off), false positive
(next cell, 6 m off), true positive (turned around), false positive (unseen), true negative; by
distance the fourth is a true positive."""
M2DP = replace(
    SCI,
    places=np.array([[1], [9], [3], [9], [9], [9], [9]]),
    costs=SCI.costs[:, :1],
    xy_m=SCI.xy_m[:, :1]
    + np.array([0.0, 199.0, -200.0, 199.0, 199.0, 0.0, 0.0])[:, None, None] * (1, 0),
    novelty=SCI.novelty[:, :1],
    confidence=NAN,
    kinds=("distance",),
)
"""Right at 0 and 2 alone. SCI misplaces 2: by cells one query is for it, two (1 and 4) against."""
LABELS = Labels(
    places=np.array([1, 2, 3, 4, 5, -1, -1]),
    cells=np.arange(10),
    oracle=np.array([1, 2, 3, 5, 5, 5, 5]),
    nearest_m=np.array([1.0, 1.0, 1.0, 1.0, 1.0, 100.0, 120.0]),
    nearest_turn_deg=np.array([0.0, 0.0, 0.0, 0.0, 179.0, 0.0, 0.0]),
    days=20,
    cell_m=10.0,
    x_m=(0.0, 100.0),
    y_m=(0.0, 100.0),
)


def evaluation(
    days: int = 20, ranking: Ranking = SCI, labels: Labels = LABELS, **given: Any
) -> Evaluation:
    """Seven queries, the last two unseen."""
    reject_from = (0.5, 6.0)[: len(ranking.kinds)]
    labels = replace(labels, days=days)
    return judge(ranking, reject_from, labels, standing(XY_M), Distance(), BOOTSTRAP, **given)


def standing(xy_m: np.ndarray, yaw_deg: np.ndarray | float = 0.0) -> np.ndarray:
    """Poses (n, 4, 4) at these positions."""
    still = np.zeros((len(xy_m), 2))
    return pose(np.c_[xy_m, still[:, 0]], np.c_[still, still[:, 0] + np.deg2rad(yaw_deg)])


def rows(whole: Any, index: Any) -> Any:
    """Some rows of a ranking or of labels."""
    arrays = {
        field.name: getattr(whole, field.name)
        for field in fields(whole)
        if isinstance(getattr(whole, field.name), np.ndarray) and field.name != "cells"
    }
    return replace(whole, **{name: array[index] for name, array in arrays.items()})


def of_cases(cases: Mapping[Case, Evaluation], sequence: str = "2012-02-04") -> Evaluations:
    """An `evaluations` artifact in memory."""
    return Evaluations(
        evaluations=tuple(cases.values()),
        cases=[asdict(case) for case in cases],
        sequence=sequence,
        train="2012-01-15",
        distance=vars(Distance(correct_m=12.0)),
        bootstrap=vars(BOOTSTRAP),
    )


def write(path: Path, cases: Mapping[Case, Evaluation], **other: Any) -> Evaluations:
    """An `evaluations` artifact on disk; `other` replaces fields."""
    store.write(path, replace(of_cases(cases, path.stem), **other))
    return store.read(path, Evaluations)


def judged(correct: np.ndarray, score: np.ndarray) -> ViewpointMatches:
    """Queries 2 m apart on a line, each (heading, query) matched 1 m off or 80 m off, with this
    score; all are valid."""
    headings, n = correct.shape
    xy_m = np.stack([2.0 * np.arange(n), np.zeros(n)], axis=1)
    error_m = np.where(correct, 1.0, 80.0)
    return ViewpointMatches(
        headings_deg=(np.arange(headings) + 0.5) * 360 / headings,
        row=np.tile(np.arange(n), (headings, 1)),
        answer_xy_m=xy_m + np.stack([error_m, np.zeros_like(error_m)], axis=2),
        error_m=error_m,
        score=np.asarray(score, np.float32),
        correct=np.asarray(correct, bool),
        valid=np.ones(n, bool),
        xy_m=xy_m,
        pictures=np.zeros((headings, 4, 4), np.uint8),
        reconstructed=np.zeros((0, 4, 4), np.uint8),
        correct_m=10.0,
        length=10,
        novelty="cost",
        bytes_per_place=8224.0,
    )


def count(
    ground_truth: GroundTruth,
    novelty: NDArray[Any],
    thresholds: NDArray[np.float64],
    top_n: int = TOP_N,
) -> Counts:
    """Counts (n, t) for n = 1 … `top_n` at each of `thresholds` (t,).

    A query is rejected if its novelty (q,) ≥ the threshold.
    """
    thresholds = np.asarray(thresholds, np.float64)
    is_rejected = np.asarray(novelty, np.float64)[:, None] >= thresholds  # (q, t)
    is_right = np.stack(
        [is_right_at(ground_truth, n) for n in range(1, top_n + 1)], axis=1
    )  # (q, n)
    is_judged = ground_truth.seen | ground_truth.unseen
    true_positives = _tally(is_right, ~is_rejected)
    accepted = _tally(is_judged[:, None], ~is_rejected)
    false_negatives = _tally(ground_truth.seen[:, None], is_rejected)
    true_negatives = _tally(ground_truth.unseen[:, None], is_rejected)
    return Counts(
        true_positives=true_positives,
        false_negatives=np.tile(false_negatives, (top_n, 1)),
        false_positives=accepted - true_positives,
        true_negatives=np.tile(true_negatives, (top_n, 1)),
    )


def _tally(rows: NDArray[np.bool_], columns: NDArray[np.bool_]) -> NDArray[np.int64]:
    """How many queries have both flags: (q, a), (q, b) to (a, b).

    The product runs in float64, exact below 2⁵³.
    """
    return np.rint(rows.T.astype(np.float64) @ columns.astype(np.float64)).astype(np.int64)
