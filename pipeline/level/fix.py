"""Fixes: the poses that gathered sweeps may have in a level map, likeliest first."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.settings import Count, check
from pipeline.level.beams import Support, supports
from pipeline.level.field import Field
from pipeline.level.refinement import refined
from pipeline.level.search import APART_DEG, APART_M, scores, search
from pipeline.level.sweeps import Gathered
from pipeline.posing.chances import Chances

SIGNS = ("likely", "in_free", "through", "surety", "ahead")
"""What speaks for a hypothesis; more of each is never worse.

The score, minus the shares of beams that end in free space and that pass a
wall, minus log₁₀ of the spread in metres, and how much higher its quality is than that of the
query's best other hypothesis; without another, as if that were LEAST_RATIO of its own.
"""
SCALES = np.array([0.15, 0.05, 0.1, 0.3, 0.1])
"""A usual difference of each sign."""
LEAST_SPREAD_M = 0.01
HELD = 1e-9
"""Variance of what a level pose does not tell: height, roll and pitch are those of the map."""
LEAST_POINTS = 20
"""A query of fewer thinned hits tells nothing."""
LEAST_RATIO = 0.75
"""Poses that score less than this of the best are no hypotheses."""
MIRRORED_WITHIN = 0.05
"""Sweeps may be mirrored that score no more than this less that way."""
CONTRADICTED_COST = 0.5
"""What a contradicted beam takes from the quality, against 1 that an explained one adds."""


@dataclass(frozen=True)
class Hypothesis:
    """A pose that a query may have."""

    world_T_query: NDArray[np.float64]
    """(4, 4)."""
    covariance: NDArray[np.float64]
    """(3, 3) of x, y in metres and heading in radians, along the world's axes."""
    score: float
    """The mean likelihood of the query's hits, or of its newest sweep's where that is less."""
    support: Support

    @property
    def quality(self) -> float:
        """By which the hypotheses of a query are compared."""
        return self.score - CONTRADICTED_COST * self.support.contradicted

    @property
    def pose_covariance(self) -> NDArray[np.float64]:
        """The covariance (6, 6) as 3-D fixes have it, in the frame of the points."""
        axes = np.eye(3)
        axes[:2, :2] = self.world_T_query[:2, :2].T
        turned = axes @ self.covariance @ axes.T
        covariance = HELD * np.eye(6)
        rows = [3, 4, 2]
        covariance[np.ix_(rows, rows)] = turned
        return covariance

    @property
    def spread_m(self) -> float:
        """The standard deviation along the axis that is held worst."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))


@dataclass(frozen=True)
class LevelFix:
    """The hypotheses of a query, which contradict one another, the likeliest first."""

    hypotheses: tuple[Hypothesis, ...] = ()
    path_m: float = 0.0
    """Length of the path over which the query's sweeps were gathered."""

    def ordered(self, chances: Chances) -> "LevelFix":
        """The same fix in the order of other chances."""
        order = np.argsort(-chances.of(signs(self)), kind="stable").tolist()
        return LevelFix(tuple(self.hypotheses[number] for number in order), self.path_m)


