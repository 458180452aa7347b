"""Judgements of paper 2's protocol, made by hand."""

import numpy as np

from pipeline.evaluation.viewpoints import Judged


def judged(correct: np.ndarray, score: np.ndarray, bytes_per_place: float = 8224.0) -> Judged:
    """Queries 2 m apart on a line, each (heading, query) matched 1 m off or 80 m off, with this score; all are valid."""
    headings, n = correct.shape
    xy_m = np.stack([2.0 * np.arange(n), np.zeros(n)], axis=1)
    error_m = np.where(correct, 1.0, 80.0)
    return Judged(
        headings_deg=(np.arange(headings) + 0.5) * 360 / headings,
        row=np.tile(np.arange(n), (headings, 1)),
        answer_xy_m=xy_m + np.stack([error_m, np.zeros_like(error_m)], axis=2),
        error_m=error_m,
        score=np.asarray(score, np.float32),
        correct=np.asarray(correct, bool),
        valid=np.ones(n, bool),
        xy_m=xy_m,
        correct_m=10.0,
        length=10,
        novelty="cost",
        bytes_per_place=bytes_per_place,
        pictures=np.zeros((0, 4, 4), np.uint8),
        reconstructed=np.zeros((0, 4, 4), np.uint8),
    )
