"""The search for a query's pose (METHODS 9.4).

It tries the ranking's own pose first, then walls of more and more places.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, islice
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.frames import pose, yaw
from pipeline.core.settings import Count, NotNegative, Share, check
from pipeline.matching.ranking import Ranking
from pipeline.posing.chances import USUAL, Chances
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import Fix, Hypothesis, same
from pipeline.posing.registration import Alignment, Approach, Cloud, Points, Registration
from pipeline.posing.slides import slide
from pipeline.posing.targets import Targets, around
from pipeline.posing.verification import Seen, agreement
from pipeline.posing.walls import Chart, Walls

BESIDE_M = (2.5, 15.0)
"""A pose is checked against a second submap, so far from the first at least and from the pose at
most."""

LIKELY = 0.05
"""A hypothesis of less chance is not compared with its slid copies, nor with poses of little
overlap."""


class Answers(NamedTuple):
    """Where a ranking places a query, the likeliest first."""

    xy_m: NDArray[np.float64]
    """(k, 2); NaN of an answer that is none."""
    heading_deg: NDArray[np.float64]
    """(k,); NaN where the method names none."""

    @classmethod
    def of(cls, ranking: Ranking, row: int = 0) -> Self:
        """The answers to one query of a ranking."""
        return cls(
            ranking.xy_m[row].astype(np.float64), ranking.heading_deg[row].astype(np.float64)
        )

    @classmethod
    def at(cls, xy_m: NDArray[np.float64]) -> Self:
        """Answers at positions (k, 2), without headings."""
        return cls(xy_m, np.full(len(xy_m), np.nan))


NO_ANSWERS = Answers(np.empty((0, 2)), np.empty(0))


@dataclass(frozen=True)
class Query:
    """A query's points (n, 3), prepared for comparison with training submaps."""

    points_m: Points
    cloud: Cloud
    walls: Walls
    single: bool
    """Whether it is one scan, whose sensor saw through what lies before its walls."""

    @cached_property
    def walls_m(self) -> Points:
        """The points (n, 3) of the query's walls."""
        return self.walls.of(self.points_m)

    @cached_property
    def chart(self) -> Chart:
        """The chart of the query's walls from above."""
        return self.walls.chart(self.walls_m, self.single)

    @cached_property
    def seen(self) -> Seen:
        """What the query's sensor met and saw through."""
        return Seen.of(self.walls, self.cloud, self.chart)

    @cached_property
    def middles(self) -> NDArray[np.float64]:
        """The middles (n, 2) of the wall cells, in cells (Walls.middles)."""
        return self.walls.middles(self.walls_m)

    @cached_property
    def cells_at_headings(self) -> NDArray[np.int64]:
        """The cells of the walls at each heading (Walls.cells_at_headings)."""
        return self.walls.cells_at_headings(self.walls_m)


