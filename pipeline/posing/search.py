"""The search for a query's pose: points and a ranking's answers in; a `ScanFix` out (METHODS 9.4).

`Fixer.fix` makes hypotheses, poses that the query may have, one after the other until one is sure:

1. Register the query against the submap at the pose of the ranking's first answer.
2. Work through rounds of candidates: the poses at which the query's walls fit best in the whole
   map, and the places of the ranking, whose walls are matched from above. In each round, register
   roughly from the best of both (an approach), and refine the approaches that overlap most.
3. Check each refined pose against the map (`Hypothesis`), and compute the probability of each.
4. If the likeliest pose has perceptual aliases that fit about as well (`aliases`), register the
   query at these too.

`Fixer.track` starts from an approximately known pose instead.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import islice
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.frames import yaw
from pipeline.core.settings import Count, NotNegative, Share, checked
from pipeline.mapping.wall_chart import Chart
from pipeline.matching.ranking import Ranking
from pipeline.posing.aliases import MOST_ALIASES, Aliases, aliases, aliases_in_map
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import Hypothesis, ScanFix, is_same_pose
from pipeline.posing.prior import Prior
from pipeline.posing.probabilities import USUAL, HypothesisModel
from pipeline.posing.registration import Alignment, Approach, Cloud, Points, Registration
from pipeline.posing.targets import Targets, within_range
from pipeline.posing.verification import Agreement, Seen, agreement
from pipeline.posing.walls import Walls
from pipeline.posing.whole_map import Slid, WholeMap

BESIDE_BOUNDS_M = (2.5, 15.0)
"""A pose is also checked against a second submap: at least the first distance away from the first
submap, and nearer to the pose than the second distance."""
LIKELY = 0.05
"""A hypothesis is likely from this probability on. Only a likely hypothesis is compared with its
aliases, and with approaches of little overlap."""


Guess = tuple[int, NDArray[np.float64]]
"""A training submap by its row, and a guess of the query's pose (4, 4) in its frame."""


class Answers(NamedTuple):
    """Where a ranking places a query, the likeliest first."""

    xy_m: NDArray[np.float64]
    """(k, 2) positions; NaN for an answer without a position."""
    heading_deg: NDArray[np.float64]
    """(k,) headings of the query if it is at this position; NaN if the method gives none."""

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

    def near(self, prior: Prior) -> "Answers":
        """The answers within a prior."""
        is_near = prior.is_near(self.xy_m) & prior.is_towards(np.deg2rad(self.heading_deg))
        return Answers(self.xy_m[is_near], self.heading_deg[is_near])


NO_ANSWERS = Answers(np.empty((0, 2)), np.empty(0))


@dataclass(frozen=True)
class Query:
    """A query, prepared for comparison with training submaps; its parts are computed on demand."""

    points_m: Points
    """(n, 3) points in the query's frame."""
    cloud: Cloud
    walls: Walls
    is_single_scan: bool
    """Whether all points are of one scan: then the sensor saw through the space before the
    walls."""

    @cached_property
    def walls_m(self) -> Points:
        """The points (n, 3) of the query's walls."""
        return self.walls.of(self.points_m)

    @cached_property
    def chart(self) -> Chart:
        """The chart of the query's walls from above."""
        return self.walls.chart(self.walls_m, self.is_single_scan)

    @cached_property
    def seen(self) -> Seen:
        """The points that the query's sensor hit, and the space that it saw through."""
        return Seen.of(self.walls, self.cloud, self.chart)

    @cached_property
    def middles(self) -> NDArray[np.float64]:
        """The centres (n, 2) of the cells with walls, in cells (Walls.middles)."""
        return self.walls.middles(self.walls_m)

    @cached_property
    def cells_at_headings(self) -> NDArray[np.int64]:
        """The cells of the walls at each heading (Walls.cells_at_headings)."""
        return self.walls.cells_at_headings(self.walls_m)


