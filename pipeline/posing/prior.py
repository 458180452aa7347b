"""Priors: where a robot is before its scan is seen, as from GNSS or from a person (METHODS 10.5).

A prior narrows the search to poses within NARROW standard deviations of it, and weighs the
hypotheses that are found there and elsewhere:

- The score of a hypothesis is multiplied by a relative Gaussian of its distance from the prior: 1
  at the prior itself, and at least WRONG, since a prior may be wrong.
- "None is right" keeps its weight. So the error probability of a hypothesis is never smaller than
  if it were the only one: a prior takes weight from rivals, and gives none to anything.
- What lies outside of the prior is not searched. It counts as one more rival, which fits as well as
  the best hypothesis and has the weight WRONG. So no error probability is below WRONG.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import yaw

NARROW = 3.5
"""Poses farther from a prior than this many standard deviations are not searched for."""
WRONG = 1e-3
"""The least weight of a hypothesis, however far from the prior: priors may be wrong."""
LEAST_M = 0.5
LEAST_DEG = 3.0
"""Added in quadrature to a prior's standard deviations: a pose is hardly known better by hand."""
ROUNDING = 1e-9
"""A covariance may miss symmetry, or have a negative eigenvalue, by this share of its largest
entry."""


@dataclass(frozen=True, eq=False)
class Prior:
    """Where the robot is believed to be: a Gaussian of its position and, if known, its heading."""

    world_T_robot: NDArray[np.float64]
    """(4, 4) the pose of the frame that a scan's points are given in; only x, y and the heading are
    used."""
    covariance: NDArray[np.float64]
    """(2, 2) of x, y along the world's axes in m² if the heading is unknown, or (3, 3) of x, y and
    the heading in rad²."""

    def __post_init__(self) -> None:
        """Raises InputError for numbers that are not finite, for a variance that is not positive,
        and for a covariance that is not symmetric positive semi-definite."""
        pose, covariance = np.asarray(self.world_T_robot), np.asarray(self.covariance)
        for name, array, shapes in (
            ("pose", pose, ((4, 4),)),
            ("covariance", covariance, ((2, 2), (3, 3))),
        ):
            if array.shape not in shapes or array.dtype.kind not in "fiu":
                expected = " or ".join(map(str, shapes))
                raise InputError(
                    f"prior: a {name} of shape {array.shape} and type {array.dtype}: expected "
                    f"numbers {expected}"
                )
            if not np.isfinite(array).all():
                raise InputError(f"prior: its {name} has numbers that are not finite")
        variances = np.diag(covariance)
        if variances.min() <= 0:
            raise InputError(
                f"prior: a variance of {variances.min():g}: expected more than 0; leave the "
                "heading out if it is unknown"
            )
        rounding = ROUNDING * float(np.abs(covariance).max())
        is_symmetric = (np.abs(covariance - covariance.T) <= rounding).all()
        if not is_symmetric or np.linalg.eigvalsh(covariance)[0] < -rounding:
            raise InputError("prior: its covariance is not symmetric positive semi-definite")
        object.__setattr__(self, "world_T_robot", pose.astype(np.float64))
        object.__setattr__(self, "covariance", covariance.astype(np.float64))

    @classmethod
    def at(
        cls,
        x_m: float,
        y_m: float,
        heading_deg: float | None = None,
        sigma_m: float = 5.0,
        sigma_deg: float = 20.0,
    ) -> Self:
        """A prior at a position in the world, with standard deviations in metres and degrees.

        Without a heading, all headings are tried. Raises InputError for numbers that are not
        finite, and for a standard deviation that is not positive.
        """
        has_heading = heading_deg is not None
        sigmas = np.array([sigma_m, sigma_m, np.deg2rad(sigma_deg)])[: 3 if has_heading else 2]
        if not (sigmas > 0).all():
            raise InputError(
                f"prior: standard deviations of {sigma_m:g} m and {sigma_deg:g}°: expected more "
                "than 0"
            )
        heading_rad = np.deg2rad(heading_deg if heading_deg is not None else 0.0)
        pose = np.eye(4)
        cos, sin = np.cos(heading_rad), np.sin(heading_rad)
        pose[:2, :2] = [[cos, -sin], [sin, cos]]
        pose[:2, 3] = x_m, y_m
        return cls(pose, np.diag(sigmas**2))

    @property
    def xy_m(self) -> NDArray[np.float64]:
        """(2,) the position in the world."""
        return np.asarray(self.world_T_robot[:2, 3])

    @property
    def heading_rad(self) -> float | None:
        """The heading in the world; None if it is unknown."""
        return float(yaw(self.world_T_robot)) if len(self.covariance) == 3 else None

    @property
    def reach_m(self) -> float:
        """No pose farther from the position than this is searched for."""
        return NARROW * float(np.sqrt(np.linalg.eigvalsh(self._widened[:2, :2])[-1]))

    @property
    def reach_rad(self) -> float:
        """No pose turned by more than this is searched for; at most half a turn."""
        if self.heading_rad is None:
            return np.pi
        return min(NARROW * float(np.sqrt(self._widened[2, 2])), np.pi)

    def is_near(self, xy_m: NDArray[np.float64], beyond_m: float = 0.0) -> NDArray[np.bool_]:
        """Which positions (n, 2) are searched, or lie at most `beyond_m` farther."""
        return np.asarray(np.linalg.norm(xy_m - self.xy_m, axis=-1) <= self.reach_m + beyond_m)

    def is_towards(
        self, heading_rad: NDArray[np.float64], beyond_rad: float = 0.0
    ) -> NDArray[np.bool_]:
        """Which headings (n,) are searched, or are turned by at most `beyond_rad` more.

        A heading that is NaN is searched.
        """
        if self.heading_rad is None:
            return np.ones(np.shape(heading_rad), bool)
        turn_rad = np.abs(_wrapped(heading_rad - self.heading_rad))
        return np.asarray(~(turn_rad > self.reach_rad + beyond_rad))

    def log_weights(self, world_T_query: NDArray[np.float64]) -> NDArray[np.float64]:
        """The logarithm (n,) of the weight of each pose (n, 4, 4), from log WRONG to 0."""
        off = world_T_query[:, :2, 3] - self.xy_m
        if self.heading_rad is not None:
            off = np.column_stack([off, _wrapped(yaw(world_T_query) - self.heading_rad)])
        squares = np.vecdot(off, np.linalg.solve(self._widened, off.T).T)
        return np.asarray(np.maximum(-squares / 2, np.log(WRONG)))

    @cached_property
    def _widened(self) -> NDArray[np.float64]:
        """The covariance with LEAST_M and LEAST_DEG added."""
        least = np.array([LEAST_M, LEAST_M, np.deg2rad(LEAST_DEG)])[: len(self.covariance)]
        return np.asarray(self.covariance + np.diag(least**2))


def _wrapped(turn_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turns (n,) from −π to π."""
    return np.asarray((turn_rad + np.pi) % (2 * np.pi) - np.pi)
