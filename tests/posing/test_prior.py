"""Priors: what they weigh, what they leave alone, and which of them are refused."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.posing.fix import ScanFix
from pipeline.posing.prior import LEAST_M, WRONG, Prior
from pipeline.posing.verdict import Judge
from tests.posing.scene import OVERLAPS, hypothesis, planar

JUDGE = Judge(OVERLAPS, OVERLAPS)
SURE = 0.9
"""An overlap whose hypothesis has a score of 10 · .9 − 5 = 4."""


def pose_error(*hypotheses: tuple[float, float], prior: Prior | None = None) -> float:
    """The error probability of the likeliest of hypotheses, each an x and an overlap."""
    fix = ScanFix.of([hypothesis(*each) for each in hypotheses], OVERLAPS, prior)
    return float(JUDGE.error_probabilities(fix)[0])


def test_a_prior_weighs_1_at_itself_and_at_least_wrong_far_away() -> None:
    prior = Prior.at(10.0, 0.0, sigma_m=np.sqrt(4 - LEAST_M**2))  # widened to 2 m
    poses = np.stack([planar(10, 0, 77), planar(12, 0, 0), planar(10, 4, 0), planar(900, 0, 0)])
    expected = [1.0, np.exp(-1 / 2), np.exp(-2), WRONG]
    np.testing.assert_allclose(np.exp(prior.log_weights(poses)), expected)
    assert prior.is_near(np.array([[16.9, 0.0], [17.1, 0.0]])).tolist() == [True, False]  # 3.5 · 2


def test_a_known_heading_weighs_too_across_half_a_turn() -> None:
    prior = Prior.at(0.0, 0.0, 175.0, sigma_m=2.0, sigma_deg=4.0)  # widened by 3° to 5°
    poses = np.stack([planar(0, 0, 175), planar(0, 0, -175)])
    np.testing.assert_allclose(np.exp(prior.log_weights(poses)), [1.0, np.exp(-2)])
    headings_rad = np.deg2rad([-170.0, 150.0, np.nan])  # 15°, 25° off; 17.5° are searched
    assert prior.is_towards(headings_rad).tolist() == [True, False, True]


def test_a_right_prior_decides_between_two_equal_poses() -> None:
    assert pose_error((0.0, SURE), (50.0, SURE)) > 0.5
    fix = ScanFix.of([hypothesis(0.0, SURE), hypothesis(50.0, SURE)], OVERLAPS, Prior.at(50.0, 0.0))
    assert fix.pose[0, 3] == 50.0
    assert pose_error((0.0, SURE), (50.0, SURE), prior=Prior.at(50.0, 0.0)) < 0.03


def test_a_prior_never_makes_a_pose_likelier_than_its_own_evidence() -> None:
    for overlap in (0.4, 0.6, SURE, 1.0):
        alone = pose_error((0.0, overlap))
        for x_m in (0.0, 3.0, 500.0):
            prior = Prior.at(x_m, 0.0)
            assert pose_error((0.0, overlap), prior=prior) > alone
            assert pose_error((0.0, overlap), (90.0, SURE), prior=prior) > alone


def test_no_error_probability_is_below_that_of_a_wrong_prior() -> None:
    assert pose_error((0.0, 5.0)) < 1e-9
    assert pose_error((0.0, 5.0), prior=Prior.at(0.0, 0.0)) > 0.9 * WRONG


def test_a_far_pose_that_fits_much_better_beats_a_wrong_prior() -> None:
    """Its score is 15 higher, which a weight of .001 lowers by 6.9."""
    fix = ScanFix.of([hypothesis(0.0, 0.6), hypothesis(90.0, 2.1)], OVERLAPS, Prior.at(0.0, 0.0))
    assert fix.pose[0, 3] == 90.0


def test_other_models_keep_the_prior() -> None:
    prior = Prior.at(50.0, 0.0)
    fix = ScanFix.of([hypothesis(0.0, SURE), hypothesis(50.0, SURE)], OVERLAPS, prior)
    assert fix.ordered(OVERLAPS).probabilities == fix.probabilities


@pytest.mark.parametrize(
    ("pose", "covariance", "reason"),
    [
        (np.eye(3), np.eye(2), "a pose of shape (3, 3)"),
        (np.eye(4), np.eye(6), "a covariance of shape (6, 6)"),
        (np.full((4, 4), np.nan), np.eye(2), "its pose has numbers that are not finite"),
        (np.eye(4), np.diag([1, np.inf]), "its covariance has numbers that are not finite"),
        (np.eye(4), np.diag([1, 1, 0]), "a variance of 0"),
        (np.eye(4), np.diag([1, -1]), "a variance of -1"),
        (np.eye(4), np.array([[1.0, 0.5], [0.0, 1.0]]), "not symmetric positive semi-definite"),
        (np.eye(4), np.array([[1.0, 2.0], [2.0, 1.0]]), "not symmetric positive semi-definite"),
        (np.eye(4), np.array([["a", "b"], ["c", "d"]]), "expected numbers"),
    ],
)
def test_what_is_no_gaussian_is_refused_in_a_line(
    pose: np.ndarray, covariance: np.ndarray, reason: str
) -> None:
    with pytest.raises(InputError) as refused:
        Prior(pose, covariance)
    assert reason in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("sigmas", [(0.0, 5.0), (-1.0, 5.0), (np.nan, 5.0), (2.0, 0.0)])
def test_standard_deviations_are_positive(sigmas: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="expected more than 0"):
        Prior.at(0.0, 0.0, 90.0, *sigmas)
