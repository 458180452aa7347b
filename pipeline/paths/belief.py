"""A Bayes filter over the poses that a robot may have along its path (METHODS 10.2).

In: steps of odometry, and fixes with probabilities, one scan after the other. Out: the likeliest
pose and its probability, given all scans so far. The filter holds a few hypotheses: the poses of
earlier fixes, carried on by odometry, with their probabilities. The probabilities and that of
"elsewhere" (any other pose, and any place outside the map) add up to 1.
"""

from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from pipeline.core.frames import RIGHT_WITHIN, Poses, distance_and_turn

DRIFT = 0.05
TURN_DEG_PER_M = 0.1
"""Standard deviations of odometry: of a step, as a share of its length; of the heading, per
metre."""
DEVIATIONS = 3.0
"""A hypothesis may have drifted by this many standard deviations."""
JUMP_PROBABILITY = 0.001
"""The probability at each scan that the robot was carried to another place."""
REPEAT_SHARE = 0.3
"""The share of wrong fixes that lie near a hypothesis: the next scan may show the same perceptual
alias, or the fix may have slipped along a street. It is assumed, not learned."""
LEAST_PROBABILITY = 1e-6
"""No fix is surely wrong or surely right: its probability is at least this far from 0 and 1."""
NEW_VIEW_M = 0.5
"""A robot whose single scans are registered has the same view until it has moved so far; the same
view is no new evidence."""
LEAST_PROBABLE = 0.5
"""Along a path no pose is accepted that is less probable by its own scan, or given all scans."""
FORGOTTEN_PROBABILITY = 1e-5
"""A hypothesis of a smaller probability is dropped."""


