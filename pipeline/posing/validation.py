"""Validation fixes: evidence from the training day on how far fixes can be trusted (METHODS 9.5).

In: the training day, its map and a `Fixer`. Out: `FixEvidence`, fixes of submaps whose true poses
are known; a `Verdict` learns from it. The steps of `ValidationBlocks.evidence`:

1. Choose validation blocks along the path, and remove them from the map.
2. Fix each submap of the blocks twice: unperturbed, and with simulated ageing, as a later day might
   see it.
3. From the right fixes, learn the least overlap of an approach worth refining.
4. Fix each submap once more, unperturbed, on a map without its surroundings: a novel place.
5. From the right fixes, learn the expected features (`probabilities.FEATURES`), place by place.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core import schemas, store
from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.frames import Poses, yaw
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, Seed, checked
from pipeline.mapping.gathering import submap_points
from pipeline.matching.holdout import blocks, number_blocks
from pipeline.matching.ranking import Localizer, Rows
from pipeline.posing.ageing import Ageing
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import Hypothesis, ScanFix
from pipeline.posing.probabilities import HypothesisModel
from pipeline.posing.registration import Points
from pipeline.posing.search import LIKELY, Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import OF_SCANS, FixEvidence

PART_LENGTH = 152
"""Number of queries that a process takes at a time."""
STREET_DEG = 30.0
"""A street ends where its heading has changed by this."""
STREET_M = 20.0
"""Submaps nearer than this to a street belong to it, such as those of a second drive through it."""
LOST_SHARE = 0.005
"""`least_overlap` ignores this share of the right approaches, those of least overlap."""
KEPT_SHARE = 0.8
"""An approach is worth refining if it has this share of the least overlap of right approaches:
right approaches overlap less on a later day than on the training day."""
LARGEST_LEAST = 0.3
"""An approach of this overlap is always worth refining: the training day does not show how little a
right approach overlaps after new walls, or from another lane."""


class ValidationSet(NamedTuple):
    """Blocks of the training day that are kept for validation together."""

    is_validation: NDArray[np.bool_]
    """(submap,) which submaps are kept for validation."""
    block: NDArray[np.int64]
    """(validation submap,) the number of its block; the numbers continue from set to set."""


@dataclass(frozen=True)
class ValidationQuery:
    """A validation submap as a query, in one of the ways in which it is queried."""

    row: int
    """The row of the submap."""
    is_aged: bool
    """Whether its points are aged, to what a later day might see."""
    answers: Answers
    """Where the method's ranking places the query."""
    left_out: NDArray[np.bool_]
    """(submap,) which submaps are left out of the map."""


@dataclass(frozen=True)
class Drive:
    """The submaps of a sequence, by the paths of its artifacts."""

    scans: Path
    submaps: Path

    def points_m(self, rows: Collection[int]) -> dict[int, Points]:
        """The points (n, 3) of some submaps by row, in their anchors' frames, z up from the ground.

        All submaps from the first to the last row are read at once, which is fastest.
        """
        if not rows:
            return {}
        scans = store.read(self.scans, schemas.Scans)
        submaps = store.read(self.submaps, schemas.Submaps)
        first = min(rows)
        numbered_points = enumerate(
            submap_points(scans, submaps, slice(first, max(rows) + 1)), first
        )
        return {row: points_m for row, points_m in numbered_points if row in rows}


@dataclass(frozen=True)
class TrainingDay:
    """The artifacts and the model of the training day; each artifact has one row a submap."""

    map_path: Path
    drive: Drive
    views: Rows
    places: NDArray[np.int64]
    """(submap,) the place of each submap."""
    view: Callable[[Points], NDArray[Any]]
    """Draws a view from points."""
    localizer: Localizer
    """Ranks places for views."""
    k: int
    """Number of answers for each view."""

    def answers(self, images: NDArray[Any], rows: NDArray[np.int64]) -> list[Answers]:
        """The ranking's answers to images (n, …) drawn for the rows (n,)."""
        ranking = self.localizer(
            Rows(images, self.views.stamps_ns[rows], self.views.world_T_anchor[rows]), self.k
        )
        return [Answers.of(ranking, number) for number in range(len(rows))]


