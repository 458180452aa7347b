"""Tests of the AUC on validation blocks of training, by which settings are chosen."""

import numpy as np
import pytest

from pipeline.evaluation.validation import validation_auc
from pipeline.matching.rejection import NoveltyEvidence


def evidence(right: list[bool], seen: list[float], unseen: list[float]) -> NoveltyEvidence:
    return NoveltyEvidence(
        np.array(right),
        {"entropy": np.array(seen)},
        {"entropy": np.array(unseen)},
        np.arange(len(right)),
    )


def test_right_and_apart_is_one_and_never_right_is_nothing() -> None:
    assert validation_auc(
        evidence([True] * 3, [0.1, 0.2, 0.3], [0.7, 0.8, 0.9]), "entropy", 0.2
    ) == pytest.approx(1)
    # All but the trapezoid of the very first step, from (recall 0, precision 1) to (0, 0).
    assert (
        validation_auc(evidence([False] * 3, [0.1, 0.2, 0.3], [0.7, 0.8, 0.9]), "entropy", 0.2) == 0
    )


def test_an_unseen_query_counts_by_the_share_to_expect() -> None:
    # The unseen one, of weight u, is first: precision 0 at recall 0; then the right one, of weight
    # 1 − u: precision 1 − u at recall 1. The area is the one trapezoid between.
    for share in (0.2, 0.5):
        result = validation_auc(evidence([True], [0.2], [0.1]), "entropy", share)
        assert result == pytest.approx((1 - share) / 2)
