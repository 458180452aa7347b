"""Graph: the poses of a drive's queries by a pose graph of the whole drive (METHODS 9.9).

1. Split the drive into stretches without a break in odometry, each with its fixes.
2. Find the likeliest set of fixes that agree with one of them by odometry, and the probability that
   they are right.
3. Optimise the poses of all queries (gtsam): steps of odometry are factors between neighbours, and
   fixes are priors.
4. The probability of a query's pose is the probability of the agreeing fixes, times the probability
   that the position is right by its covariance in the graph.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import RIGHT_WITHIN, Poses, distance_and_turn, travelled_m
from pipeline.core.settings import Positive, checked
from pipeline.paths.belief import DEVIATIONS, LEAST_PROBABILITY, REPEAT_SHARE
from pipeline.paths.pose_graph import PoseGraph
from pipeline.paths.tracks import Estimates, Track

RIGHT_M, RIGHT_DEG = RIGHT_WITHIN


@dataclass(frozen=True)
@checked("path")
class Graph:
    """Joins a day's odometry with the map by fixes: the future work of Yin et al. (IROS 2018).

    Its fields are the keys of conf/path/graph.yaml.
    """

    verdict: bool
    """Whether only accepted fixes, at a target precision of .99, are priors; otherwise all are."""
    drift: Positive
    """Standard deviation of a step of odometry, as a share of its length."""
    turn_deg_per_m: Positive
    """Standard deviation of the turn in a step of odometry, per metre of its length."""
    fix_m: Positive
    fix_deg: Positive
    """Standard deviations of a right fix, added to its own covariance: the map is not exact."""
    outlier: Positive
    """A fix that is off by more deviations than this loses weight (Cauchy's loss)."""

    def along(self, track: Track) -> Estimates:
        """Estimate each query from the whole drive, past and future.

        A stretch without odometry, or without a fix that is used, has no estimates.
        """
        poses = np.full_like(track.world_T_query, np.nan)
        probabilities = np.zeros(len(track.probability))
        has_fix = np.asarray(np.isfinite(track.world_T_query).all((1, 2)))
        if self.verdict:
            has_fix = has_fix & track.accepted
        breaks = np.flatnonzero(~np.isfinite(track.steps).all((1, 2))) + 1
        for stretch in np.split(np.arange(len(poses)), breaks):
            fix_rows = stretch[has_fix[stretch]]
            if len(fix_rows) and np.isfinite(track.odom_T_query[stretch]).all():
                agreeing_rows, probability_right = self.agreeing_fixes(track, fix_rows)
                poses[stretch], probability_within = self.optimised_poses(
                    track, stretch, fix_rows, agreeing_rows
                )
                probabilities[stretch] = probability_right * probability_within
        return Estimates(poses, probabilities, probabilities)

    def agreeing_fixes(
        self, track: Track, fix_rows: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], float]:
        """The likeliest set of fixes (n,) that agree with one of them by odometry.

        Returns their rows, and the probability that they are right. Each fix is right with its own
        probability c, and the share REPEAT_SHARE of wrong fixes agrees with the first. So the odds
        of "all right" against "all wrong" are the product of all c / (1 − c), divided by
        REPEAT_SHARE for each fix but the first.
        """
        odom_T_fix = track.odom_T_query[fix_rows]
        world_T_fix = track.world_T_query[fix_rows]
        path_m = travelled_m(odom_T_fix[:, :2, 3])
        sets = []
        for reference in range(len(fix_rows)):
            world_T_odom = world_T_fix[reference] @ np.linalg.inv(odom_T_fix[reference])
            away_m, turn_deg = distance_and_turn(world_T_odom @ odom_T_fix, world_T_fix)
            between_m = np.abs(path_m - path_m[reference])
            most_m = RIGHT_M + DEVIATIONS * self.drift * between_m
            most_deg = RIGHT_DEG + DEVIATIONS * self.turn_deg_per_m * between_m
            sets.append(fix_rows[(away_m < most_m) & (turn_deg < most_deg)])
        agreeing_rows = max(sets, key=lambda rows: float(track.probability[rows].sum()))
        probability = track.probability[agreeing_rows].clip(
            LEAST_PROBABILITY, 1 - LEAST_PROBABILITY
        )
        log_odds = np.log(probability / (1 - probability)).sum() - (len(probability) - 1) * np.log(
            REPEAT_SHARE
        )
        bounded = np.clip(log_odds, -50, 50)  # so that exp does not overflow
        return agreeing_rows, float(1 / (1 + np.exp(-bounded)))

    def optimised_poses(
        self,
        track: Track,
        stretch: NDArray[np.int64],
        fix_rows: NDArray[np.int64],
        agreeing_rows: NDArray[np.int64],
    ) -> tuple[Poses, NDArray[np.float64]]:
        """Optimise the poses of the queries `stretch` (n,), with the fixes `fix_rows` as priors.

        Returns the poses (n, 4, 4), and the probability (n,) that each lies within RIGHT_M if the
        agreeing fixes are right.
        """
        # each query starts at its pose by odometry from the nearest agreeing fix
        nearest = agreeing_rows[np.abs(stretch[:, None] - agreeing_rows[None]).argmin(1)]
        world_T_odom = track.world_T_query[nearest] @ np.linalg.inv(track.odom_T_query[nearest])
        graph = PoseGraph(stretch, world_T_odom @ track.odom_T_query[stretch])
        # steps of odometry; the added length lets a step of no length deviate a little, too
        for previous in stretch[:-1].tolist():
            step = track.steps[previous]
            length_m = float(np.linalg.norm(step[:3, 3])) + self.fix_m / 10
            sds = np.repeat([np.deg2rad(self.turn_deg_per_m), self.drift], 3) * length_m
            graph.join(previous, previous + 1, step, graph.deviations(sds))
        for row in fix_rows.tolist():
            noise = graph.robust(track.covariance[row], self.fix_deg, self.fix_m, self.outlier)
            graph.hold(row, track.world_T_query[row], noise)
        poses = graph.solved()
        # the mean variance of x and y, in the query's frame; turns come first (3:5 are x and y)
        variance_m2 = np.trace(graph.covariances()[:, 3:5, 3:5], axis1=1, axis2=2) / 2
        # two equal Gaussian errors lie within r with the probability 1 − exp(−r² / 2σ²), Rayleigh's
        return poses, 1 - np.exp(-(RIGHT_M**2) / (2 * variance_m2))
