"""A pose graph of a drive, optimised at once (METHODS 9.9).

Odometry joins its queries, fixes are constraints.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.frames import Poses, distance_and_turn
from pipeline.core.settings import Positive, check
from pipeline.paths.belief import REPEATS
from pipeline.paths.tracks import Estimates, Track
from pipeline.posing.verdict import RIGHT_DEG, RIGHT_M


@dataclass(frozen=True)
class Graph:
    """Binds a day's odometry to the map by fixes: the future work of Yin et al. (IROS 2018)."""

    verdict: bool
    """Whether only fixes that keep a promise of .99 are constraints; otherwise all are."""
    drift: Positive
    """Standard deviation of a step of odometry, as a share of its length."""
    turn_deg_per_m: Positive
    """Standard deviation of the turn in a step of odometry."""
    fix_m: Positive
    """Standard deviation of a right fix, added to its own covariance: the map's poses are not exact
    either."""
    fix_deg: Positive
    outlier: Positive
    """From so many standard deviations on a constraint loses its weight (Cauchy)."""

    def __post_init__(self) -> None:
        check(self, "path")

    def along(self, track: Track) -> Estimates:
        """Estimate each query from the whole drive, past and future.

        A stretch without odometry or without a fix to believe has no estimates.
        """
        poses = np.full_like(track.world_T_query, np.nan)
        chances = np.zeros(len(track.chance))
        broken = np.flatnonzero(~np.isfinite(track.steps).all((1, 2))) + 1
        for stretch in np.split(np.arange(len(poses)), broken):
            fix_rows = stretch[np.isfinite(track.world_T_query[stretch]).all((1, 2))]
            fix_rows = fix_rows[track.accepted[fix_rows]] if self.verdict else fix_rows
            if len(fix_rows) and np.isfinite(track.odom_T_query[stretch]).all():
                agreeing_rows, chance = self.agreeing_fixes(track, fix_rows)
                poses[stretch], within = self.optimised_poses(
                    track, stretch, fix_rows, agreeing_rows
                )
                chances[stretch] = chance * within
        return Estimates(poses, chances)

    def agreeing_fixes(
        self, track: Track, fix_rows: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], float]:
        """The largest set of fixes that agree with one of them by odometry, and their chance.

        It is the chance that they are right: each is with its own chance; wrong ones agree with the
        first by REPEATS.
        """
        odom = track.odom_T_query[fix_rows]
        world = track.world_T_query[fix_rows]
        along_m = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(odom[:, :2, 3], axis=0), axis=1))]
        )
        sets = []
        for reference in range(len(fix_rows)):
            away_m, turn_deg = distance_and_turn(
                world[reference] @ np.linalg.inv(odom[reference]) @ odom, world
            )
            reach_m = np.abs(along_m - along_m[reference])
            near = (away_m < RIGHT_M + 3 * self.drift * reach_m) & (
                turn_deg < RIGHT_DEG + 3 * self.turn_deg_per_m * reach_m
            )
            sets.append(fix_rows[near])
        agreeing_rows = max(sets, key=lambda rows: float(track.chance[rows].sum()))
        chance = track.chance[agreeing_rows].clip(1e-6, 1 - 1e-6)
        odds = np.log(chance / (1 - chance)).sum() - (len(chance) - 1) * np.log(REPEATS)
        return agreeing_rows, float(1 / (1 + np.exp(-np.clip(odds, -50, 50))))

    def optimised_poses(
        self,
        track: Track,
        stretch: NDArray[np.int64],
        fix_rows: NDArray[np.int64],
        agreeing_rows: NDArray[np.int64],
    ) -> tuple[Poses, NDArray[np.float64]]:
        """The poses (n, 4, 4) of a stretch, and the chance (n,) that each lies within RIGHT_M.

        The chance holds if the fixes that agree are right.
        """
        gtsam = imported_gtsam()
        graph = gtsam.NonlinearFactorGraph()
        values = gtsam.Values()
        nearest = agreeing_rows[np.abs(stretch[:, None] - agreeing_rows[None]).argmin(1)]
        for row, fix in zip(stretch.tolist(), nearest.tolist(), strict=True):
            start = (
                track.world_T_query[fix]
                @ np.linalg.inv(track.odom_T_query[fix])
                @ track.odom_T_query[row]
            )
            values.insert(row, gtsam.Pose3(start))
        for previous in stretch[:-1].tolist():
            step = track.steps[previous]
            length_m = float(np.linalg.norm(step[:3, 3])) + self.fix_m / 10
            sds = np.repeat([np.deg2rad(self.turn_deg_per_m), self.drift], 3) * length_m
            graph.add(
                gtsam.BetweenFactorPose3(
                    previous, previous + 1, gtsam.Pose3(step), gtsam.noiseModel.Diagonal.Sigmas(sds)
                )
            )
        floor = np.diag(np.repeat([np.deg2rad(self.fix_deg), self.fix_m], 3) ** 2)
        robust = gtsam.noiseModel.mEstimator.Cauchy.Create(self.outlier)
        for row in fix_rows.tolist():
            noise = gtsam.noiseModel.Gaussian.Covariance(track.covariance[row] + floor)
            pose = gtsam.Pose3(track.world_T_query[row])
            graph.add(
                gtsam.PriorFactorPose3(row, pose, gtsam.noiseModel.Robust.Create(robust, noise))
            )
        solution = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
        spread = gtsam.Marginals(graph, solution)
        variance_m2 = np.array(
            [np.trace(spread.marginalCovariance(row)[3:5, 3:5]) / 2 for row in stretch.tolist()]
        )
        poses = np.array([solution.atPose3(row).matrix() for row in stretch.tolist()])
        return poses, 1 - np.exp(-(RIGHT_M**2) / (2 * variance_m2))


def imported_gtsam() -> Any:
    """Import gtsam, which no other part needs; raises ConfigError where it is not installed."""
    try:
        import gtsam
    except ImportError:
        raise ConfigError("gtsam: not installed; `pip install 'yearloc[graph]'` (113 MB)") from None
    return gtsam
