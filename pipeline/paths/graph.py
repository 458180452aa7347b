"""A pose graph of a drive: odometry between its queries, fixes as constraints, all optimised at
once (METHODS 9.9)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError
from pipeline.frames import Poses, apart
from pipeline.paths.belief import REPEATS
from pipeline.paths.tracks import Estimates, Track
from pipeline.posing.verdict import RIGHT_DEG, RIGHT_M
from pipeline.running.settings import Positive, check


@dataclass(frozen=True)
class Graph:
    """The future work of Yin et al. (IROS 2018): fixes bind a day's odometry to the map."""

    verdict: bool
    """Whether only fixes that keep a promise of .99 are constraints; otherwise all are."""
    drift: Positive
    """Standard deviation of a step of odometry, as a share of its length."""
    turn_deg_per_m: Positive
    """Standard deviation of its turn."""
    fix_m: Positive
    """Standard deviation of a right fix besides its own covariance: the map's poses are not exact
    either."""
    fix_deg: Positive
    outlier: Positive
    """From so many standard deviations on a constraint loses its weight (Cauchy)."""

    def __post_init__(self) -> None:
        check(self, "path")

    def along(self, track: Track) -> Estimates:
        """Estimates from the whole drive, future and past; a stretch without odometry or without a
        fix to believe has none."""
        poses = np.full_like(track.world_T_query, np.nan)
        chances = np.zeros(len(track.chance))
        broken = np.flatnonzero(~np.isfinite(track.steps).all((1, 2))) + 1
        for own in np.split(np.arange(len(poses)), broken):
            used = own[np.isfinite(track.world_T_query[own]).all((1, 2))]
            used = used[track.accepted[used]] if self.verdict else used
            if len(used) and np.isfinite(track.odom_T_query[own]).all():
                together, chance = self.agreeing(track, used)
                poses[own], within = self.optimised(track, own, used, together)
                chances[own] = chance * within
        return Estimates(poses, chances)

    def agreeing(self, track: Track, used: NDArray[np.int64]) -> tuple[NDArray[np.int64], float]:
        """The largest set of fixes that one of them and the odometry explain, and the chance that
        they are right.

        Each is right with its own chance; wrong ones agree with the first by REPEATS.
        """
        odom = track.odom_T_query[used]
        world = track.world_T_query[used]
        along_m = np.concatenate(
            [[0.0], np.cumsum(np.linalg.norm(np.diff(odom[:, :2, 3], axis=0), axis=1))]
        )
        sets = []
        for one in range(len(used)):
            away_m, turn_deg = apart(world[one] @ np.linalg.inv(odom[one]) @ odom, world)
            reach_m = np.abs(along_m - along_m[one])
            near = (away_m < RIGHT_M + 3 * self.drift * reach_m) & (
                turn_deg < RIGHT_DEG + 3 * self.turn_deg_per_m * reach_m
            )
            sets.append(used[near])
        together = max(sets, key=lambda one: float(track.chance[one].sum()))
        chance = track.chance[together].clip(1e-6, 1 - 1e-6)
        odds = np.log(chance / (1 - chance)).sum() - (len(chance) - 1) * np.log(REPEATS)
        return together, float(1 / (1 + np.exp(-np.clip(odds, -50, 50))))

    def optimised(
        self,
        track: Track,
        own: NDArray[np.int64],
        used: NDArray[np.int64],
        together: NDArray[np.int64],
    ) -> tuple[Poses, NDArray[np.float64]]:
        """Poses (n, 4, 4) of a stretch, and the chance of each to be within RIGHT_M if the fixes
        that agree are right."""
        gtsam = _gtsam()
        graph = gtsam.NonlinearFactorGraph()
        values = gtsam.Values()
        nearest = together[np.abs(own[:, None] - together[None]).argmin(1)]
        for row, fix in zip(own.tolist(), nearest.tolist(), strict=True):
            start = (
                track.world_T_query[fix]
                @ np.linalg.inv(track.odom_T_query[fix])
                @ track.odom_T_query[row]
            )
            values.insert(row, gtsam.Pose3(start))
        for before in own[:-1].tolist():
            step = track.steps[before]
            length_m = float(np.linalg.norm(step[:3, 3])) + self.fix_m / 10
            sds = np.repeat([np.deg2rad(self.turn_deg_per_m), self.drift], 3) * length_m
            graph.add(
                gtsam.BetweenFactorPose3(
                    before, before + 1, gtsam.Pose3(step), gtsam.noiseModel.Diagonal.Sigmas(sds)
                )
            )
        floor = np.diag(np.repeat([np.deg2rad(self.fix_deg), self.fix_m], 3) ** 2)
        robust = gtsam.noiseModel.mEstimator.Cauchy.Create(self.outlier)
        for row in used.tolist():
            noise = gtsam.noiseModel.Gaussian.Covariance(track.covariance[row] + floor)
            pose = gtsam.Pose3(track.world_T_query[row])
            graph.add(
                gtsam.PriorFactorPose3(row, pose, gtsam.noiseModel.Robust.Create(robust, noise))
            )
        found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
        spread = gtsam.Marginals(graph, found)
        variance_m2 = np.array(
            [np.trace(spread.marginalCovariance(row)[3:5, 3:5]) / 2 for row in own.tolist()]
        )
        poses = np.array([found.atPose3(row).matrix() for row in own.tolist()])
        return poses, 1 - np.exp(-(RIGHT_M**2) / (2 * variance_m2))


def _gtsam() -> Any:
    """The library, which no other part needs."""
    try:
        import gtsam
    except ImportError:
        raise ConfigError("gtsam: not installed; `pip install 'yearloc[graph]'` (113 MB)") from None
    return gtsam
