"""A Bayes filter over the poses that a robot may have along its path (METHODS 10.2).

Steps of odometry and fixes with probabilities go in, one scan after the other; the likeliest pose
and its probability come out, given all scans so far. The filter holds a few hypotheses, poses with
probabilities that earlier fixes have named. What their probabilities lack of 1 is that of
"elsewhere": any other pose, and any place outside the map.
"""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from pipeline.core.frames import RIGHT_WITHIN, Poses, distance_and_turn

RIGHT_M, RIGHT_DEG = RIGHT_WITHIN
DRIFT = 0.05
TURN_DEG_PER_M = 0.1
"""Standard deviations of odometry: of a step, as a share of its length; of the heading, for each
metre."""
DEVIATIONS = 3.0
"""A hypothesis may have drifted by so many standard deviations."""
JUMP_PROBABILITY = 0.001
"""The probability at each scan that the robot was carried off."""
REPEAT_SHARE = 0.3
"""The share of wrong fixes that lie near a hypothesis: the next scan may show the same perceptual
alias, or the fix may have slipped along a street. It is assumed, not learned."""
LEAST_PROBABILITY = 1e-6
"""No fix is taken for surely wrong, nor for surely right: its probability is this far from 0 and
1."""
NEW_VIEW_M = 0.5
"""A robot that has moved by less sees the same again: no new evidence."""
FORGOTTEN_PROBABILITY = 1e-5
"""A hypothesis of a smaller probability is dropped."""