@dataclass(frozen=True)
class Hypotheses:
    """Poses that the robot may have, with their probabilities."""

    poses: Poses = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """(hypothesis, 4, 4) poses in the world: fixes, carried on by odometry since."""
    probabilities: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) the probability that the robot is there, within the drift since the fix."""
    drift_m: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) standard deviation of the position by odometry since the fix."""
    drift_deg: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) standard deviation of the heading by odometry since the fix."""
    started_at: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """(hypothesis,) the highest target precision at which a fix of its track was accepted by its
    own scan; 0 if there was none."""

    def moved(self, step: Poses, deviations: tuple[float, float], jump_probability: float) -> Self:
        """The hypotheses moved by `step` (4, 4).

        `deviations` are the step's standard deviations in metres and degrees, `jump_probability`
        the probability that the robot was carried to another place meanwhile.
        """
        deviations_m, deviations_deg = deviations
        return replace(
            self,
            poses=self.poses @ step,
            probabilities=(1 - jump_probability) * self.probabilities,
            drift_m=self.drift_m + deviations_m,
            drift_deg=self.drift_deg + deviations_deg,
        )

    def seen(
        self,
        world_T_robot: Poses,
        probability: float,
        tracked: bool,
        accepted_at: float,
        unseen_share: float,
        right_within: tuple[float, float],
    ) -> Self:
        """The hypotheses given one more fix, which becomes the last of them: see `Belief.see`."""
        right_m, right_deg = right_within
        elsewhere = 1 - float(self.probabilities.sum())
        away_m, turn_deg = distance_and_turn(
            self.poses, np.broadcast_to(world_T_robot, self.poses.shape)
        )
        near = (away_m < right_m + DEVIATIONS * self.drift_m) & (
            turn_deg < right_deg + DEVIATIONS * self.drift_deg
        )
        agrees = near & (away_m < right_m)
        # v of METHODS 10.2: the share of wrong fixes that lie near a hypothesis. A tracked fix lies
        # there in any case, so only its probability counts, against that of a usual query.
        repeat_share = (1 - unseen_share) / unseen_share if tracked else REPEAT_SHARE
        right_weight = probability * (
            elsewhere + float(self.probabilities[near].sum()) / repeat_share
        )
        hypothesis_weights = (1 - probability) * self.probabilities
        hypothesis_weights[near] *= REPEAT_SHARE / repeat_share
        hypothesis_weights[agrees] *= 1 - still_right(self.drift_m[agrees], right_m)
        elsewhere_weight = (1 - probability) * elsewhere
        total = right_weight + elsewhere_weight + float(hypothesis_weights.sum())

        stays = ~agrees & (hypothesis_weights > FORGOTTEN_PROBABILITY * total)
        return replace(
            self,
            poses=np.concatenate([self.poses[stays], world_T_robot[None]]),
            probabilities=np.append(hypothesis_weights[stays], right_weight) / total,
            drift_m=np.append(self.drift_m[stays], 0.0),
            drift_deg=np.append(self.drift_deg[stays], 0.0),
            started_at=np.append(
                self.started_at[stays], self.started_at[agrees].max(initial=accepted_at)
            ),
        )


@dataclass
class Belief:
    """The belief about a robot's pose; at first there are no hypotheses.

    The same view without motion is no new evidence. So a fix counts as a further fix only if the
    robot has moved by `new_view_m` since the last fix that counted. Any other fix takes the place
    of the last fix: it updates the belief from before it. Of the fixes of one view the first
    counts, or the first that starts a track.
    """

    unseen_share: float = 0.2
    """The share of queries to expect outside the map, as in the site's verdict (METHODS 9.5)."""
    right_within: tuple[float, float] = RIGHT_WITHIN
    """A pose is right within these metres and degrees."""
    new_view_m: float = NEW_VIEW_M
    """A robot that has moved by less has the same view: its gathered scans overlap, or its single
    scans look alike."""
    views: int = 0
    """Number of fixes that have counted."""
    now: Hypotheses = field(default_factory=Hypotheses)
    """The hypotheses given all fixes, the last one included."""
    # The hypotheses given all fixes that have counted; and given all of these but the last one.
    _counted: Hypotheses = field(default_factory=Hypotheses)
    _before: Hypotheses = field(default_factory=Hypotheses)
    # The pose of the last fix that counted; the motion since; whether a step of it was guessed.
    _last_pose: Poses = field(default_factory=lambda: np.full((4, 4), np.nan))
    _since: Poses = field(default_factory=lambda: np.eye(4))
    _is_guessed: bool = False

    def move(self, step: Poses, deviations: tuple[float, float] | None = None) -> None:
        """Move all hypotheses by `step` (4, 4): the new pose in the frame of the old one.

        `deviations` are the standard deviations, in metres and degrees, of a step that was
        guessed; by default they are those of odometry.
        """
        self._is_guessed |= deviations is not None
        if deviations is None:
            step_m = float(np.linalg.norm(step[:3, 3]))
            deviations = (DRIFT * step_m, TURN_DEG_PER_M * step_m)
        self._since = self._since @ step
        is_same_view = not self._is_guessed and self._since_m < self.new_view_m
        self.now = self.now.moved(step, deviations, JUMP_PROBABILITY)
        # a robot that stands still does not get lost with time: the same view shows it still there
        jump_probability = 0.0 if is_same_view else JUMP_PROBABILITY
        self._counted = self._counted.moved(step, deviations, jump_probability)
        self._before = self._before.moved(step, deviations, jump_probability)

    def see(
        self,
        world_T_robot: Poses,
        probability: float,
        tracked: bool = False,
        accepted_at: float = 0.0,
    ) -> float:
        """Add the pose (4, 4) of a fix, which is right with `probability` by its scan alone.

        `accepted_at` is the highest target precision at which its scan alone accepts it, else 0.

        Returns the probability that the fix is right given all scans so far. Each of the following
        cases has a weight, and its probability is its share of the sum of the weights:

        - The fix is right, and the robot was elsewhere before, or at a hypothesis near the fix. A
          hypothesis near the fix is evidence for it, since few wrong fixes lie near a hypothesis
          (REPEAT_SHARE). It is no evidence for a `tracked` fix, which was searched for near a
          hypothesis.
        - The fix is wrong, and the robot is elsewhere, or at a hypothesis. If the hypothesis is
          near the fix, the fix has slipped from it. If it agrees with the fix, within right_m, it
          must be wrong too, by its drift.

        The fix becomes a hypothesis in place of the hypotheses that agree with it.
        """
        moved_m = self._since_m
        if self._is_guessed:
            moved_m = float(np.linalg.norm(world_T_robot[:3, 3] - self._last_pose[:3, 3]))
        is_new_view = not self.views or moved_m >= self.new_view_m
        if is_new_view:
            self._before = self._counted
            self.views += 1
        self.now = self._before.seen(
            world_T_robot, probability, tracked, accepted_at, self.unseen_share, self.right_within
        )
        if is_new_view or accepted_at > self._counted.started_at[-1]:
            self._counted = self.now
            self._last_pose = world_T_robot
            self._since = np.eye(4)
            self._is_guessed = False
        return float(self.now.probabilities[-1])

    def most_precise(self, probability: float, accepted_at: float) -> float:
        """The highest target precision at which the last fix may be accepted; 0 if there is none.

        By its scan alone it is right with `probability`, and accepted at `accepted_at` (or 0). It
        is accepted

        - at `accepted_at`, if given all scans it is likelier right than wrong;
        - at its probability given all scans, if it or an earlier fix of its track was accepted by
          its own scan at this target precision, and if by its own scan it is likelier right than
          wrong.
        """
        along_path = float(self.now.probabilities[-1])
        most_precise = accepted_at if along_path >= LEAST_PROBABLE else 0.0
        if probability >= LEAST_PROBABLE:
            most_precise = max(most_precise, min(along_path, self.started_at))
        return most_precise

    @property
    def started_at(self) -> float:
        """The highest target precision at which the last fix, or an earlier fix that it agrees
        with, was accepted by its own scan; 0 if none was.

        Fixes of the same view are not earlier fixes.
        """
        return float(self.now.started_at[-1])

    @property
    def _since_m(self) -> float:
        """How far the robot has moved since the last fix that counted."""
        return float(np.linalg.norm(self._since[:3, 3]))

    def slipped_m2(self) -> NDArray[np.float64]:
        """The covariance (3, 3) in m², in the world, of how far the last fix may have slipped.

        It is the sum, over the hypotheses that the fix may have slipped from, of their squared
        distances and drifts, weighted by their probabilities.
        """
        off_m = self.now.poses[:-1, :3, 3] - self.now.poses[-1, :3, 3]
        drift_m = self.now.drift_m[:-1]
        near = np.linalg.norm(off_m, axis=1) < self.right_within[0] + DEVIATIONS * drift_m
        probabilities = np.where(near, self.now.probabilities[:-1], 0.0)
        apart_m2 = np.einsum("n,ni,nj->ij", probabilities, off_m, off_m)
        return np.asarray(apart_m2 + float((probabilities * drift_m**2).sum()) * np.eye(3))

    def best(self) -> tuple[Poses, float] | None:
        """The pose (4, 4) that is most likely right, with its probability.

        Returns None before the first fix.
        """
        if not len(self.now.probabilities):
            return None
        probabilities = self.now.probabilities * still_right(self.now.drift_m, self.right_within[0])
        likeliest = int(probabilities.argmax())
        return self.now.poses[likeliest], float(probabilities[likeliest])


def still_right(
    drift_m: NDArray[np.float64], right_m: float = RIGHT_WITHIN[0]
) -> NDArray[np.float64]:
    """The probability that a right pose is still within `right_m` after it has drifted.

    `drift_m` is the standard deviation of the drift along its main direction.
    """
    return np.asarray(erf(right_m / (np.sqrt(2) * np.maximum(drift_m, 1e-9))))
