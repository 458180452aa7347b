"""A Bayes filter over the poses that a robot may have along its path (METHODS 10.2).

Steps of odometry and fixes with chances go in, one scan after the other; the likeliest pose and its
chance come out, given all scans so far. The filter holds a few hypotheses, poses with chances that
earlier fixes have named. What their chances lack of 1 is that of "elsewhere": any other pose, and
any place outside the map.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from pipeline.core.frames import Poses, distance_and_turn
from pipeline.posing.verdict import RIGHT_DEG, RIGHT_M

DRIFT = 0.05
TURN_DEG_PER_M = 0.1
"""Standard deviations of odometry: of a step, as a share of its length; of the heading, for each
metre."""
DEVIATIONS = 3.0
"""A hypothesis may have drifted by so many standard deviations."""
JUMP_CHANCE = 0.001
"""The chance at each scan that the robot was carried off."""
REPEAT_SHARE = 0.3
"""The share of wrong fixes that lie near a hypothesis: the next scan may show the same look-alike,
or the fix may have slipped along a street. It is assumed, not learned."""
LEAST_CHANCE = 1e-6
"""No fix is taken for surely wrong, nor for surely right: its chance is this far from 0 and 1."""
FORGOTTEN_CHANCE = 1e-5
"""A hypothesis of a smaller chance is dropped."""


@dataclass
class Belief:
    """The hypotheses about where a robot is; at first there are none."""

    unseen_share: float = 0.2
    """The share of queries to expect outside the map, as in the site's verdict (METHODS 9.5)."""
    poses: Poses = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """(hypothesis, 4, 4) in the world: a fix, carried on by odometry since."""
    chances: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) the chance that the robot is there, within the drift since the fix."""
    drift_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) standard deviation of the position by odometry since the fix."""
    drift_deg: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) standard deviation of the heading by odometry since the fix."""

    def move(self, step: Poses, doubt: tuple[float, float] | None = None) -> None:
        """Move all hypotheses by `step` (4, 4): the new pose in the frame of the old one.

        `doubt` holds the standard deviations of a step that was guessed, in metres and degrees; by
        default they are those of odometry.
        """
        if doubt is None:
            step_m = float(np.linalg.norm(step[:3, 3]))
            doubt = (DRIFT * step_m, TURN_DEG_PER_M * step_m)
        doubt_m, doubt_deg = doubt
        self.poses = self.poses @ step
        self.chances = (1 - JUMP_CHANCE) * self.chances
        self.drift_m = self.drift_m + doubt_m
        self.drift_deg = self.drift_deg + doubt_deg

    def see(self, world_T_robot: Poses, chance: float, tracked: bool = False) -> float:
        """Add the pose (4, 4) of a fix, right with `chance` by its scan alone.

        Returns the chance that it is right given all scans before. Each way in which things may be
        has a weight, and its chance is its share of their sum:

        - The fix is right, and the robot was elsewhere before, or at a hypothesis near the fix. A
          near hypothesis speaks for the fix, since few wrong fixes lie near one (REPEAT_SHARE). Not
          for a `tracked` fix, which was sought near a hypothesis.
        - The fix is wrong, and the robot is elsewhere, or at a hypothesis: at one near the fix, if
          the fix has slipped from it; at one that agrees with the fix, being within RIGHT_M of it,
          only if drift has left that hypothesis wrong too.

        The fix becomes a hypothesis in place of those that agree with it.
        """
        elsewhere = 1 - float(self.chances.sum())
        away_m, turn_deg = distance_and_turn(
            self.poses, np.broadcast_to(world_T_robot, self.poses.shape)
        )
        near = (away_m < RIGHT_M + DEVIATIONS * self.drift_m) & (
            turn_deg < RIGHT_DEG + DEVIATIONS * self.drift_deg
        )
        agrees = near & (away_m < RIGHT_M)
        # v of METHODS 10.2: the share of wrong fixes that lie near a hypothesis. A tracked fix lies
        # there in any case, so only its chance counts, against that of a usual query.
        repeat_share = (1 - self.unseen_share) / self.unseen_share if tracked else REPEAT_SHARE
        right_weight = chance * (elsewhere + float(self.chances[near].sum()) / repeat_share)
        hypothesis_weights = (1 - chance) * self.chances
        hypothesis_weights[near] *= REPEAT_SHARE / repeat_share
        hypothesis_weights[agrees] *= 1 - still_right(self.drift_m[agrees])
        elsewhere_weight = (1 - chance) * elsewhere
        total = right_weight + elsewhere_weight + float(hypothesis_weights.sum())

        stays = ~agrees & (hypothesis_weights > FORGOTTEN_CHANCE * total)
        self.poses = np.concatenate([self.poses[stays], world_T_robot[None]])
        self.drift_m = np.append(self.drift_m[stays], 0.0)
        self.drift_deg = np.append(self.drift_deg[stays], 0.0)
        self.chances = np.append(hypothesis_weights[stays], right_weight) / total
        return right_weight / total

    def slipped_m2(self) -> NDArray[np.float64]:
        """The covariance (3, 3) by which the last fix may have slipped, in the world, in m².

        It sums up the hypotheses that the fix may have slipped from: their distances and drifts,
        each weighted by its chance.
        """
        off_m = self.poses[:-1, :3, 3] - self.poses[-1, :3, 3]
        near = np.linalg.norm(off_m, axis=1) < RIGHT_M + DEVIATIONS * self.drift_m[:-1]
        chances = np.where(near, self.chances[:-1], 0.0)
        apart_m2 = np.einsum("n,ni,nj->ij", chances, off_m, off_m)
        return np.asarray(apart_m2 + float((chances * self.drift_m[:-1] ** 2).sum()) * np.eye(3))

    def best(self) -> tuple[Poses, float] | None:
        """The pose (4, 4) most likely within RIGHT_M of the robot's, and the chance that it is.

        None before any fix.
        """
        if not len(self.chances):
            return None
        chances = self.chances * still_right(self.drift_m)
        likeliest = int(chances.argmax())
        return self.poses[likeliest], float(chances[likeliest])


def still_right(drift_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The chance that a right pose is within RIGHT_M still, after it has drifted.

    `drift_m` is the standard deviation of the drift along its main direction.
    """
    return np.asarray(erf(RIGHT_M / (np.sqrt(2) * np.maximum(drift_m, 1e-9))))
