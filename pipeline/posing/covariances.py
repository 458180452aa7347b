"""Calibrates the covariances of poses, so that their ellipsoids hold the true pose (METHODS 9.5).

The covariance of a registration is too small, most of all where little holds a pose. In: the errors
of right fixes of validation queries, and their covariances. Out: a `CovarianceModel`, which turns
the covariance of any later fix into a calibrated one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.special import chdtri, gammaln  # scipy.stats takes half a second to import

from pipeline.core.frames import Poses

DIMENSIONS = 6
AXES = np.array([0, 0, 1, 2, 2, 3])
"""The group of each dimension of a pose: tilts about x and y, turn about z, steps along x and y,
step along z. Each group has a scale of its own."""
GROUPS = 4
FEWEST = 50
"""With fewer right fixes, the usual model is used."""
STRAY = 0.5
"""How far the logarithm of a parameter is expected to stray from the usual one."""
SHARES = (0.9, 0.95)
"""The ellipsoids that shall hold these shares of the true poses."""
MOST_LOG_FREEDOM = 5.0
"""Largest logarithm of the degrees of freedom: Student's t is then the normal distribution."""
LEAST_RATIO = 0.1
"""The last factor lowers variances at most to this share."""
LEAST_VALUE = 1e-6
"""The least variance in units of the typical one."""


@dataclass(frozen=True)
class CovarianceModel:
    """Turns the covariance of a registration into a calibrated one.

    In units of the typical deviations, the covariance is raised to a power: a direction that is
    held less than usual is off by more than its deviation says. Then each group of AXES is scaled.
    """

    typical: tuple[float, ...]
    """(group,) the deviation that a registration typically has: radians, then metres."""
    scales: tuple[float, ...]
    """(group,) the factor on the deviations."""
    power: float
    """The power of the covariance."""

    def calibrated(self, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
        """The calibrated covariance of covariances (…, 6, 6), in their order and frame.

        A covariance that is not finite stays as it is.
        """
        is_finite = np.isfinite(covariance).all(axis=(-1, -2), keepdims=True)
        typical = np.array(self.typical)[AXES]
        values, vectors = _spectrum(np.where(is_finite, covariance, np.eye(DIMENSIONS)), typical)
        scaled = vectors * (np.array(self.scales)[AXES] * typical)[:, None]
        calibrated = (scaled * values[..., None, :] ** self.power) @ np.swapaxes(scaled, -1, -2)
        return np.where(is_finite, calibrated, covariance)

    @classmethod
    def learned(
        cls,
        errors: NDArray[np.float64],
        covariances: NDArray[np.float64],
        weight: NDArray[np.float64],
        start: Self,
    ) -> Self:
        """The model that the errors (n, 6) of right fixes and their covariances (n, 6, 6) teach.

        An error is a small turn in radians, then a step in metres, in the frame of the covariance.
        `weight` (n,) is the number of independent queries that a fix counts for. Scales and power
        are those of the largest likelihood of Student's t, whose degrees of freedom are learned
        too, since a few errors are large; they stray little from those of `start`. Then one factor
        on all covariances makes the ellipsoids of SHARES hold these shares of the errors.
        """
        if len(errors) < FEWEST:
            return start
        from scipy.optimize import minimize  # imported here, since a robot does not learn

        deviations = np.sqrt(np.median(covariances[:, range(6), range(6)], axis=0))
        typical = np.array([deviations[group == AXES].mean() for group in range(GROUPS)])
        values, vectors = _spectrum(covariances, typical[AXES])
        log_values = np.log(values)
        first = np.array([*np.log(start.scales), np.log(start.power), 1.0])

        def squares(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
            """The normalised squared error (n,)."""
            scaled = errors / (np.exp(parameters[:GROUPS])[AXES] * typical[AXES])
            along = np.einsum("nxk,nx->nk", vectors, scaled)
            return np.asarray(
                (along**2 * np.exp(-np.exp(parameters[GROUPS]) * log_values)).sum(axis=1)
            )

        def loss(parameters: NDArray[np.float64]) -> float:
            """The negative log likelihood, and how far the parameters stray."""
            freedom = 1 + np.exp(min(parameters[-1], MOST_LOG_FREEDOM))
            log_deviations = (
                parameters[:GROUPS][AXES].sum()
                + np.exp(parameters[GROUPS]) * log_values.sum(axis=1) / 2
            )
            each = log_deviations - _log_student(squares(parameters), freedom)
            strayed = (parameters - first) / STRAY
            return float(weight @ each + strayed @ strayed / 2)

        found = minimize(loss, first, method="L-BFGS-B").x
        ratios = _quantiles(squares(found), weight, SHARES) / largest_squares(SHARES)
        ratios = ratios.clip(LEAST_RATIO, None)
        factor = np.exp(np.log(ratios).mean() / 2)
        return cls(
            tuple(typical.tolist()),
            tuple((factor * np.exp(found[:GROUPS])).tolist()),
            float(np.exp(found[GROUPS])),
        )


USUAL = CovarianceModel((7e-4, 3.7e-4, 0.0097, 0.0032), (1.9, 1.5, 1.55, 1.15), 1.3)
"""The model of maps without validation blocks, from which learning starts; learned on a simulated
campus (seed 5)."""


def pose_errors(world_T_query: Poses, world_T_true: Poses) -> NDArray[np.float64]:
    """The error (n, 6) of poses (n, 4, 4): a turn in radians, then a step, in the query's frame."""
    query_T_true = np.linalg.inv(world_T_query) @ world_T_true
    turns = Rotation.from_matrix(query_T_true[:, :3, :3]).as_rotvec()
    return np.concatenate([turns, query_T_true[:, :3, 3]], axis=1)


def normalised_squares(
    errors: NDArray[np.float64], covariances: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The squared errors (n,) of errors (n, d), normalised by their covariances (n, d, d)."""
    whitened = np.linalg.solve(covariances, errors[:, :, None])[:, :, 0]
    return np.asarray((errors * whitened).sum(axis=1))


def largest_squares(shares: Sequence[float], dimensions: int = DIMENSIONS) -> NDArray[np.float64]:
    """The normalised squared errors (share,) of the ellipsoids that hold these shares."""
    return np.asarray(chdtri(dimensions, 1 - np.array(shares)))


def _spectrum(
    covariances: NDArray[np.float64], typical: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Eigenvalues (…, 6) and eigenvectors (…, 6, 6) of covariances in units of deviations (6,)."""
    values, vectors = np.linalg.eigh(covariances / typical[:, None] / typical)
    return values.clip(LEAST_VALUE, None), vectors


def _log_student(squares: NDArray[np.float64], freedom: float) -> NDArray[np.float64]:
    """The log density (n,) of Student's t at squared distances (n,), without constants."""
    return np.asarray(
        gammaln((freedom + DIMENSIONS) / 2)
        - gammaln(freedom / 2)
        - DIMENSIONS / 2 * np.log(freedom)
        - (freedom + DIMENSIONS) / 2 * np.log1p(squares / freedom)
    )


def _quantiles(
    values: NDArray[np.float64], weight: NDArray[np.float64], shares: Sequence[float]
) -> NDArray[np.float64]:
    """The least values (share,) that hold these shares of the weight (n,) of values (n,)."""
    order = np.argsort(values)
    held = np.cumsum(weight[order]) / weight.sum()
    return np.asarray(values[order][np.searchsorted(held, shares).clip(max=len(values) - 1)])
