"""Fixes: gathered sweeps and a level map go in, the poses that they may have there come out.

The steps of METHODS 13.3: search the whole map (search.py), refine the best poses (refinement.py),
follow the beams (beams.py), and keep one of those that became the same. Each pose that is left is a
hypothesis; its `features` speak for it, and verdict.py makes a probability of them.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import yaw
from pipeline.core.settings import Count, checked
from pipeline.level.beams import Support, supports
from pipeline.level.field import Field
from pipeline.level.refinement import refined
from pipeline.level.search import APART_DEG, APART_M, mean_likelihoods, search
from pipeline.level.sweeps import Gathered
from pipeline.posing.fix import Registered
from pipeline.posing.probabilities import Probabilities

FEATURES = ("likely", "in_free", "through", "surety", "ahead")
"""What speaks for a hypothesis, the more the better:

- likely: its score;
- in_free, through: minus the shares of beams that end in free space, and that pass a wall;
- surety: minus log₁₀ of the spread in metres;
- ahead: its quality less that of the query's best other hypothesis. Without another one, that is
  taken for LEAST_RATIO of its own.
"""
SCALES = np.array([0.15, 0.05, 0.1, 0.3, 0.1])
"""A usual difference of each feature between hypotheses: it scales the weights that are learned."""
LEAST_SPREAD_M = 0.01
"""A smaller spread counts as this."""
MAP_VARIANCE = 1e-9
"""Variance in rad² and m² of roll, pitch and height, which a level pose has from the map."""
LEAST_POINTS = 20
"""A query of fewer thinned hits has no pose."""
LEAST_RATIO = 0.75
"""A pose that scores less than this share of the best is no hypothesis."""
MIRRORED_WITHIN = 0.05
"""A laser may be upside down if its sweeps, mirrored, score at most so much less."""
CONTRADICTED_COST = 0.5
"""The share of contradicted beams lowers the quality by this much."""


@dataclass(frozen=True)
class Hypothesis:
    """A pose that a query may have."""

    world_T_query: NDArray[np.float64]
    """(4, 4) the robot's pose at the newest sweep."""
    covariance: NDArray[np.float64]
    """(3, 3) of x, y in metres and heading in radians, along the world's axes."""
    score: float
    """The mean likelihood of all hits of the query, or of its newest sweep's where that is less."""
    support: Support
    """What the beams say of the pose."""

    @property
    def quality(self) -> float:
        """The number by which the hypotheses of a query are compared."""
        return self.score - CONTRADICTED_COST * self.support.contradicted

    @property
    def pose_covariance(self) -> NDArray[np.float64]:
        """The covariance (6, 6) as 3-D fixes have it: a turn, then a step, in the robot's frame."""
        query_T_world = np.eye(3)
        query_T_world[:2, :2] = self.world_T_query[:2, :2].T
        x_y_heading = [3, 4, 2]  # where the six numbers have what the three are
        covariance = MAP_VARIANCE * np.eye(6)
        covariance[np.ix_(x_y_heading, x_y_heading)] = (
            query_T_world @ self.covariance @ query_T_world.T
        )
        return covariance

    @property
    def overlap(self) -> float:
        """The share of beams that end at a wall of the map."""
        return self.support.explained

    @property
    def spread_m(self) -> float:
        """The position's standard deviation along its widest direction."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))


@dataclass(frozen=True)
class LevelFix(Registered[Hypothesis]):
    """The hypotheses of gathered sweeps: the best first by quality, until they are `ordered`."""

    path_m: float = 0.0
    """The length of path over which the query's sweeps were gathered."""

    def ordered(self, probabilities: Probabilities) -> Self:
        """The same hypotheses in the order of their probabilities."""
        order = np.argsort(-probabilities.of(self.features), kind="stable").tolist()
        ordered = replace(self, hypotheses=tuple(self.hypotheses[number] for number in order))
        return replace(ordered, probabilities=tuple(probabilities.of(ordered.features).tolist()))

    @property
    def elsewhere(self) -> list[int]:
        """The indices of all but the best: each is another place."""
        return list(range(1, len(self.hypotheses)))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(6, 6) the covariance of the likeliest pose; NaN without one."""
        return super().covariance if self.hypotheses else np.full((6, 6), np.nan)

    @property
    def features(self) -> NDArray[np.float64]:
        """The features (n, feature) of the hypotheses, in the order of FEATURES."""
        quality = np.array([hypothesis.quality for hypothesis in self.hypotheses])
        # without another hypothesis; with one it is the most that counts
        ahead = (1 - LEAST_RATIO) * np.maximum(quality, 0)
        if len(quality) > 1:
            is_itself = np.eye(len(quality), dtype=bool)
            best_other = np.where(is_itself, -np.inf, quality).max(axis=1)
            ahead = np.minimum(quality - best_other, ahead)
        features = np.zeros((len(quality), len(FEATURES)))
        for number, hypothesis in enumerate(self.hypotheses):
            features[number] = (
                hypothesis.score,
                -hypothesis.support.in_free,
                -hypothesis.support.through,
                -np.log10(max(hypothesis.spread_m, LEAST_SPREAD_M)),
                ahead[number],
            )
        return features


@dataclass(frozen=True)
@checked("level.fixer")
class LevelFixer:
    """Finds where gathered sweeps were taken."""

    keep: Count = 6
    """At most so many poses of the search are refined and compared."""
    most_nodes: Count = 300_000
    """The search ends with what it has after so many nodes."""

    def fix(self, field: Field, gathered: Gathered) -> LevelFix:
        """Search the whole map. There is no hypothesis where there are too few hits."""
        if len(gathered.points_m) < LEAST_POINTS:
            return LevelFix()
        best = search(field, gathered.points_m, self.keep, LEAST_RATIO, self.most_nodes)
        return self._compared(field, gathered, best.poses)

    def track(
        self, field: Field, gathered: Gathered, world_T_guess: NDArray[np.float64]
    ) -> LevelFix:
        """Refine a guessed pose (4, 4), and look for no other.

        There is no hypothesis where there are too few hits.
        """
        if len(gathered.points_m) < LEAST_POINTS:
            return LevelFix()
        grid_T_guess = np.linalg.inv(field.world_T_grid) @ world_T_guess
        heading_rad = yaw(grid_T_guess)
        pose = np.array([[*grid_T_guess[:2, 3], heading_rad]])
        return self._compared(field, gathered, pose)

    def is_misread(
        self, field: Field, gathered: Gathered, level_fix: Registered[Hypothesis]
    ) -> bool:
        """Whether the laser may be mounted otherwise than was said, so that no fix is accepted.

        That is so if odometry contradicts its sweeps, or if these fit about as well with left and
        right exchanged, as those of a laser that is upside down do.
        """
        if gathered.is_contradicted:
            return True
        if not level_fix.hypotheses:
            return False
        mirrored_m = gathered.points_m * [1.0, -1.0]  # y is to the left
        least_score = max(level_fix.hypotheses[0].score - MIRRORED_WITHIN, 0.0)
        mirrored = search(field, mirrored_m, 1, LEAST_RATIO, self.most_nodes, least_score)
        return len(mirrored.poses) > 0

    def _compared(
        self,
        field: Field,
        gathered: Gathered,
        poses: NDArray[np.float64],
    ) -> LevelFix:
        """Refine poses (k, 3) in the grid; of those that become the same the best is kept."""
        poses, covariances = refined(field, gathered.points_m, poses)
        pose_scores = mean_likelihoods(field, gathered.points_m, poses)
        # a newest sweep that was matched badly with the earlier ones fits worse than they do
        if len(gathered.newest_m):
            newest_scores = mean_likelihoods(field, gathered.newest_m, poses)
            pose_scores = np.minimum(pose_scores, newest_scores)
        pose_supports = supports(field, gathered, poses)
        hypotheses = []
        for pose, covariance, score, support in zip(
            poses, covariances, pose_scores, pose_supports, strict=True
        ):
            world_T_query = _pose_in_world(field, pose)
            in_world = _covariance_in_world(field, covariance)
            hypotheses.append(Hypothesis(world_T_query, in_world, float(score), support))
        distinct: list[Hypothesis] = []
        for hypothesis in sorted(hypotheses, key=lambda hypothesis: -hypothesis.quality):
            if not any(same(hypothesis, better) for better in distinct):
                distinct.append(hypothesis)
        return LevelFix(tuple(distinct), path_m=gathered.path_m)


def same(hypothesis: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses are the same pose, within APART_M and APART_DEG."""
    between = np.linalg.inv(hypothesis.world_T_query) @ other.world_T_query
    turn_deg = abs(np.rad2deg(yaw(between)))
    return bool(np.linalg.norm(between[:2, 3]) < APART_M and turn_deg < APART_DEG)


def _pose_in_world(field: Field, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The pose (4, 4) in the world of x, y in metres and heading in radians (3,) in the grid."""
    grid_T_query = np.eye(4)
    cos = np.cos(pose[2])
    sin = np.sin(pose[2])
    grid_T_query[:2, :2] = [[cos, -sin], [sin, cos]]
    grid_T_query[:2, 3] = pose[:2]
    return np.asarray(field.world_T_grid @ grid_T_query)


def _covariance_in_world(field: Field, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """A covariance (3, 3) of x, y and heading in the grid, turned to the world's axes."""
    world_T_grid = np.eye(3)
    world_T_grid[:2, :2] = field.world_T_grid[:2, :2]
    return np.asarray(world_T_grid @ covariance @ world_T_grid.T)
