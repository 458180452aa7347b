"""Tests of calibrating the covariances of poses."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.posing.covariances import (
    USUAL,
    CovarianceModel,
    largest_squares,
    normalised_squares,
    pose_errors,
)

TYPICAL = (0.001, 0.002, 0.1, 0.05)
VARIANCES = np.array([0.001, 0.001, 0.002, 0.1, 0.1, 0.05]) ** 2


def test_groups_are_scaled_apart() -> None:
    model = CovarianceModel(TYPICAL, (1.0, 2.0, 3.0, 4.0), power=1.0)
    calibrated = model.calibrated(np.diag(VARIANCES))
    assert calibrated == pytest.approx(np.diag(VARIANCES * [1, 1, 4, 9, 9, 16]))


def test_a_direction_that_is_held_less_than_usual_widens_by_the_power() -> None:
    """Along x the deviation is thrice the typical one: 3² times with power 2."""
    model = CovarianceModel(TYPICAL, (1.0,) * 4, power=2.0)
    variances = VARIANCES * [1, 1, 1, 9, 1, 1]
    assert np.diag(model.calibrated(np.diag(variances))) == pytest.approx(
        VARIANCES * [1, 1, 1, 81, 1, 1]
    )


def test_a_covariance_that_is_not_finite_stays() -> None:
    several = np.stack([np.full((6, 6), np.inf), np.diag(VARIANCES)])
    calibrated = CovarianceModel(TYPICAL, (2.0,) * 4, 1.0).calibrated(several)
    assert np.isinf(calibrated[0]).all()
    assert calibrated[1] == pytest.approx(4 * several[1])


def test_the_ellipsoids_hold_their_shares_of_errors_like_those_learned_from() -> None:
    """Errors with thrice the deviations that the covariances say, of poses held differently."""
    rng = np.random.default_rng(0)
    wide = np.exp(rng.normal(0, 0.5, (2000, 1)))
    covariances = np.einsum("nx,xy->nxy", VARIANCES * wide**2, np.eye(6))
    errors = 3 * rng.normal(size=(2000, 6)) * np.sqrt(VARIANCES) * wide
    learned = CovarianceModel.learned(
        errors[:1000], covariances[:1000], np.full(1000, 1.0), replace(USUAL, power=1.0)
    )
    assert learned.scales == pytest.approx((3,) * 4, rel=0.1)
    assert learned.power == pytest.approx(1, abs=0.1)
    squares = normalised_squares(errors[1000:], learned.calibrated(covariances[1000:]))
    shares = (squares < largest_squares((0.5, 0.9, 0.95))[:, None]).mean(axis=1)
    assert shares == pytest.approx([0.5, 0.9, 0.95], abs=0.04)


def test_few_fixes_teach_nothing() -> None:
    few = np.zeros((49, 6)), np.tile(np.diag(VARIANCES), (49, 1, 1)), np.ones(49)
    assert CovarianceModel.learned(*few, USUAL) == USUAL


def test_an_error_is_in_the_frame_of_the_query() -> None:
    """The robot looks along y; the true pose is 1 m farther along y: 1 m ahead."""
    world_T_query = np.eye(4)
    world_T_query[:2, :2] = [[0, -1], [1, 0]]
    world_T_true = world_T_query.copy()
    world_T_true[1, 3] = 1.0
    errors = pose_errors(world_T_query[None], world_T_true[None])
    assert errors[0] == pytest.approx([0, 0, 0, 1, 0, 0])
