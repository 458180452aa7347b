"""What is believed of a robot along its path: poses with chances, and "anywhere else", unseen places included (METHODS 10.2)."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from pipeline.frames import Poses, apart
from pipeline.posing.verdict import RIGHT_DEG, RIGHT_M

DRIFT, TURN_DEG_PER_M = 0.05, 0.1
"""Standard deviations of the odometry: of a step as a share of it, and of the heading."""
JUMPS = 0.001
"""Chance a scan to be carried anywhere."""
REPEATS = 0.3
"""How often a wrong pose is followed by one that agrees with it: assumed, not learned."""
FORGOTTEN = 1e-5
GUESS_M = 40.0
"""A guessed step is as uncertain as so much odometry."""
DEVIATIONS = 3.0


@dataclass
class Belief:
    """Forward Bayes over poses that fixes have named; nothing is known at first."""

    unseen_share: float = 0.2
    """Of queries to expect where the map is not, as the verdict was learned with (METHODS 9.5)."""
    poses: Poses = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """(hypothesis, 4, 4) in the world, each carried on by odometry since its last fix."""
    chances: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) that the robot is there, give or take the drift since; what lacks of 1 is anywhere else."""
    driven_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) since that fix."""

    def move(self, step: Poses, guessed: bool = False) -> None:
        """After the robot moved by `step` (4, 4), its new pose in the old one's frame, by odometry or guessed."""
        self.poses, self.chances = self.poses @ step, (1 - JUMPS) * self.chances
        self.driven_m = self.driven_m + (GUESS_M if guessed else float(np.linalg.norm(step[:3, 3])))

    def see(self, world_T_robot: Poses, chance: float, tracked: bool = False) -> float:
        """A pose was measured that is right with this chance; returns the chance that it is right now, given all before.

        Of a robot that may be anywhere the chance stays what it was. A hypothesis that the pose agrees with is for it, but wrong
        poses repeat themselves, as the next scan shows the same look-alike: REPEATS of them agree too. A `tracked` pose was
        sought where it was believed: that it agrees says nothing, only its chance does, against that of a usual fix.
        """
        elsewhere = 1 - float(self.chances.sum())
        away_m, turn_deg = apart(self.poses, np.broadcast_to(world_T_robot, self.poses.shape))
        near_m, near_deg = (DEVIATIONS * drift * self.driven_m for drift in (DRIFT, TURN_DEG_PER_M))
        agrees = (away_m < RIGHT_M + near_m) & (turn_deg < RIGHT_DEG + near_deg)
        repeated = (1 - self.unseen_share) / self.unseen_share if tracked else REPEATS
        right = chance * (elsewhere + float(self.chances[agrees].sum()) / repeated)
        others = (1 - chance) * self.chances
        whole = right + float(others[~agrees].sum()) + (1 - chance) * elsewhere
        kept = ~agrees & (others > FORGOTTEN * whole)
        self.poses = np.concatenate([self.poses[kept], world_T_robot[None]])
        self.driven_m = np.append(self.driven_m[kept], 0.0)
        self.chances = np.append(others[kept], right) / whole
        return right / whole

    def best(self) -> tuple[Poses, float] | None:
        """The pose that is likeliest within RIGHT_M of the robot's, drift heeded, and the chance that it is; None at first."""
        if not len(self.chances):
            return None
        chances = self.chances * still_right(self.driven_m)
        likeliest = int(chances.argmax())
        return self.poses[likeliest], float(chances[likeliest])


def still_right(driven_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The chance that a pose carried so far by drifting odometry is still within RIGHT_M, the way that it drifts most."""
    return np.asarray(erf(RIGHT_M / (np.sqrt(2) * DRIFT * np.maximum(driven_m, 1e-9))))
