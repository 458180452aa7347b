"""Fixes: the pose of a query, found from candidate places, and what speaks for it and for the runner-up (METHODS 9.4)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError, InputError
from pipeline.frames import Poses
from pipeline.posing.registration import NOWHERE, Alignment, Cloud, Points, Registration, moved
from pipeline.posing.targets import Targets, around
from pipeline.posing.verification import structure
from pipeline.posing.walls import Walls
from pipeline.running.settings import Count, NotNegative, check

ELSEWHERE_M = 5.0
"""So far apart two hypotheses contradict one another."""


@dataclass(frozen=True)
class Hypothesis:
    """A pose that a query may have."""

    row: int
    """The training submap that it was registered against."""
    world_T_query: NDArray[np.float64]
    """(4, 4)."""
    alignment: Alignment
    """With that submap: overlap, covariance and, of all signs the surest, spread."""
    structure: float
    """Share of the query's walls that the submap has, among those that it has or contradicts (`verification`)."""


@dataclass(frozen=True)
class Fix:
    """All hypotheses of a query that were registered, that of the least spread first; none where too few points tell."""

    hypotheses: tuple[Hypothesis, ...] = ()

    @classmethod
    def of(cls, found: Sequence[Hypothesis]) -> Self:
        """Of hypotheses in any order."""
        return cls(tuple(sorted(found, key=lambda one: one.alignment.spread_m)))

    @property
    def alignment(self) -> Alignment:
        """Of the best hypothesis; NOWHERE without one."""
        return self.hypotheses[0].alignment if self.hypotheses else NOWHERE

    @property
    def runner_up(self) -> Alignment:
        """Of the best hypothesis that stands elsewhere; NOWHERE without one."""
        places_m = np.array([one.world_T_query[:2, 3] for one in self.hypotheses]).reshape(-1, 2)
        elsewhere = np.flatnonzero(np.linalg.norm(places_m - places_m[:1], axis=1) >= ELSEWHERE_M)
        return self.hypotheses[elsewhere[0]].alignment if len(elsewhere) else NOWHERE


def poses(fixes: Sequence[Fix]) -> Poses:
    """(q, 4, 4) of the best hypotheses; NaN without one."""
    none = np.full((4, 4), np.nan)
    return np.array([fix.hypotheses[0].world_T_query if fix.hypotheses else none for fix in fixes]).reshape(-1, 4, 4)


@dataclass(frozen=True)
class Query:
    """A query, ready to be laid on training submaps."""

    rough: Cloud
    fine: Cloud
    turned: NDArray[np.int64]
    """The cells of its walls at each heading (`Walls.turned`)."""


@dataclass(frozen=True)
class Fixer:
    """How candidate places become a fix (conf/poses.yaml): walls, then a rough and a fine registration, of fewer each time."""

    coarse: Walls = field(default_factory=lambda: Walls(cell_m=2.0, headings=60))
    """What the whole map is searched by, once the ranking has no more candidates."""
    walls: Walls = field(default_factory=Walls)
    rough: Registration = field(default_factory=lambda: Registration(1.0, reaches_m=(2.0,), iterations=10, inlier_m=1.0))
    fine: Registration = field(default_factory=lambda: Registration(reaches_m=(1.0,)))
    rounds: Sequence[int] = (5, 20, 20)
    """Candidates that are looked at in each round."""
    tries: Count = 5
    """Rough registrations in each, of the best matches of walls."""
    refined: Count = 2
    """Fine ones, of the best of these."""
    clear_m: NotNegative = 0.0
    """A hypothesis of less spread ends the search; learned from held-out blocks (`held_out`)."""
    widest_m: NotNegative = 0.5
    """A position of a wider spread is not believed: some direction is open, as along a bare wall."""

    def __post_init__(self) -> None:
        check(self, "fixer")
        object.__setattr__(self, "rounds", tuple(self.rounds))  # a yaml has lists
        if not min(self.rounds, default=0) >= 1:
            raise ConfigError(f"fixer.rounds={self.rounds}: expected at least 1")

    def fix(
        self, points_m: Points, targets: Targets, answers_m: NDArray[np.float64], left_out: NDArray[np.bool_] | None = None
    ) -> Fix:
        """The fix of a query's points (n, 3), z up from the ground, whose likeliest places lie at `answers_m` (k, 2).

        Training submaps `left_out` (row,) are as if they were not there. A fix has no hypothesis where the points are too few or
        not finite.
        """
        points_m = around(points_m, targets.range_m)
        try:
            query = Query(self.rough.prepare(points_m), self.fine.prepare(points_m), self.walls.turned(points_m))
        except InputError:
            return Fix()
        left_out = np.zeros(len(targets.world_T_anchor), bool) if left_out is None else left_out
        rows = chain(targets.nearest(answers_m, left_out), targets.alike(self.coarse, points_m, left_out))
        found: list[Hypothesis] = []
        for hypothesis in self._hypotheses(query, targets, targets.apart(rows)):
            found.append(hypothesis)
            if hypothesis.alignment.spread_m < self.clear_m:
                break
        return Fix.of(found)

    def track(self, points_m: Points, targets: Targets, world_T_guess: NDArray[np.float64], rows: int = 2) -> Fix:
        """The fix of a query's points (n, 3) whose pose is known to a metre and some degrees: registered against the nearest
        `rows` submaps from there alone."""
        points_m = around(points_m, targets.range_m)
        try:
            query = Query(self.rough.prepare(points_m), self.fine.prepare(points_m), np.empty(0, np.int64))
        except InputError:
            return Fix()
        away_m = np.linalg.norm(targets.world_T_anchor[:, :2, 3] - world_T_guess[:2, 3], axis=1)
        found = []
        for row in np.argsort(away_m, kind="stable")[:rows].tolist():
            guess = np.linalg.inv(targets.world_T_anchor[row]) @ world_T_guess
            rough = targets.aligned(self.rough, row, query.rough, guess)
            aligned = targets.aligned(self.fine, row, query.fine, rough.target_T_source)
            if aligned.spread_m <= self.widest_m:
                found.append(self._hypothesis(query, targets, row, aligned))
        return Fix.of(found)

    def _hypotheses(self, query: Query, targets: Targets, rows: Iterator[int]) -> Iterator[Hypothesis]:
        """Of candidate rows, each computed when it is asked for: the best match of walls first, then the best rough overlaps."""
        for count in self.rounds:
            matches = [(row, self.walls.match(targets.chart(self.walls, row), query.turned)) for row in islice(rows, count)]
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
        return Hypothesis(row, targets.world_T_anchor[row] @ aligned.target_T_source, aligned, share)