@dataclass(frozen=True)
@checked("validation")
class ValidationBlocks:
    """Keeps blocks of the training day for validation, as if they were queries of another day."""

    every_m: Positive
    """Path from the start of one block to the start of the next."""
    length_m: Positive
    """Length of a block along the path."""
    around_m: Sequence[float]
    """To make a novel place, the map of a query lacks the submaps nearer than one of these
    distances; the rows take the distances in turn. The map of every second row lacks the whole
    street of the query, too: a place that repeats itself along its street is no likelier among the
    novel places than in the map."""
    enough: Count = 150
    """Wanted number of blocks. While there are fewer, further sets of blocks are kept for
    validation, from the path between the earlier ones. A target precision of .99 takes 99 accepted
    queries.
    """
    ageing: Ageing = field(default_factory=Ageing)
    """Ages the points of the validation submaps."""
    seed: Seed = 0
    """Seed of the ageing."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "around_m", tuple(self.around_m))  # a yaml has lists
        if not self.length_m < self.every_m:
            raise ConfigError(
                f"validation.length_m={self.length_m}: expected less than "
                f"validation.every_m={self.every_m}"
            )
        if not min(self.around_m, default=0) > 0:
            raise ConfigError(
                f"validation.around_m={list(self.around_m)}: expected lengths above 0"
            )

    def evidence(
        self, fixer: Fixer, day: TrainingDay, compute: Compute, progress: Progress
    ) -> FixEvidence[ScanFix]:
        """Fix each validation submap three times: unperturbed, aged, and as a novel place.

        Raises InputError for a map of another day.
        """
        mapped = Targets.read(day.map_path).world_T_anchor
        anchors = day.views.world_T_anchor
        if not np.array_equal(mapped, anchors):
            submaps = f"{len(mapped)} submaps that are not the {len(anchors)} of the training views"
            raise InputError(f"{day.map_path}: a map of {submaps}; is it of this data set?")
        # Query each validation submap twice: unperturbed, then aged.
        validation_sets = list(self._validation_sets(day))
        queries: list[ValidationQuery] = []
        for validation_set in validation_sets:
            queries += self._queries(day, validation_set.is_validation, compute)
        world_T_true = anchors[[query.row for query in queries]]
        fixes = self._fixes(fixer, day, queries, compute, progress, "validation blocks")
        least = least_overlap(fixes, world_T_true)

        # Query each once more, unperturbed, on a map without its surroundings: a novel place.
        unperturbed_queries = queries[::2]
        unseen_queries = []
        for query in unperturbed_queries:
            left_out = query.left_out | self._surroundings(anchors, query.row)
            unseen_queries.append(replace(query, left_out=left_out))
        unseen_fixes = self._fixes(
            replace(fixer, least_overlap=least),
            day,
            unseen_queries,
            compute,
            progress,
            "novel places",
        )

        # The evidence has three fixes of each validation submap, one after the other.
        unperturbed_fixes = fixes[::2]
        aged_fixes = fixes[1::2]
        triples = zip(unperturbed_fixes, aged_fixes, unseen_fixes, strict=True)
        evidence = FixEvidence(
            fixes=[gated(fix, least, fixer.model) for triple in triples for fix in triple],
            world_T_true=world_T_true[::2].repeat(3, axis=0),
            unseen=np.tile([False, False, True], len(unseen_queries)),
            block=np.concatenate(
                [validation_set.block for validation_set in validation_sets]
            ).repeat(3),
            least_overlap=least,
        )
        return with_expectations(evidence)

    def _validation_sets(self, day: TrainingDay) -> Iterator[ValidationSet]:
        """The sets of blocks that are kept for validation together, until there are `enough`."""
        anchors = day.views.world_T_anchor
        block_count = 0
        # Each set lies one block length behind the set before, up to the next block of the first
        # set; the last set may overlap with this block by less than half a length.
        last_m = self.every_m - self.length_m / 2
        for shift_m in np.arange(0.0, last_m, self.length_m).tolist():
            if block_count >= self.enough:
                return
            is_validation = blocks(anchors, day.places, self.every_m, self.length_m, shift_m)
            block = block_count + number_blocks(anchors, is_validation, self.every_m, self.length_m)
            block_count = int(block.max(initial=block_count - 1)) + 1
            yield ValidationSet(is_validation, block)

    def _queries(
        self, day: TrainingDay, is_validation: NDArray[np.bool_], compute: Compute
    ) -> list[ValidationQuery]:
        """The queries of the validation submaps: each unperturbed, then aged.

        `is_validation` (submap,) says which submaps these are. An aged submap is drawn and ranked
        again.
        """
        rows = np.flatnonzero(is_validation)
        drive = day.drive
        view = day.view  # a process gets `drive` and `view`, not the model
        parts = [rows[first : first + PART_LENGTH] for first in range(0, len(rows), PART_LENGTH)]

        def draw_aged(part: NDArray[np.int64]) -> list[NDArray[Any]]:
            """The views of some submaps with aged points."""
            return [
                view(self._aged(points_m, row))
                for row, points_m in drive.points_m(part.tolist()).items()
            ]

        aged_views = list(compute.each(draw_aged, parts))
        if not len(rows):
            return []
        unperturbed_images = np.asarray(day.views.images[:])[rows]
        aged_images = np.stack([image for part in aged_views for image in part])
        all_answers = zip(
            day.answers(unperturbed_images, rows), day.answers(aged_images, rows), strict=True
        )
        queries = []
        for row, (unperturbed_answers, aged_answers) in zip(
            rows.tolist(), all_answers, strict=True
        ):
            queries.append(
                ValidationQuery(
                    row, is_aged=False, answers=unperturbed_answers, left_out=is_validation
                )
            )
            queries.append(
                ValidationQuery(row, is_aged=True, answers=aged_answers, left_out=is_validation)
            )
        return queries

    def _fixes(
        self,
        fixer: Fixer,
        day: TrainingDay,
        queries: Sequence[ValidationQuery],
        compute: Compute,
        progress: Progress,
        label: str,
    ) -> list[ScanFix]:
        """The fix of each query."""
        drive = day.drive
        map_path = day.map_path
        parts = [
            queries[first : first + PART_LENGTH] for first in range(0, len(queries), PART_LENGTH)
        ]

        def fix_part(part: Sequence[ValidationQuery]) -> list[ScanFix]:
            """The fixes of some queries; each submap is read once."""
            targets = Targets.read(map_path)
            points_by_row = drive.points_m({query.row for query in part})
            fixes_of_part: list[ScanFix] = []
            for query in part:
                points_m = points_by_row[query.row]
                if query.is_aged:
                    points_m = self._aged(points_m, query.row)
                fixes_of_part.append(fixer.fix(points_m, targets, query.answers, query.left_out))
            return fixes_of_part

        finished_parts = progress.track(compute.each(fix_part, parts), len(parts), label)
        return [fix for part in finished_parts for fix in part]

    def _aged(self, points_m: Points, row: int) -> Points:
        """The points (n, 3) of a row, aged; the same at each call."""
        return self.ageing.aged(points_m, np.random.default_rng((self.seed, row)))

    def _surroundings(self, world_T_anchor: NDArray[np.float64], row: int) -> NDArray[np.bool_]:
        """The submaps (submap,) that are left out of the map to make a row a novel place."""
        away_m = np.linalg.norm(world_T_anchor[:, :2, 3] - world_T_anchor[row, :2, 3], axis=1)
        is_around = away_m < self.around_m[row // 2 % len(self.around_m)]
        return np.asarray(is_around | street_of(world_T_anchor, row) if row % 2 else is_around)


def street_of(world_T_anchor: NDArray[np.float64], row: int) -> NDArray[np.bool_]:
    """The submaps (submap,) of the street of a row, given the anchors' poses (submap, 4, 4).

    A street is the stretch of path around the row along which the heading differs from the row's by
    less than STREET_DEG, with all other submaps within STREET_M of it.
    """
    turn_deg = np.rad2deg(yaw(world_T_anchor) - yaw(world_T_anchor[row]))
    turns = np.flatnonzero(np.abs((turn_deg + 180) % 360 - 180) >= STREET_DEG)
    first = int(turns[turns < row].max(initial=-1)) + 1
    last = int(turns[turns > row].min(initial=len(world_T_anchor)))
    xy_m = world_T_anchor[:, :2, 3]
    away_m, _ = KDTree(xy_m[first:last]).query(xy_m)
    return np.asarray(away_m < STREET_M)


def least_overlap(fixes: Sequence[ScanFix], world_T_true: Poses) -> float:
    """The least overlap of an approach worth refining, by the fixes (q,) of validation submaps.

    It is KEPT_SHARE of the least overlap of the approaches that led to a right pose, without the
    lowest LOST_SHARE of them, and at most LARGEST_LEAST; 0 if no pose is right. The true poses are
    (q, 4, 4).
    """
    overlaps = []
    for fix, true_pose in zip(fixes, world_T_true, strict=True):
        right_hypotheses = _right_hypotheses(fix, true_pose)
        overlaps += [hypothesis.approach_overlap for hypothesis in right_hypotheses]
    if not overlaps:
        return 0.0
    return min(KEPT_SHARE * float(np.quantile(overlaps, LOST_SHARE)), LARGEST_LEAST)


def _right_hypotheses(fix: ScanFix, world_T_true: NDArray[np.float64]) -> list[Hypothesis]:
    """The hypotheses of a fix that are right, given the true pose (4, 4)."""
    return [
        hypothesis
        for hypothesis in fix.hypotheses
        if OF_SCANS.right(hypothesis.world_T_query[None], world_T_true[None])[0]
    ]


def with_expectations(evidence: FixEvidence[ScanFix]) -> FixEvidence[ScanFix]:
    """The same evidence, with the features of its right hypotheses as expectations.

    The features of each fix are lowered by the expectations from the other blocks only, so that no
    fix is judged by its own features.
    """
    right_hypotheses: list[Hypothesis] = []
    block_of_each: list[int] = []
    for fix, true_pose, is_unseen, block in zip(
        evidence.fixes, evidence.world_T_true, evidence.unseen, evidence.block, strict=True
    ):
        if not is_unseen:
            right_ones = _right_hypotheses(fix, true_pose)
            right_hypotheses += right_ones
            block_of_each += [int(block)] * len(right_ones)
    if not right_hypotheses:
        return evidence
    xy_m = np.array([hypothesis.world_T_query[:2, 3] for hypothesis in right_hypotheses])
    all_features = np.array([hypothesis.features for hypothesis in right_hypotheses])
    judged_fixes = []
    for fix, block in zip(evidence.fixes, evidence.block, strict=True):
        is_other = np.array(block_of_each) != block
        judged_fixes.append(judged_by(Expectations(xy_m[is_other], all_features[is_other]), fix))
    return replace(evidence, fixes=judged_fixes, expectations=Expectations(xy_m, all_features))


def judged_by(expectations: Expectations, fix: ScanFix) -> ScanFix:
    """The fix with its hypotheses' features lowered by the expectations at their positions."""
    return ScanFix.of(
        [
            replace(hypothesis, excess=expectations.excess(hypothesis.world_T_query[:2, 3]))
            for hypothesis in fix.hypotheses
        ]
    )


def gated(fix: ScanFix, least: float, model: HypothesisModel) -> ScanFix:
    """The fix that a search with the least overlap `least` finds, from a search without it.

    Hypotheses whose approaches overlap less are dropped, unless a hypothesis was likely: then the
    search refines every approach.
    """
    if fix.probability >= LIKELY:
        return fix
    refined = [hypothesis for hypothesis in fix.hypotheses if hypothesis.approach_overlap >= least]
    return ScanFix.of(refined, model)
