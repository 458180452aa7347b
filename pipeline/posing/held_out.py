"""Held-out fixes: evidence of how far a fix can be trusted, from the training day (METHODS 9.5).

In: the training day, its map and a `Fixer`. Out: `Evidence`, from which a `Verdict` learns: fixes
of submaps whose true poses are known. The steps of `HeldOut.evidence`:

1. Choose blocks of the path and take them out of the map.
2. Fix each of their submaps as it was driven, and once more aged, as a later day would see it.
3. From the fixes that are right, learn from which overlap on an approach is worth refining.
4. Fix each again, as driven, on a map without its surroundings: a place never seen.
5. From the right fixes, learn which signs (`chances.SIGNS`) to expect where.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.frames import Poses
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, Seed, check
from pipeline.mapping.gathering import submap_points
from pipeline.matching.holdout import blocks, numbered
from pipeline.matching.ranking import Localizer, Rows
from pipeline.posing.ageing import Ageing
from pipeline.posing.chances import Chances
from pipeline.posing.expectations import Expectations
from pipeline.posing.fix import Fix, Hypothesis
from pipeline.posing.registration import Points
from pipeline.posing.search import LIKELY, Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import Evidence, right

PART_LENGTH = 152
"""Questions that a process takes at a time."""
LOST_SHARE = 0.005
"""This share of the right approaches, those of least overlap, is left out in `least_overlap`."""
KEPT_SHARE = 0.8
"""An approach is worth refining if it has this share of the least overlap of right ones: on a later
day right ones have less overlap than on the training day."""
LARGEST_LEAST = 0.3
"""An approach of this overlap is always worth refining: the training day does not show how little
right ones overlap after new walls, or from another lane."""


class HeldSet(NamedTuple):
    """Blocks of the training day that are held out together."""

    rows: NDArray[np.bool_]
    """(submap,) which are held out."""
    block: NDArray[np.int64]
    """(held-out submap,) the number of its block, counted on from one set to the next."""


@dataclass(frozen=True)
class Question:
    """A held-out submap as a query, asked once."""

    row: int
    is_aged: bool
    """Whether its points are changed to what a later day would see."""
    answers: Answers
    """Where the method's ranking places it."""
    left_out: NDArray[np.bool_]
    """(submap,) which submaps the map lacks."""


@dataclass(frozen=True)
class Drive:
    """The submaps of a sequence, by the paths of its artifacts."""

    scans: Path
    submaps: Path

    def points_m(self, rows: Collection[int]) -> dict[int, Points]:
        """The points (n, 3) of some submaps by row, in their anchors' frames, z up from the ground.

        All submaps from the first to the last row are read in one go, which is the fastest.
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
    """(submap,) the place of each."""
    view: Callable[[Points], NDArray[Any]]
    """Draws a view from points."""
    localizer: Localizer
    """Ranks places for views."""
    k: int
    """Number of answers to each view."""

    def answers(self, images: NDArray[Any], rows: NDArray[np.int64]) -> list[Answers]:
        """The ranking's answers to images that were drawn anew for some of the rows."""
        ranking = self.localizer(
            Rows(images, self.views.stamps_ns[rows], self.views.world_T_anchor[rows]), self.k
        )
        return [Answers.of(ranking, number) for number in range(len(rows))]


