"""The belief in where a robot is along its path (METHODS 10.2).

It consists of poses with chances, and of "anywhere else", unseen places included.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from pipeline.core.frames import Poses, distance_and_turn
from pipeline.posing.verdict import RIGHT_DEG, RIGHT_M

DRIFT = 0.05
TURN_DEG_PER_M = 0.1
"""Standard deviations of the odometry: of a step as a share of it, and of the heading."""
JUMPS = 0.001
"""Chance at each scan that the robot was carried anywhere."""
REPEATS = 0.3
"""How often a wrong pose lies where one was believed, repeating it or having slipped from it:
assumed, not learned."""
FORGOTTEN = 1e-5
DEVIATIONS = 3.0


@dataclass
class Belief:
    """A forward Bayes filter over the poses that fixes have named; it begins empty."""

    unseen_share: float = 0.2
    """Share of queries to expect outside the map, as the verdict was learned with (METHODS 9.5)."""
    poses: Poses = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """(hypothesis, 4, 4) in the world, each carried on by odometry since its last fix."""
    chances: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) that the robot is there, give or take the drift since; what lacks of 1 is
    anywhere else."""
    drift_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) how far it may have drifted since that fix: a standard deviation."""
    drift_deg: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) how far its heading may have drifted since that fix: a standard deviation."""

    def move(self, step: Poses, doubt: tuple[float, float] | None = None) -> None:
        """Move all hypotheses by `step` (4, 4): the new pose in the old one's frame, by odometry.

        A step that was guessed has standard deviations of its own: `doubt` in metres and degrees.
        """
        step_m = float(np.linalg.norm(step[:3, 3]))
        doubt_m, doubt_deg = (DRIFT * step_m, TURN_DEG_PER_M * step_m) if doubt is None else doubt
        self.poses = self.poses @ step
        self.chances = (1 - JUMPS) * self.chances
        self.drift_m = self.drift_m + doubt_m
        self.drift_deg = self.drift_deg + doubt_deg

    def see(self, world_T_robot: Poses, chance: float, tracked: bool = False) -> float:
        """Add a measured pose that is right with `chance`; returns its chance given all before.

        Of a robot that may be anywhere the chance stays what it was. A hypothesis that may have
        drifted to the pose is for it, but wrong poses repeat themselves, as the next scan shows the
        same look-alike: REPEATS of them lie there too. A `tracked` pose was sought where it was
        believed: that it lies there says nothing, only its chance does, against that of a usual
        fix. And a pose may have slipped along a street, wrong though the robot is where it was
        believed: all but one that lies within RIGHT_M of a hypothesis that drift has left right.
        """
        elsewhere = 1 - float(self.chances.sum())
        away_m, turn_deg = distance_and_turn(
            self.poses, np.broadcast_to(world_T_robot, self.poses.shape)
        )
        near = (away_m < RIGHT_M + DEVIATIONS * self.drift_m) & (
            turn_deg < RIGHT_DEG + DEVIATIONS * self.drift_deg
        )
        agrees = near & (away_m < RIGHT_M)
        repeated = (1 - self.unseen_share) / self.unseen_share if tracked else REPEATS
        right_weight = chance * (elsewhere + float(self.chances[near].sum()) / repeated)
        other_weights = (1 - chance) * self.chances
        other_weights[near] *= REPEATS / repeated
        other_weights[agrees] *= 1 - still_right(self.drift_m[agrees])
        total_weight = right_weight + (1 - chance) * elsewhere + float(other_weights.sum())
        kept = ~agrees & (other_weights > FORGOTTEN * total_weight)
        self.poses = np.concatenate([self.poses[kept], world_T_robot[None]])
        self.drift_m = np.append(self.drift_m[kept], 0.0)
        self.drift_deg = np.append(self.drift_deg[kept], 0.0)
        self.chances = np.append(other_weights[kept], right_weight) / total_weight
        return right_weight / total_weight

    def slipped_m2(self) -> NDArray[np.float64]:
        """The covariance (3, 3) of the last pose's possible slip in the world, in square metres.

        Each hypothesis that it may have slipped from counts with its chance, its distance and its
        drift.
        """
        off_m = self.poses[:-1, :3, 3] - self.poses[-1, :3, 3]
        near = np.linalg.norm(off_m, axis=1) < RIGHT_M + DEVIATIONS * self.drift_m[:-1]
        chances = np.where(near, self.chances[:-1], 0.0)
        apart_m2 = np.einsum("n,ni,nj->ij", chances, off_m, off_m)
        return np.asarray(apart_m2 + float((chances * self.drift_m[:-1] ** 2).sum()) * np.eye(3))

    def best(self) -> tuple[Poses, float] | None:
        """The pose most likely within RIGHT_M of the robot's, with its chance; None at first.

        The chance takes account of drift.
        """
        if not len(self.chances):
            return None
        chances = self.chances * still_right(self.drift_m)
        likeliest = int(chances.argmax())
        return self.poses[likeliest], float(chances[likeliest])


def still_right(drift_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The chance that a pose which has drifted is still within RIGHT_M.

    `drift_m` is its standard deviation in the direction of most drift.
    """
    return np.asarray(erf(RIGHT_M / (np.sqrt(2) * np.maximum(drift_m, 1e-9))))
