"""Tests of the calibration error: confidences against the share of right answers."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.evaluation.calibration import ece, reliability


def test_bins_of_six_answers_by_hand() -> None:
    confidence = np.array([0.05, 0.82, 0.84, 0.86, 0.88, 1.0], np.float32)
    right = np.array([False, True, True, False, True, True])
    result = reliability(confidence, right)
    assert result.count.tolist() == [1, 0, 0, 0, 0, 0, 0, 0, 4, 1]  # 1 is in the last bin
    np.testing.assert_allclose(result.confidence[[0, 8, 9]], [0.05, 0.85, 1.0], rtol=1e-6)
    assert result.right[[0, 8, 9]].tolist() == [0.0, 0.75, 1.0]
    assert np.isnan(result.right[1:8]).all()
    # (1 · .05 + 4 · |.85 − .75| + 1 · 0) / 6
    assert ece(confidence, right) == pytest.approx((0.05 + 0.4) / 6)


def test_a_confidence_that_means_what_it_says_has_a_small_error_and_an_overconfident_one_a_large_one() -> (
    None
):
    rng = np.random.default_rng(0)
    probability = rng.random(20_000)
    right = rng.random(20_000) < probability
    assert ece(probability, right) < 0.02
    assert ece(np.sqrt(probability), right) == pytest.approx(
        1 / 6, abs=0.02
    )  # ∫ √p − p dp = 2/3 − 1/2


@pytest.mark.parametrize("confidence", [np.nan, -3.5, 1.2])
def test_what_is_no_probability_has_no_error_and_no_bins(confidence: float) -> None:
    answers = np.array([0.5, confidence]), np.array([True, False])
    assert np.isnan(ece(*answers))
    with pytest.raises(InputError, match="a probability"):
        reliability(*answers)


def test_rounding_beyond_one_is_forgiven_and_no_answers_have_no_error() -> None:
    assert ece(np.array([1 + 1e-7, -1e-7]), np.array([True, False])) == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(ece(np.zeros(0), np.zeros(0, bool)))