@dataclass(frozen=True)
class HeldOut:
    """Which submaps of the training day are held out, as if they were queries of another day."""

    every_m: Positive
    """Path from the start of one block to the start of the next."""
    length_m: Positive
    """Length of a block along the path."""
    around_m: Sequence[float]
    """For a place never seen, a submap is asked on a map without the submaps nearer than one of
    these distances; the rows take them in turn."""
    enough: Count = 150
    """Wanted number of blocks: as long as there are fewer, further sets of blocks are held out,
    from the path between the first ones. To promise a precision of .99 takes 99 accepted queries.
    """
    ageing: Ageing = field(default_factory=Ageing)
    seed: Seed = 0

    def __post_init__(self) -> None:
        check(self, "held_out")
        object.__setattr__(self, "around_m", tuple(self.around_m))  # a yaml has lists
        if not self.length_m < self.every_m:
            raise ConfigError(
                f"held_out.length_m={self.length_m}: expected less than "
                f"held_out.every_m={self.every_m}"
            )
        if not min(self.around_m, default=0) > 0:
            raise ConfigError(f"held_out.around_m={list(self.around_m)}: expected lengths above 0")

    def evidence(
        self, fixer: Fixer, day: TrainingDay, compute: Compute, progress: Progress
    ) -> Evidence:
        """Fix all held-out submaps: as driven, aged, and as places never seen.

        Raises InputError for a map of another day.
        """
        mapped = Targets.read(day.map_path).world_T_anchor
        anchors = day.views.world_T_anchor
        if not np.array_equal(mapped, anchors):
            submaps = f"{len(mapped)} submaps that are not the {len(anchors)} of the training views"
            raise InputError(f"{day.map_path}: a map of {submaps}; is it of this data set?")
        # Each held-out submap twice: as driven, then aged.
        held_sets = list(self._held_sets(day))
        seen: list[Question] = []
        for held in held_sets:
            seen += self._questions(day, held.rows, compute)
        world_T_true = anchors[[question.row for question in seen]]
        seen_fixes = self._fixes(fixer, day, seen, compute, progress, "held-out blocks")
        least = least_overlap(seen_fixes, world_T_true)

        # Each held-out submap as driven, as a place never seen.
        unseen = [
            replace(question, left_out=question.left_out | self._around(anchors, question.row))
            for question in seen[::2]
        ]
        unseen_fixes = self._fixes(
            replace(fixer, least_overlap=least), day, unseen, compute, progress, "places never seen"
        )

        # Three fixes of each held-out submap, one after the other.
        triples = zip(seen_fixes[::2], seen_fixes[1::2], unseen_fixes, strict=True)
        evidence = Evidence(
            fixes=[gated(fix, least, fixer.chances) for triple in triples for fix in triple],
            world_T_true=world_T_true[::2].repeat(3, axis=0),
            unseen=np.tile([False, False, True], len(unseen)),
            block=np.concatenate([held.block for held in held_sets]).repeat(3),
            least_overlap=least,
        )
        return with_expectations(evidence)

    def _held_sets(self, day: TrainingDay) -> Iterator[HeldSet]:
        """The sets of blocks that are held out together, until there are enough blocks."""
        anchors = day.views.world_T_anchor
        first = 0
        for later_m in np.arange(0.0, self.every_m - self.length_m / 2, self.length_m).tolist():
            if first >= self.enough:
                return
            held = blocks(anchors, day.places, self.every_m, self.length_m, later_m)
            block = first + numbered(anchors, held, self.every_m, self.length_m)
            first = int(block.max(initial=first - 1)) + 1
            yield HeldSet(held, block)

    def _questions(
        self, day: TrainingDay, held: NDArray[np.bool_], compute: Compute
    ) -> list[Question]:
        """The questions of the submaps that are held out (submap,): each as driven, then aged.

        An aged submap is drawn and ranked anew.
        """
        rows = np.flatnonzero(held)
        drive = day.drive
        view = day.view  # a process gets these, not the model
        parts = [rows[first : first + PART_LENGTH] for first in range(0, len(rows), PART_LENGTH)]

        def drawn(part: NDArray[np.int64]) -> list[NDArray[Any]]:
            return [
                view(self._aged(points_m, row))
                for row, points_m in drive.points_m(part.tolist()).items()
            ]

        aged_views = list(compute.each(drawn, parts))
        if not len(rows):
            return []
        driven = day.answers(np.asarray(day.views.images[:])[rows], rows)
        aged = day.answers(np.stack([image for part in aged_views for image in part]), rows)
        questions = []
        for row, driven_answers, aged_answers in zip(rows.tolist(), driven, aged, strict=True):
            questions.append(Question(row, False, driven_answers, held))
            questions.append(Question(row, True, aged_answers, held))
        return questions

    def _fixes(
        self,
        fixer: Fixer,
        day: TrainingDay,
        questions: Sequence[Question],
        compute: Compute,
        progress: Progress,
        label: str,
    ) -> list[Fix]:
        """The fix of each question."""
        drive = day.drive
        map_path = day.map_path
        parts = [
            questions[first : first + PART_LENGTH]
            for first in range(0, len(questions), PART_LENGTH)
        ]

        def fixes(part: Sequence[Question]) -> list[Fix]:
            targets = Targets.read(map_path)
            driven_m = drive.points_m({question.row for question in part})
            fixes_of_part: list[Fix] = []
            for question in part:
                points_m = driven_m[question.row]
                if question.is_aged:
                    points_m = self._aged(points_m, question.row)
                fixes_of_part.append(
                    fixer.fix(points_m, targets, question.answers, question.left_out)
                )
            return fixes_of_part

        finished_parts = progress.track(compute.each(fixes, parts), len(parts), label)
        return [fix for part in finished_parts for fix in part]

    def _aged(self, points_m: Points, row: int) -> Points:
        """The points (n, 3) of a row as a later day would see them; always the same ones."""
        return self.ageing.aged(points_m, np.random.default_rng((self.seed, row)))

    def _around(self, world_T_anchor: NDArray[np.float64], row: int) -> NDArray[np.bool_]:
        """Which submaps (submap,) the map lacks where a row is asked as a place never seen."""
        away_m = np.linalg.norm(world_T_anchor[:, :2, 3] - world_T_anchor[row, :2, 3], axis=1)
        return np.asarray(away_m < self.around_m[row % len(self.around_m)])


