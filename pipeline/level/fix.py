"""Fixes: the poses that gathered sweeps may have in a level map.

In: gathered sweeps and a map. Out: a `LevelFix`. The steps of METHODS 13.3: search the whole map
(search.py), refine the best poses (refinement.py), follow the beams (beams.py), and keep one of the
poses that became equal. Each remaining pose is a hypothesis; verdict.py computes its probability
from its `features`.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import transformed, yaw
from pipeline.core.settings import Count, checked
from pipeline.level.beams import Support, supports
from pipeline.level.field import Field
from pipeline.level.refinement import refined
from pipeline.level.search import APART_DEG, APART_M, Window, mean_likelihoods, search
from pipeline.level.sweeps import Gathered
from pipeline.posing.fix import Registered
from pipeline.posing.prior import Prior
from pipeline.posing.probabilities import HypothesisModel

FEATURES = ("likely", "in_free", "through", "surety", "ahead")
"""The features of a hypothesis; a larger value never lowers its probability.

- likely: its score;
- in_free, through: minus the shares of beams that end in free space, and that pass through a wall;
- surety: −log₁₀ of the spread in metres;
- ahead: its quality minus that of the query's best other hypothesis, which is taken to be
  LEAST_RATIO times its own quality if there is no other; with a prior, RIVAL_RATIO times at least.
"""
SCALES = np.array([0.15, 0.05, 0.1, 0.3, 0.1])
"""A typical difference of each feature between hypotheses; learning divides features by it."""
LEAST_SPREAD_M = 0.01
"""A smaller spread counts as this."""
MAP_VARIANCE = 1e-9
"""Variance in rad² and m² of roll, pitch and height, which the map fixes for a level pose."""
LEAST_POINTS = 20
"""A query of fewer thinned hits has no pose."""
LEAST_RATIO = 0.75
"""A pose that scores less than this share of the best is no hypothesis."""
RIVAL_RATIO = 0.9
"""With a prior, a pose outside of it that scores less than this share of the best is not found."""
MIRRORED_WITHIN = 0.05
"""A laser may be upside down if its mirrored sweeps score at most this much less."""
CONTRADICTED_COST = 0.5
"""The quality is lowered by this times the share of contradicted beams."""


@dataclass(frozen=True)
class Hypothesis:
    """A pose that a query may have."""

    world_T_query: NDArray[np.float64]
    """(4, 4) the robot's pose at the newest sweep."""
    covariance: NDArray[np.float64]
    """(3, 3) of x, y in metres and heading in radians, along the world's axes."""
    score: float
    """The mean likelihood of the query's hits, or that of its newest sweep's hits if it is less."""
    support: Support
    """How the beams support the pose."""

    @property
    def quality(self) -> float:
        """The number by which the hypotheses of a query are compared."""
        return self.score - CONTRADICTED_COST * self.support.contradicted

    @property
    def pose_covariance(self) -> NDArray[np.float64]:
        """The covariance (6, 6) of a small turn in radians, then of a step in metres, in the
        robot's frame: the form of 3-D fixes."""
        query_T_world = np.eye(3)
        query_T_world[:2, :2] = self.world_T_query[:2, :2].T
        x_y_heading = [3, 4, 2]  # the rows of x, y and heading among the six
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
    """The hypotheses of gathered sweeps, by decreasing quality until they are `ordered`."""

    path_m: float = 0.0
    """The length of path over which the query's sweeps were gathered."""

    def ordered(self, model: HypothesisModel) -> Self:
        """The same hypotheses, with the probabilities of a model and in their order."""
        before = model.probabilities(self.features, self.log_weights)
        order = np.argsort(-before, kind="stable").tolist()
        ordered = replace(self, hypotheses=tuple(self.hypotheses[number] for number in order))
        probabilities = model.probabilities(ordered.features, ordered.log_weights)
        return replace(ordered, probabilities=tuple(probabilities.tolist()))

    @property
    def elsewhere(self) -> list[int]:
        """The indices of all hypotheses but the best: each is at another place."""
        return list(range(1, len(self.hypotheses)))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """(6, 6) the covariance of the likeliest pose; NaN without one."""
        return super().covariance if self.hypotheses else np.full((6, 6), np.nan)

    @property
    def features(self) -> NDArray[np.float64]:
        """The features (n, feature) of the hypotheses, in the order of FEATURES."""
        quality = np.array([hypothesis.quality for hypothesis in self.hypotheses])
        # the value without another hypothesis, and the largest value with another one
        least_ratio = LEAST_RATIO if self.prior is None else RIVAL_RATIO
        ahead = (1 - least_ratio) * np.maximum(quality, 0)
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
    """Largest number of poses of the search that are refined and compared."""
    most_nodes: Count = 300_000
    """The search ends after this many nodes, with the poses that it has."""

    def fix(self, field: Field, gathered: Gathered, prior: Prior | None = None) -> LevelFix:
        """Search the whole map; the fix has no hypothesis if there are too few hits.

        With a prior, poses within it are searched for, and then only rivals of these anywhere.
        """
        if len(gathered.points_m) < LEAST_POINTS:
            return LevelFix()
        points_m = gathered.points_m
        window = None if prior is None else _window(field, prior)
        best = search(field, points_m, self.keep, LEAST_RATIO, self.most_nodes, window=window)
        if prior is None or not len(best.poses):
            return self._compared(field, gathered, best.poses)
        least_score = RIVAL_RATIO * float(best.scores[0])
        rivals = search(field, points_m, 2, RIVAL_RATIO, self.most_nodes, least_score)
        poses = np.concatenate([best.poses, rivals.poses])
        return replace(self._compared(field, gathered, poses), prior=prior)

    def track(
        self, field: Field, gathered: Gathered, world_T_guess: NDArray[np.float64]
    ) -> LevelFix:
        """Refine a guessed pose (4, 4), without a search for other poses.

        The fix has no hypothesis if there are too few hits.
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
        """Whether the laser may be mounted otherwise than specified, so that no fix is accepted.

        It may be if odometry contradicts the sweeps, or if the sweeps fit about as well with left
        and right exchanged, like those of a laser that is upside down.
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
        """Refine poses (k, 3) in the grid; of poses that become equal, the best is kept."""
        poses, covariances = refined(field, gathered.points_m, poses)
        pose_scores = mean_likelihoods(field, gathered.points_m, poses)
        # a newest sweep that was badly matched with the earlier sweeps fits worse than they do
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
    """Whether two hypotheses are at the same pose, within APART_M and APART_DEG."""
    between = np.linalg.inv(hypothesis.world_T_query) @ other.world_T_query
    turn_deg = abs(np.rad2deg(yaw(between)))
    return bool(np.linalg.norm(between[:2, 3]) < APART_M and turn_deg < APART_DEG)


def _window(field: Field, prior: Prior) -> Window:
    """The positions and headings of the grid within a prior."""
    grid_T_world = np.asarray(np.linalg.inv(field.world_T_grid))
    x_m, y_m, _ = transformed(grid_T_world, np.array([[*prior.xy_m, 0.0]]))[0]
    heading_rad = None
    if prior.heading_rad is not None and prior.reach_rad < np.pi:
        heading_rad = prior.heading_rad + float(yaw(grid_T_world))
    return Window(float(x_m), float(y_m), prior.reach_m, heading_rad, prior.reach_rad)


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
