"""Fixes: the pose of a query, found from candidate places, and what speaks for it and for the runner-up (METHODS 9.4)."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError, InputError
from pipeline.frames import Poses
from pipeline.posing.registration import Alignment, Cloud, Points, Registration, moved
from pipeline.posing.targets import Targets
from pipeline.posing.verification import structure
from pipeline.posing.walls import Walls

ELSEWHERE_M = 5.0
"""So far apart two hypotheses contradict one another."""


@dataclass(frozen=True)
class Hypothesis:
    """A pose that a query may have."""

    row: int
    """The training submap that it was registered against."""
    world_T_query: NDArray[np.float64]
    """(4, 4)."""
    overlap: float
    """Share of the query's voxels that the training submap has too."""
    structure: float
    """Share of its walls that the submap has, among those that it has or contradicts (`verification`)."""
    spread_m: float
    """Standard deviation of the position, by the registration alone; infinite where a direction is open."""

    @property
    def support(self) -> float:
        """What speaks for it: the mean of both shares."""
        return (self.overlap + self.structure) / 2


@dataclass(frozen=True)
class Fix:
    """All hypotheses of a query that were registered, the best first; none where it has too few points to tell."""

    hypotheses: tuple[Hypothesis, ...] = ()

    @classmethod
    def of(cls, found: Sequence[Hypothesis]) -> Self:
        """Of hypotheses in any order."""
        return cls(tuple(sorted(found, key=lambda one: -one.support)))

    @property
    def overlap(self) -> float:
        """Of the best hypothesis; 0 without one."""
        return self.hypotheses[0].overlap if self.hypotheses else 0.0

    @property
    def runner_up(self) -> float:
        """Support of the best hypothesis that stands elsewhere; 0 without one."""
        places_m = np.array([one.world_T_query[:2, 3] for one in self.hypotheses]).reshape(-1, 2)
        elsewhere = np.linalg.norm(places_m - places_m[:1], axis=1) >= ELSEWHERE_M
        return max((one.support for one, other in zip(self.hypotheses, elsewhere, strict=True) if other), default=0.0)


def poses(fixes: Sequence[Fix]) -> Poses:
    """(q, 4, 4) of the best hypotheses; NaN without one."""
    none = np.full((4, 4), np.nan)
    return np.array([fix.hypotheses[0].world_T_query if fix.hypotheses else none for fix in fixes]).reshape(-1, 4, 4)


@dataclass(frozen=True)
class Query:
    """A query, ready to be laid on training submaps."""

    turned: NDArray[np.int64]
    """The cells of its walls at each heading (`Walls.turned`)."""
    rough: Cloud
    fine: Cloud


@dataclass(frozen=True)
class Fixer:
    """How candidate places become a fix (conf/poses.yaml): walls, then a rough and a fine registration, of fewer each time."""

    walls: Walls = field(default_factory=Walls)
    rough: Registration = field(default_factory=lambda: Registration(1.0, reaches_m=(2.0,), iterations=10, inlier_m=1.0))
    fine: Registration = field(default_factory=lambda: Registration(reaches_m=(1.0,)))
    first: int = 5
    """Candidates that are looked at before all others; if one of them is clear, the others are left alone."""
    tries: int = 5
    """Rough registrations in each of these two rounds, of the best matches of walls."""
    refined: int = 2
    """Fine ones, of the best of these."""
    clear_support: float = 0.75
    """A hypothesis of so much support ends the search; chosen on the campus's training day, where no wrong one has it."""
    apart_m: float = 5.0
    """Candidates nearer to one another than this are one."""
    widest_m: float = 0.5
    """A position of a wider spread is not believed: some direction is open, as along a bare wall."""

    def __post_init__(self) -> None:
        for name in ("first", "tries", "refined"):
            if not getattr(self, name) >= 1:
                raise ConfigError(f"fixer.{name}={getattr(self, name)}: expected at least 1")
        if not 0 < self.clear_support <= 1:
            raise ConfigError(f"fixer.clear_support={self.clear_support}: expected a share above 0")

    def fix(self, points_m: Points, targets: Targets, rows: Iterable[int]) -> Fix:
        """The fix of a query's points (n, 3), z up from the ground, among training submaps, the likeliest row first.

        It has no hypothesis where the points are too few or not finite.
        """
        try:
            query = Query(self.walls.turned(points_m), self.rough.prepare(points_m), self.fine.prepare(points_m))
        except InputError:
            return Fix()
        found: list[Hypothesis] = []
        for hypothesis in self._hypotheses(query, targets, self._distinct(targets.world_T_anchor, rows)):
            found.append(hypothesis)
            if hypothesis.support >= self.clear_support:
                break
        return Fix.of(found)

    def _hypotheses(self, query: Query, targets: Targets, rows: list[int]) -> Iterator[Hypothesis]:
        """Of candidate rows, each computed when it is asked for: the best match of walls first, then the best rough overlaps."""
        for some in (rows[: self.first], rows[self.first :]):
            matches = [(row, self.walls.match(targets.chart(self.walls, row), query.turned)) for row in some]
            likely = sorted(matches, key=lambda one: -one[1].score)[: self.tries]
            for few, refined in ((likely[:1], 1), (likely[1:], self.refined - 1)):
                guesses = [(row, targets.aligned(self.rough, row, query.rough, match.target_T_query)) for row, match in few]
                for row, guess in sorted(guesses, key=lambda one: -one[1].overlap)[:refined]:
                    aligned = targets.aligned(self.fine, row, query.fine, guess.target_T_source)
                    if aligned.spread_m <= self.widest_m:
                        yield self._hypothesis(query, targets, row, aligned)

    def _hypothesis(self, query: Query, targets: Targets, row: int, aligned: Alignment) -> Hypothesis:
        """What a fine registration against a row comes to."""
        moved_m, chart = moved(aligned.target_T_source, query.fine.xyz_m), targets.chart(self.walls, row)
        share = structure(moved_m, targets.cloud(self.fine, row), chart, self.walls, self.fine.inlier_m)
        return Hypothesis(row, targets.world_T_anchor[row] @ aligned.target_T_source, aligned.overlap, share, aligned.spread_m)

    def _distinct(self, world_T_anchor: Poses, rows: Iterable[int]) -> list[int]:
        """The rows without those whose anchors lie near an earlier one's."""
        kept: list[int] = []
        for row in rows:
            away = world_T_anchor[kept, :2, 3] - world_T_anchor[row, :2, 3]
            if not kept or np.linalg.norm(away, axis=1).min() >= self.apart_m:
                kept.append(int(row))
        return kept