@dataclass(frozen=True)
@checked("fixer")
class Fixer:
    """Turns the answers of a ranking into a fix (conf/poses.yaml)."""

    whole_map: WholeMap = field(default_factory=WholeMap)
    """Slides walls over the whole map: for candidates that the ranking lacks, and for aliases."""
    walls: Walls = field(default_factory=Walls)
    """Matches walls with one candidate."""
    registration: Registration = field(default_factory=Registration)
    rounds: Sequence[int] = (5, 20)
    """Number of candidates in each round."""
    tries: Count = 5
    """Number of approaches in each round, to the candidates whose walls match best."""
    refined: Count = 2
    """Number of refinements in each round, of the approaches that overlap most."""
    sure: Share = 0.95
    """A hypothesis of this probability ends the search."""
    least_margin: NotNegative = 0.1
    """The query is also registered at the aliases of the likeliest hypothesis, unless its margin is
    at least this."""
    least_overlap: Share = 0.0
    """An approach of less overlap is not refined; learned from validation blocks (`validation`)."""
    widest_m: NotNegative = 0.5
    """A refined pose whose position has a larger spread is dropped: it is unconstrained in some
    direction, for example along a bare wall."""
    model: HypothesisModel = USUAL
    """The model of the probability that a hypothesis is right, learned from validation blocks."""
    expectations: Expectations = field(default_factory=Expectations)
    """The expected features at each place, learned from validation blocks."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "rounds", tuple(self.rounds))  # a yaml has lists
        if not min(self.rounds, default=0) >= 1:
            raise ConfigError(f"fixer.rounds={self.rounds}: expected at least 1")

    def fix(
        self,
        points_m: Points,
        targets: Targets,
        answers: Answers = NO_ANSWERS,
        left_out: NDArray[np.bool_] | None = None,
        prior: Prior | None = None,
    ) -> ScanFix:
        """Fix a query's points (n, 3), z up from the ground.

        The answers of a ranking are tried first, then the whole map. Training submaps that are True
        in `left_out` (row,) are ignored. With a prior, only answers and submaps within it are
        tried, and the ranking's first answer, wherever it is, as their rival. The fix has no
        hypothesis if the points are too few or not finite.
        """
        query = self._prepared(points_m, targets)
        if query is None:
            return ScanFix()
        left_out = np.zeros(len(targets.world_T_anchor), bool) if left_out is None else left_out
        slid = None
        if not targets.is_map and not left_out.all():
            slid = self._slid(query, targets, left_out, prior)
        search = _Search(self, query, targets, left_out, prior, slid)
        return self._first_sure(partial(search.everywhere, answers), search.from_aliases, prior)

    def track(
        self, points_m: Points, targets: Targets, world_T_guess: NDArray[np.float64], rows: int = 2
    ) -> ScanFix:
        """Fix a query's points (n, 3) whose pose is known to a metre and some degrees.

        The points are registered from this guess (4, 4) against the nearest submaps, at most
        `rows`, one after the other until a hypothesis is sure.
        """
        query = self._prepared(points_m, targets)
        if query is None:
            return ScanFix()
        search = _Search(self, query, targets, np.zeros(len(targets.world_T_anchor), bool))

        def from_guess(_: Callable[[], float]) -> Iterator[Hypothesis]:
            return search.from_guess(world_T_guess, rows)  # refined whatever the overlap

        return self._first_sure(from_guess)

    def _prepared(self, points_m: Points, targets: Targets) -> Query | None:
        """Prepare the query; returns None if it has too few points."""
        points_m = within_range(points_m, targets.range_m)
        try:
            cloud = self.registration.prepare(points_m)
        except InputError:
            return None
        return Query(points_m, cloud, self.walls, targets.single or targets.is_map)

    def _slid(
        self,
        query: Query,
        targets: Targets,
        left_out: NDArray[np.bool_],
        prior: Prior | None,
    ) -> Slid:
        """The query, to be slid over the walls of the whole map, or of the map within a prior."""
        walls = targets.wall_map(self.whole_map, left_out)
        if prior is not None:
            walls = walls.near(prior.xy_m, prior.reach_m)
        scan = self.whole_map.scan(query.points_m, query.is_single_scan)
        return Slid(self.whole_map, walls, scan)

    def _first_sure(
        self,
        make_hypotheses: Callable[[Callable[[], float]], Iterator[Hypothesis]],
        register_aliases: Callable[[Hypothesis], list[Hypothesis]] | None = None,
        prior: Prior | None = None,
    ) -> ScanFix:
        """Build the fix from as many hypotheses as it takes to be sure of one.

        `make_hypotheses` makes them one by one. Its argument is a function that returns the least
        overlap of an approach worth refining. This overlap changes on the way: once there is a
        likely hypothesis, every further pose is worth a comparison with it. `register_aliases`
        makes the hypotheses at the aliases of the likeliest hypothesis; if one of these becomes the
        likeliest, its own aliases are registered too.
        """
        hypotheses: list[Hypothesis] = []
        compared: list[Hypothesis] = []
        fix = ScanFix()

        def least_overlap() -> float:
            return 0.0 if fix.probability >= LIKELY else self.least_overlap

        for hypothesis in make_hypotheses(least_overlap):
            hypotheses.append(hypothesis)
            fix = ScanFix.of(hypotheses, self.model, prior)
            while register_aliases is not None and self._needs_comparison(fix, compared):
                compared.append(fix.hypotheses[0])
                hypotheses += register_aliases(fix.hypotheses[0])
                fix = ScanFix.of(hypotheses, self.model, prior)
            if fix.probability >= self.sure:
                break
        return fix

    def _needs_comparison(self, fix: ScanFix, compared: Sequence[Hypothesis]) -> bool:
        """Whether the likeliest hypothesis is still to be compared with its aliases.

        It is not if its margin is large, if it is not likely, or if a hypothesis at the same pose
        was `compared` before.
        """
        best = fix.hypotheses[0]
        if fix.probability < LIKELY or best.aliases.margin >= self.least_margin:
            return False
        return not is_same_pose(best, compared).any()


@dataclass(frozen=True)
class _Search:
    """Computes the hypotheses of one query, each on demand."""

    fixer: Fixer
    query: Query
    targets: Targets
    left_out: NDArray[np.bool_]
    prior: Prior | None = None
    slid: Slid | None = None
    """The query over the walls of the whole map; None if only a guess is tried, or if the ranking
    has searched the whole map."""

    def everywhere(
        self, answers: Answers, least_overlap: Callable[[], float]
    ) -> Iterator[Hypothesis]:
        """Hypotheses all over the map: from the ranking's first answer, then from candidates.

        Only approaches of `least_overlap()` or more are refined. With a prior, the candidates are
        those within it. The ranking's first answer is a rival of them: it comes first if it is
        outside, before a candidate can end the search.
        """
        left_out = self.left_out
        if self.prior is not None:
            first = Answers(answers.xy_m[:1], answers.heading_deg[:1])
            if not len(first.near(self.prior).xy_m):
                yield from self._from_first_answer(first, least_overlap)
            answers = answers.near(self.prior)
            anchors_m = self.targets.world_T_anchor[:, :2, 3]
            left_out = left_out | ~self.prior.is_near(anchors_m, self.fixer.walls.offset_m)
        if self.targets.is_map:
            yield from self._from_answers(answers, least_overlap)
            return
        yield from self._from_first_answer(answers, least_overlap)
        fits = self._guesses_in_whole_map()
        rows = self.targets.spaced(self.targets.nearest(answers.xy_m, left_out))
        for count in self.fixer.rounds:
            guesses = list(islice(fits, self.fixer.tries))
            yield from self._best_first(guesses, least_overlap)
            yield from self._round(list(islice(rows, count)), least_overlap)

    def from_guess(self, world_T_guess: NDArray[np.float64], rows: int) -> Iterator[Hypothesis]:
        """Hypotheses from one guessed pose, against the nearest submaps."""
        away_m = np.linalg.norm(
            self.targets.world_T_anchor[:, :2, 3] - world_T_guess[:2, 3], axis=1
        )
        for row in np.argsort(away_m, kind="stable")[:rows].tolist():
            guess = np.linalg.inv(self.targets.world_T_anchor[row]) @ world_T_guess
            yield from self._registered(row, guess)

    def from_aliases(self, hypothesis: Hypothesis) -> list[Hypothesis]:
        """Register the query at the aliases of a hypothesis; returns the hypotheses made there.

        All aliases are approached, and the MOST_ALIASES that overlap most are refined.
        """
        guesses = [(alias.row, alias.target_T_query) for alias in hypothesis.aliases.ranked]
        return list(self._refined_best(guesses, MOST_ALIASES, lambda: 0.0))

    def _from_first_answer(
        self, answers: Answers, least_overlap: Callable[[], float]
    ) -> Iterator[Hypothesis]:
        """A hypothesis from the position and heading of the ranking's first answer.

        There is no hypothesis if the answer lacks either of them.
        """
        for row, guess in self._guesses(answers, slice(1)):
            yield from self._registered(row, guess, least_overlap())

    def _from_answers(
        self, answers: Answers, least_overlap: Callable[[], float]
    ) -> Iterator[Hypothesis]:
        """Hypotheses from the positions and headings of all answers, the first one alone first.

        Then come rounds of `tries` answers, of which those that overlap most are refined.
        """
        yield from self._from_first_answer(answers, least_overlap)
        first = 1
        for _ in self.fixer.rounds:
            # a cut-out is approached once, from the last of its guesses
            guesses = dict(self._guesses(answers, slice(first, first + self.fixer.tries)))
            yield from self._refined_best(guesses.items(), self.fixer.refined, least_overlap)
            first += self.fixer.tries

    def _guesses_in_whole_map(self) -> Iterator[Guess]:
        """Where the query's walls fit best in the whole map, or within the prior."""
        if self.slid is None:
            return
        fits = self.slid.fits
        found = Answers(fits.xy_m, fits.heading_deg)
        if self.prior is not None:
            found = found.near(self.prior)
        yield from self._guesses(found, slice(None))

    def _guesses(self, answers: Answers, rows: slice) -> Iterator[Guess]:
        """For each of some answers, the nearest submap and the guessed pose (4, 4) in its frame."""
        yield from self.targets.guesses(
            answers.xy_m[rows],
            answers.heading_deg[rows],
            self.left_out,
            self.fixer.walls.offset_m,
        )

    def _round(
        self, rows: Sequence[int], least_overlap: Callable[[], float]
    ) -> Iterator[Hypothesis]:
        """Hypotheses from candidate rows: from the best match of walls, then from further ones."""
        fixer = self.fixer
        matches = {}  # by row
        for row in rows:
            chart = self.targets.chart(fixer.walls, row)
            headings = self._headings(row)
            matches[row] = fixer.walls.match(chart, self.query.cells_at_headings, headings)
        best_rows = sorted(matches, key=lambda row: -matches[row].score)[: fixer.tries]
        guesses = [(row, matches[row].target_T_query) for row in best_rows]
        yield from self._best_first(guesses, least_overlap)

    def _best_first(
        self, guesses: Sequence[Guess], least_overlap: Callable[[], float]
    ) -> Iterator[Hypothesis]:
        """Hypotheses from guesses, the best first.

        The best guess is refined before the others: it is often right, and the search may end.
        """
        yield from self._refined_best(guesses[:1], 1, least_overlap)
        yield from self._refined_best(guesses[1:], self.fixer.refined - 1, least_overlap)

    def _headings(self, row: int) -> NDArray[np.int64] | None:
        """The numbers of the headings within the prior in a submap's frame; None for all."""
        if self.prior is None or self.prior.reach_rad >= np.pi:
            return None
        step_rad = 2 * np.pi / self.fixer.walls.headings
        headings_rad = np.arange(self.fixer.walls.headings) * step_rad
        in_world_rad = headings_rad + yaw(self.targets.world_T_anchor[row])
        return np.flatnonzero(self.prior.is_towards(in_world_rad, step_rad))

    def _refined_best(
        self,
        guesses: Iterable[Guess],
        refined_count: int,
        least_overlap: Callable[[], float],
    ) -> Iterator[Hypothesis]:
        """Approach submaps from guesses, and refine the approaches that overlap most."""
        approaches: list[tuple[int, Approach]] = []
        for row, guess in guesses:
            for approach in self._approached(row, guess):
                if approach.overlap >= least_overlap():
                    approaches.append((row, approach))
        approaches.sort(key=lambda row_and_approach: -row_and_approach[1].overlap)
        for row, approach in approaches[:refined_count]:
            yield from self._refined(row, approach)

    def _registered(
        self, row: int, target_T_query: NDArray[np.float64], least_overlap: float = 0.0
    ) -> Iterator[Hypothesis]:
        """Approach one submap from a guess, and refine; no hypothesis if either fails."""
        for approach in self._approached(row, target_T_query):
            if approach.overlap >= least_overlap:
                yield from self._refined(row, approach)

    def _approached(self, row: int, target_T_query: NDArray[np.float64]) -> list[Approach]:
        """The approach to a submap from a guess (4, 4); empty if the submap has too few points."""
        registration = self.fixer.registration
        try:
            target = self.targets.cloud(registration, row)
        except InputError:
            return []
        return [registration.approach(target, self.query.cloud, target_T_query)]

    def _refined(self, row: int, approach: Approach) -> Iterator[Hypothesis]:
        """Refine the approach to one submap; no hypothesis if a direction is unconstrained."""
        registration = self.fixer.registration
        target = self.targets.cloud(registration, row)
        alignment = registration.refine(target, self.query.cloud, approach.target_T_source)
        if alignment.spread_m <= self.fixer.widest_m:
            yield self._hypothesis(row, alignment, approach.overlap)

    def _hypothesis(self, row: int, alignment: Alignment, approach_overlap: float) -> Hypothesis:
        """The hypothesis of a refined alignment with a submap, checked against the map."""
        fixer = self.fixer
        world_T_query = self.targets.world_T_anchor[row] @ alignment.target_T_source
        # The cosine of the angle between both z axes; rounding may take it beyond 1.
        upward_cosine = np.clip(alignment.target_T_source[2, 2], -1, 1)
        return Hypothesis(
            row=row,
            world_T_query=world_T_query,
            alignment=alignment,
            here=self._agreement(row, world_T_query),
            beside=self._agreement(self._beside(row, world_T_query), world_T_query),
            tilt_deg=float(np.rad2deg(np.arccos(upward_cosine))),
            aliases=self._aliases(world_T_query),
            approach_overlap=approach_overlap,
            excess=fixer.expectations.excess(world_T_query[:2, 3]),
        )

    def _aliases(self, world_T_query: NDArray[np.float64]) -> Aliases:
        """The aliases of a pose, near it and in the whole map."""
        near = aliases(
            self.fixer.walls, self.targets, self.query.middles, world_T_query, self.left_out
        )
        if self.slid is None:
            return near
        least_margin = self.fixer.least_margin
        return aliases_in_map(
            self.slid, self.targets, world_T_query, self.left_out, near, least_margin
        )

    def _agreement(self, row: int, world_T_query: NDArray[np.float64]) -> Agreement:
        """The agreement of the query, at a pose, with a submap."""
        fixer = self.fixer
        target = self.targets.seen(fixer.registration, fixer.walls, row)
        target_T_query = np.linalg.inv(self.targets.world_T_anchor[row]) @ world_T_query
        inlier_m = fixer.registration.inlier_m
        return agreement(fixer.walls, inlier_m, target, self.query.seen, target_T_query)

    def _beside(self, row: int, world_T_query: NDArray[np.float64]) -> int:
        """The submap nearest to a pose, away from that of `row`; `row` itself if there is none.

        A cut-out of the same map says nothing else.
        """
        if self.targets.is_map:
            return row
        least_m, most_m = BESIDE_BOUNDS_M
        anchors_m = self.targets.world_T_anchor[:, :2, 3]
        away_m = np.linalg.norm(anchors_m - world_T_query[:2, 3], axis=1)
        is_elsewhere = np.linalg.norm(anchors_m - anchors_m[row], axis=1) >= least_m
        away_m[self.left_out | ~is_elsewhere] = np.inf
        nearest = int(away_m.argmin())
        return nearest if away_m[nearest] < most_m else row