@dataclass(frozen=True)
class Fixer:
    """Turns the answers of a ranking into a fix (conf/poses.yaml)."""

    coarse: Walls = field(default_factory=lambda: Walls(cell_m=2.0, headings=60))
    """What the whole map is searched by, once the ranking has no more candidates."""
    walls: Walls = field(default_factory=Walls)
    registration: Registration = field(default_factory=Registration)
    rounds: Sequence[int] = (5, 20)
    """Candidates that are looked at in each round."""
    tries: Count = 5
    """Approaches in each round, of the best matches of walls."""
    refined: Count = 2
    """Refined registrations in each round, of the best approaches."""
    sure: Share = 0.95
    """A hypothesis of this chance ends the search."""
    least_lead: NotNegative = 0.1
    """The slid copies of the likeliest hypothesis are registered too unless it leads by so much."""
    least_overlap: Share = 0.0
    """An approach of less overlap is not refined; learned from held-out blocks (`held_out`)."""
    widest_m: NotNegative = 0.5
    """A position of a wider spread is not believed: some direction is open, as along a bare
    wall."""
    chances: Chances = USUAL
    """Learned from held-out blocks (`held_out`)."""
    expectations: Expectations = field(default_factory=Expectations)
    """Learned from held-out blocks too."""

    def __post_init__(self) -> None:
        check(self, "fixer")
        object.__setattr__(self, "rounds", tuple(self.rounds))  # a yaml has lists
        if not min(self.rounds, default=0) >= 1:
            raise ConfigError(f"fixer.rounds={self.rounds}: expected at least 1")

    def fix(
        self,
        points_m: Points,
        targets: Targets,
        answers: Answers = NO_ANSWERS,
        left_out: NDArray[np.bool_] | None = None,
    ) -> Fix:
        """Fix a query's points (n, 3), z up from the ground.

        The answers of a ranking are tried first, then the whole map. Training submaps `left_out`
        (row,) are as if they were not there. A fix has no hypothesis where the points are too few
        or not finite.
        """
        query = self._prepared(points_m, targets)
        if query is None:
            return Fix()
        left_out = np.zeros(len(targets.world_T_anchor), bool) if left_out is None else left_out
        search = _Search(self, query, targets, left_out)
        return self._first_sure(lambda least: search.everywhere(answers, least), search.copies)

    def track(
        self, points_m: Points, targets: Targets, world_T_guess: NDArray[np.float64], rows: int = 2
    ) -> Fix:
        """Fix a query's points (n, 3) whose pose is known to a metre and some degrees.

        They are registered against the nearest `rows` submaps from there alone, one after the other
        until one is sure.
        """
        query = self._prepared(points_m, targets)
        if query is None:
            return Fix()
        search = _Search(self, query, targets, np.zeros(len(targets.world_T_anchor), bool))
        return self._first_sure(
            lambda least: search.around(world_T_guess, rows), lambda hypothesis: []
        )

    def _prepared(self, points_m: Points, targets: Targets) -> Query | None:
        """Prepare the query's clouds; None where there are too few points."""
        points_m = around(points_m, targets.range_m)
        try:
            cloud = self.registration.prepare(points_m)
        except InputError:
            return None
        return Query(points_m, cloud, self.walls, targets.single)

    def _first_sure(
        self,
        candidates: Callable[[Callable[[], float]], Iterator[Hypothesis]],
        copies: Callable[[Hypothesis], list[Hypothesis]],
    ) -> Fix:
        """Build the fix from as many candidates as it takes to be sure of one.

        Candidates are asked for with the least overlap of an approach as it is at that time: once
        there is a likely hypothesis, any pose is worth a comparison.

        The slid copies of the likeliest are tried too, unless it leads them or is hardly likely;
        where one of them becomes the likeliest, so are its own.
        """
        hypotheses: list[Hypothesis] = []
        compared: list[Hypothesis] = []
        fix = Fix()

        def least() -> float:
            return 0.0 if fix.chance >= LIKELY else self.least_overlap

        for hypothesis in candidates(least):
            hypotheses.append(hypothesis)
            fix = Fix.of(hypotheses, self.chances)
            while self._has_rivals(fix, compared):
                compared.append(fix.hypotheses[0])
                hypotheses += copies(fix.hypotheses[0])
                fix = Fix.of(hypotheses, self.chances)
            if fix.chance >= self.sure:
                break
        return fix

    def _has_rivals(self, fix: Fix, compared: Sequence[Hypothesis]) -> bool:
        """Whether the likeliest hypothesis is to be compared with its slid copies.

        It is not where it, or one at the same pose, was `compared` before.
        """
        best = fix.hypotheses[0]
        if fix.chance < LIKELY or best.slide.lead >= self.least_lead:
            return False
        return not same(best, compared).any()