@dataclass(frozen=True)
class LevelFixer:
    """Finds where gathered sweeps were taken."""

    keep: Count = 6
    """Hypotheses that are refined and compared."""
    most_nodes: Count = 300_000
    """Nodes of the search, after which it ends with what it has."""

    def __post_init__(self) -> None:
        check(self, "level.fixer")

    def fix(self, field: Field, gathered: Gathered) -> LevelFix:
        """Search the whole map; no hypothesis where there are too few hits."""
        if len(gathered.points_m) < LEAST_POINTS:
            return LevelFix()
        best = search(field, gathered.points_m, self.keep, LEAST_RATIO, self.most_nodes)
        return self._compared(field, gathered, best.poses)

    def track(
        self, field: Field, gathered: Gathered, world_T_guess: NDArray[np.float64]
    ) -> LevelFix:
        """Refine a guessed pose (4, 4) alone: no rival is looked for.

        There is no hypothesis where there are too few hits.
        """
        if len(gathered.points_m) < LEAST_POINTS:
            return LevelFix()
        grid_T_guess = np.linalg.inv(field.world_T_grid) @ world_T_guess
        heading_rad = np.arctan2(grid_T_guess[1, 0], grid_T_guess[0, 0])
        pose = np.array([[*grid_T_guess[:2, 3], heading_rad]])
        return self._compared(field, gathered, pose)

    def is_misread(self, field: Field, gathered: Gathered, level_fix: LevelFix) -> bool:
        """Whether the laser may be mounted otherwise than was said: nothing is to be believed.

        Odometry contradicts its sweeps, or these fit about as well with left and right exchanged:
        it is upside down.
        """
        if gathered.is_contradicted or not level_fix.hypotheses:
            return gathered.is_contradicted
        mirrored_m = gathered.points_m * [1.0, -1.0]
        least = max(level_fix.hypotheses[0].score - MIRRORED_WITHIN, 0.0)
        return len(search(field, mirrored_m, 1, LEAST_RATIO, self.most_nodes, least).poses) > 0

    def _compared(
        self,
        field: Field,
        gathered: Gathered,
        poses: NDArray[np.float64],
    ) -> LevelFix:
        """Refine poses (k, 3) in the grid, and keep the best of those that are one."""
        poses, covariances = refined(field, gathered.points_m, poses)
        # the newest sweep alone too: matched badly, it stands elsewhere than those before it
        likelihoods = scores(field, gathered.points_m, poses)
        if len(gathered.newest_m):
            likelihoods = np.minimum(likelihoods, scores(field, gathered.newest_m, poses))
        supported = supports(field, gathered, poses)
        hypotheses = [
            Hypothesis(_in_world(field, pose), _turned(field, covariance), float(score), support)
            for pose, covariance, score, support in zip(
                poses, covariances, likelihoods, supported, strict=True
            )
        ]
        kept: list[Hypothesis] = []
        for hypothesis in sorted(hypotheses, key=lambda hypothesis: -hypothesis.quality):
            if not any(same(hypothesis, other) for other in kept):
                kept.append(hypothesis)
        return LevelFix(tuple(kept), gathered.path_m)


def signs(fix: LevelFix) -> NDArray[np.float64]:
    """The signs (n, sign) of a fix's hypotheses, in the order of SIGNS."""
    quality = np.array([hypothesis.quality for hypothesis in fix.hypotheses])
    rows = np.zeros((len(quality), len(SIGNS)))
    for row, hypothesis in zip(rows, fix.hypotheses, strict=True):
        row[:-1] = (
            hypothesis.score,
            -hypothesis.support.in_free,
            -hypothesis.support.through,
            -np.log10(max(hypothesis.spread_m, LEAST_SPREAD_M)),
        )
    farthest = (1 - LEAST_RATIO) * np.maximum(quality, 0)
    rows[:, -1] = farthest
    if len(quality) > 1:
        others = np.where(np.eye(len(quality), dtype=bool), -np.inf, quality)
        rows[:, -1] = np.minimum(quality - others.max(axis=1), farthest)
    return rows


def same(hypothesis: Hypothesis, other: Hypothesis) -> bool:
    """Whether two hypotheses are one pose, within APART_M and APART_DEG."""
    a_T_b = np.linalg.inv(hypothesis.world_T_query) @ other.world_T_query
    turn_deg = abs(np.rad2deg(np.arctan2(a_T_b[1, 0], a_T_b[0, 0])))
    return bool(np.linalg.norm(a_T_b[:2, 3]) < APART_M and turn_deg < APART_DEG)


def _in_world(field: Field, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    grid_T_query = np.eye(4)
    cos = np.cos(pose[2])
    sin = np.sin(pose[2])
    grid_T_query[:2, :2] = [[cos, -sin], [sin, cos]]
    grid_T_query[:2, 3] = pose[:2]
    return np.asarray(field.world_T_grid @ grid_T_query)


def _turned(field: Field, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """A covariance (3, 3) of the grid's axes along the world's."""
    axes = np.eye(3)
    axes[:2, :2] = field.world_T_grid[:2, :2]
    return np.asarray(axes @ covariance @ axes.T)