def least_overlap(fixes: Sequence[Fix], world_T_true: Poses) -> float:
    """From which overlap on an approach is worth refining, by fixes of held-out submaps.

    It is KEPT_SHARE of the least overlap (all but LOST_SHARE) of those approaches of q fixes that
    led to a right pose, but LARGEST_LEAST at most; 0 if none did. The true poses are (q, 4, 4).
    """
    overlaps = []
    for fix, true in zip(fixes, world_T_true, strict=True):
        overlaps += [hypothesis.approached for hypothesis in _right_hypotheses(fix, true)]
    if not overlaps:
        return 0.0
    return min(KEPT_SHARE * float(np.quantile(overlaps, LOST_SHARE)), LARGEST_LEAST)


def _right_hypotheses(fix: Fix, world_T_true: NDArray[np.float64]) -> list[Hypothesis]:
    """The hypotheses of a fix that are right, given the true pose (4, 4)."""
    return [
        hypothesis
        for hypothesis in fix.hypotheses
        if right(hypothesis.world_T_query[None], world_T_true[None])[0]
    ]


def with_expectations(evidence: Evidence) -> Evidence:
    """The same evidence, with the signs of its right hypotheses as expectations.

    The signs in each fix are lowered by the expectations from other blocks alone: no fix is judged
    by its own signs.
    """
    right_hypotheses: list[Hypothesis] = []
    block_of_each: list[int] = []
    for fix, true, is_unseen, block in zip(
        evidence.fixes, evidence.world_T_true, evidence.unseen, evidence.block, strict=True
    ):
        if not is_unseen:
            of_fix = _right_hypotheses(fix, true)
            right_hypotheses += of_fix
            block_of_each += [int(block)] * len(of_fix)
    if not right_hypotheses:
        return evidence
    xy_m = np.array([hypothesis.world_T_query[:2, 3] for hypothesis in right_hypotheses])
    all_signs = np.array([hypothesis.signs for hypothesis in right_hypotheses])
    judged_fixes = []
    for fix, block in zip(evidence.fixes, evidence.block, strict=True):
        is_other = np.array(block_of_each) != block
        judged_fixes.append(judged_by(Expectations(xy_m[is_other], all_signs[is_other]), fix))
    return replace(evidence, fixes=judged_fixes, expectations=Expectations(xy_m, all_signs))


def judged_by(expectations: Expectations, fix: Fix) -> Fix:
    """The fix with its hypotheses' signs lowered by what is expected where each of them is."""
    return Fix.of(
        [
            replace(hypothesis, excess=expectations.excess(hypothesis.world_T_query[:2, 3]))
            for hypothesis in fix.hypotheses
        ]
    )


def gated(fix: Fix, least: float, chances: Chances) -> Fix:
    """The fix that a search with this least overlap finds, given the fix of a search without."""
    if fix.chance >= LIKELY:  # then any overlap is worth refining
        return fix
    refined = [hypothesis for hypothesis in fix.hypotheses if hypothesis.approached >= least]
    return Fix.of(refined, chances)