@dataclass(frozen=True)
class Hypotheses:
    """Poses that the robot may have, with their probabilities."""

    poses: Poses = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """(hypothesis, 4, 4) in the world: a fix, carried on by odometry since."""
    probabilities: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) the probability that the robot is there, within the drift since the fix."""
    drift_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) standard deviation of the position by odometry since the fix."""
    drift_deg: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) standard deviation of the heading by odometry since the fix."""

    def moved(self, step: Poses, deviations: tuple[float, float], jump_probability: float) -> Self:
        """The hypotheses moved by `step` (4, 4), with the deviations and the probability of a
        jump."""
        deviations_m, deviations_deg = deviations
        return replace(
            self,
            poses=self.poses @ step,
            probabilities=(1 - jump_probability) * self.probabilities,
            drift_m=self.drift_m + deviations_m,
            drift_deg=self.drift_deg + deviations_deg,
        )

    def seen(
        self, world_T_robot: Poses, probability: float, tracked: bool, unseen_share: float
    ) -> Self:
        """The hypotheses given one more fix, which is the last of them: see `Belief.see`."""
        elsewhere = 1 - float(self.probabilities.sum())
        away_m, turn_deg = distance_and_turn(
            self.poses, np.broadcast_to(world_T_robot, self.poses.shape)
        )
        near = (away_m < RIGHT_M + DEVIATIONS * self.drift_m) & (
            turn_deg < RIGHT_DEG + DEVIATIONS * self.drift_deg
        )
        agrees = near & (away_m < RIGHT_M)
        # v of METHODS 10.2: the share of wrong fixes that lie near a hypothesis. A tracked fix lies
        # there in any case, so only its probability counts, against that of a usual query.
        repeat_share = (1 - unseen_share) / unseen_share if tracked else REPEAT_SHARE
        right_weight = probability * (
            elsewhere + float(self.probabilities[near].sum()) / repeat_share
        )
        hypothesis_weights = (1 - probability) * self.probabilities
        hypothesis_weights[near] *= REPEAT_SHARE / repeat_share
        hypothesis_weights[agrees] *= 1 - still_right(self.drift_m[agrees])
        elsewhere_weight = (1 - probability) * elsewhere
        total = right_weight + elsewhere_weight + float(hypothesis_weights.sum())

        stays = ~agrees & (hypothesis_weights > FORGOTTEN_PROBABILITY * total)
        return replace(
            self,
            poses=np.concatenate([self.poses[stays], world_T_robot[None]]),
            probabilities=np.append(hypothesis_weights[stays], right_weight) / total,
            drift_m=np.append(self.drift_m[stays], 0.0),
            drift_deg=np.append(self.drift_deg[stays], 0.0),
        )


@dataclass
class Belief:
    """What is believed about where a robot is; at first nothing.

    The same view without motion is no new evidence. So fixes count one on top of the other only if
    the robot has moved by NEW_VIEW_M between them. Each other one is weighed against what was
    believed before the last fix that counted, in place of that.
    """

    unseen_share: float = 0.2
    """The share of queries to expect outside the map, as in the site's verdict (METHODS 9.5)."""
    views: int = 0
    """How many fixes have counted."""
    now: Hypotheses = field(default_factory=Hypotheses)
    """Given all fixes, the last one included."""
    _counted: Hypotheses = field(default_factory=Hypotheses)  # given all that have counted
    _before: Hypotheses = field(default_factory=Hypotheses)  # given all of these but the last one
    _last_pose: Poses = field(default_factory=lambda: np.full((4, 4), np.nan))  # which is here
    _since: Poses = field(default_factory=lambda: np.eye(4))  # the motion since
    _is_guessed: bool = False  # whether a step of that motion was

    def move(self, step: Poses, deviations: tuple[float, float] | None = None) -> None:
        """Move all hypotheses by `step` (4, 4): the new pose in the frame of the old one.

        `deviations` holds the standard deviations of a step that was guessed, in metres and
        degrees; by default they are those of odometry.
        """
        self._is_guessed |= deviations is not None
        if deviations is None:
            step_m = float(np.linalg.norm(step[:3, 3]))
            deviations = (DRIFT * step_m, TURN_DEG_PER_M * step_m)
        self._since = self._since @ step
        is_same_view = not self._is_guessed and self._since_m < NEW_VIEW_M
        self.now = self.now.moved(step, deviations, JUMP_PROBABILITY)
        # a robot that stands is not lost by and by: the same view says that it is still there
        jump_probability = 0.0 if is_same_view else JUMP_PROBABILITY
        self._counted = self._counted.moved(step, deviations, jump_probability)
        self._before = self._before.moved(step, deviations, jump_probability)

    def see(self, world_T_robot: Poses, probability: float, tracked: bool = False) -> float:
        """Add the pose (4, 4) of a fix, right with `probability` by its scan alone.

        Returns the probability that it is right given all scans before. Each way in which things
        may be has a weight, and its probability is its share of their sum:

        - The fix is right, and the robot was elsewhere before, or at a hypothesis near the fix. A
          near hypothesis speaks for the fix, since few wrong fixes lie near one (REPEAT_SHARE). Not
          for a `tracked` fix, which was sought near a hypothesis.
        - The fix is wrong, and the robot is elsewhere, or at a hypothesis: at one near the fix, if
          the fix has slipped from it; at one that agrees with the fix, being within RIGHT_M of it,
          only if drift has left that hypothesis wrong too.

        The fix becomes a hypothesis in place of those that agree with it.
        """
        moved_m = self._since_m
        if self._is_guessed:
            moved_m = float(np.linalg.norm(world_T_robot[:3, 3] - self._last_pose[:3, 3]))
        if self.views and moved_m < NEW_VIEW_M:
            self.now = self._before.seen(world_T_robot, probability, tracked, self.unseen_share)
        else:
            self._before = self._counted
            self.now = self._before.seen(world_T_robot, probability, tracked, self.unseen_share)
            self._counted = self.now
            self._last_pose = world_T_robot
            self._since = np.eye(4)
            self._is_guessed = False
            self.views += 1
        return float(self.now.probabilities[-1])

    @property
    def _since_m(self) -> float:
        """How far the robot has moved since the last fix that counted."""
        return float(np.linalg.norm(self._since[:3, 3]))

    def slipped_m2(self) -> NDArray[np.float64]:
        """The covariance (3, 3) by which the last fix may have slipped, in the world, in m².

        It sums up the hypotheses that the fix may have slipped from: their distances and drifts,
        each weighted by its probability.
        """
        off_m = self.now.poses[:-1, :3, 3] - self.now.poses[-1, :3, 3]
        drift_m = self.now.drift_m[:-1]
        near = np.linalg.norm(off_m, axis=1) < RIGHT_M + DEVIATIONS * drift_m
        probabilities = np.where(near, self.now.probabilities[:-1], 0.0)
        apart_m2 = np.einsum("n,ni,nj->ij", probabilities, off_m, off_m)
        return np.asarray(apart_m2 + float((probabilities * drift_m**2).sum()) * np.eye(3))

    def best(self) -> tuple[Poses, float] | None:
        """The pose (4, 4) most likely within RIGHT_M of the robot's, and the probability that it
        is.

        None before any fix.
        """
        if not len(self.now.probabilities):
            return None
        probabilities = self.now.probabilities * still_right(self.now.drift_m)
        likeliest = int(probabilities.argmax())
        return self.now.poses[likeliest], float(probabilities[likeliest])


def still_right(drift_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The probability that a right pose is within RIGHT_M still, after it has drifted.

    `drift_m` is the standard deviation of the drift along its main direction.
    """
    return np.asarray(erf(RIGHT_M / (np.sqrt(2) * np.maximum(drift_m, 1e-9))))