@dataclass(frozen=True)
class _Search:
    """Computes the hypotheses of one query, each when it is asked for."""

    fixer: Fixer
    query: Query
    targets: Targets
    left_out: NDArray[np.bool_]

    def everywhere(self, answers: Answers, least: Callable[[], float]) -> Iterator[Hypothesis]:
        """Hypotheses all over the map: the ranking's own pose, then candidates by their walls.

        Only approaches of the `least` overlap are refined.
        """
        nearest = self.targets.nearest(answers.xy_m, self.left_out)
        alike = self.targets.alike(self.fixer.coarse, self.query.walls_m, self.left_out)
        rows = self.targets.spaced(chain(nearest, alike))
        rounds = (self._round(list(islice(rows, count)), least) for count in self.fixer.rounds)
        return chain(self._straight(answers, least), chain.from_iterable(rounds))

    def around(self, world_T_guess: NDArray[np.float64], rows: int) -> Iterator[Hypothesis]:
        """Hypotheses from one guessed pose, against the nearest submaps."""
        away_m = np.linalg.norm(
            self.targets.world_T_anchor[:, :2, 3] - world_T_guess[:2, 3], axis=1
        )
        for row in np.argsort(away_m, kind="stable")[:rows].tolist():
            guess = np.linalg.inv(self.targets.world_T_anchor[row]) @ world_T_guess
            yield from self._registered(row, guess)

    def copies(self, hypothesis: Hypothesis) -> list[Hypothesis]:
        """The hypotheses that the slid copies of a hypothesis lead to."""
        slid = hypothesis.slide.copies
        registered = (self._registered(copy.row, copy.target_T_query) for copy in slid)
        return list(chain.from_iterable(registered))

    def _straight(self, answers: Answers, least: Callable[[], float]) -> Iterator[Hypothesis]:
        """Hypotheses from the position and heading of the ranking's first answer.

        There are none where it lacks one of them.
        """
        if (
            not len(answers.xy_m)
            or not np.isfinite([*answers.xy_m[0], answers.heading_deg[0]]).all()
        ):
            return
        for row in self.targets.nearest(answers.xy_m[:1], self.left_out):
            world_T_anchor = self.targets.world_T_anchor[row]
            turn_rad = np.deg2rad(answers.heading_deg[0]) - yaw(world_T_anchor[None])[0]
            ahead_m = world_T_anchor[:3, :3].T @ np.append(
                answers.xy_m[0] - world_T_anchor[:2, 3], 0.0
            )
            at_m = ahead_m * (np.abs(ahead_m[:2]) <= self.fixer.walls.offset_m).all()
            guess = pose(np.array([[*at_m[:2], 0.0]]), np.array([[0.0, 0.0, turn_rad]]))[0]
            yield from self._registered(row, guess, least())

    def _round(self, rows: Sequence[int], least: Callable[[], float]) -> Iterator[Hypothesis]:
        """Hypotheses from candidate rows: the best match of walls, then the best approaches."""
        fixer = self.fixer
        targets = self.targets
        query = self.query
        matches = [
            (row, fixer.walls.match(targets.chart(fixer.walls, row), query.cells_at_headings))
            for row in rows
        ]
        likely = sorted(matches, key=lambda pair: -pair[1].score)[: fixer.tries]
        for few, refined in ((likely[:1], 1), (likely[1:], fixer.refined - 1)):
            approaches = [
                (row, approach)
                for row, match in few
                for approach in self._approached(row, match.target_T_query)
                if approach.overlap >= least()
            ]
            for row, approach in sorted(approaches, key=lambda pair: -pair[1].overlap)[:refined]:
                yield from self._refined(row, approach)

    def _registered(
        self, row: int, target_T_query: NDArray[np.float64], least_overlap: float = 0.0
    ) -> Iterator[Hypothesis]:
        """Register from a guess against one submap; nothing if it fails."""
        for approach in self._approached(row, target_T_query):
            if approach.overlap >= least_overlap:
                yield from self._refined(row, approach)

    def _approached(self, row: int, target_T_query: NDArray[np.float64]) -> list[Approach]:
        """The approach to one submap from a guess (4, 4); none where it has too few points."""
        registration = self.fixer.registration
        try:
            target = self.targets.cloud(registration, row)
        except InputError:
            return []
        return [registration.approach(target, self.query.cloud, target_T_query)]

    def _refined(self, row: int, approach: Approach) -> Iterator[Hypothesis]:
        """Refine the approach to one submap; nothing if a direction stays open."""
        registration = self.fixer.registration
        target = self.targets.cloud(registration, row)
        alignment = registration.refine(target, self.query.cloud, approach.target_T_source)
        if alignment.spread_m <= self.fixer.widest_m:
            yield self._hypothesis(row, alignment, approach.overlap)

    def _hypothesis(self, row: int, alignment: Alignment, approached: float) -> Hypothesis:
        """The hypothesis of a fine registration against a row, checked against the map."""
        fixer = self.fixer
        targets = self.targets
        world_T_query = targets.world_T_anchor[row] @ alignment.target_T_source
        seen = self.query.seen
        here, beside = (
            agreement(
                fixer.walls,
                fixer.registration.inlier_m,
                targets.seen(fixer.registration, fixer.walls, submap),
                seen,
                np.linalg.inv(targets.world_T_anchor[submap]) @ world_T_query,
            )
            for submap in (row, self._beside(row, world_T_query))
        )
        tilt_deg = float(np.rad2deg(np.arccos(np.clip(alignment.target_T_source[2, 2], -1, 1))))
        slid = slide(fixer.walls, targets, self.query.middles, world_T_query, self.left_out)
        return Hypothesis(
            row,
            world_T_query,
            alignment,
            here,
            beside,
            tilt_deg,
            slid,
            approached,
            fixer.expectations.excess(world_T_query[:2, 3]),
        )

    def _beside(self, row: int, world_T_query: NDArray[np.float64]) -> int:
        """The submap nearest to a pose that is not where `row` is; `row` where there is none."""
        anchors_m = self.targets.world_T_anchor[:, :2, 3]
        away_m = np.linalg.norm(anchors_m - world_T_query[:2, 3], axis=1)
        is_elsewhere = np.linalg.norm(anchors_m - anchors_m[row], axis=1) >= BESIDE_M[0]
        away_m[self.left_out | ~is_elsewhere] = np.inf
        nearest = int(away_m.argmin())
        return nearest if away_m[nearest] < BESIDE_M[1] else row
