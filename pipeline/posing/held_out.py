"""Held-out fixes: evidence of what a fix is worth, from blocks of the training day.

Each block is localised on the map without it.
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
from pipeline.posing.fix import Fix
from pipeline.posing.registration import Points
from pipeline.posing.search import LIKELY, Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import Evidence, right

PART = 152
"""Questions that a process takes at a time."""
LOST = 0.005
"""Share of the right approaches of held-out submaps that may overlap less than KEPT says."""
KEPT = 0.8
"""An approach is refined whose overlap is KEPT of the least overlap of a right one: a later day has
less of it than the training day."""
MOST_LEAST = 0.3
"""An approach of more overlap is refined however much right ones overlap: the training day says
nothing of new walls, nor of another lane."""


class HeldSet(NamedTuple):
    """Blocks of the training day that are held out together."""

    rows: NDArray[np.bool_]
    """(submap,) which are held out."""
    block: NDArray[np.int64]
    """(held-out submap,) the block of each, over all sets."""


@dataclass(frozen=True)
class Question:
    """A held-out submap, as it is asked once."""

    row: int
    is_aged: bool
    """Whether it is asked as a later day would see it, not as driven."""
    answers: Answers
    left_out: NDArray[np.bool_]
    """(submap,) what the map lacks."""


@dataclass(frozen=True)
class Drive:
    """The submaps of a sequence, by the paths of its artifacts."""

    scans: Path
    submaps: Path

    def points_m(self, rows: Collection[int]) -> dict[int, Points]:
        """The points (n, 3) of some submaps, in their anchors' frames, z up from the ground.

        All from the first to the last are read in one go: that is faster than one by one.
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
    """The artifacts and the model of the training day, a row a submap in each."""

    map_path: Path
    drive: Drive
    views: Rows
    places: NDArray[np.int64]
    """(submap,)."""
    view: Callable[[Points], NDArray[Any]]
    """Draws a view."""
    localizer: Localizer
    """Ranks places for views."""
    k: int
    """Answers to each view."""

    def answers(self, images: NDArray[Any], rows: NDArray[np.int64]) -> list[Answers]:
        """The ranking's answers to images, drawn anew, of some of the rows."""
        ranking = self.localizer(
            Rows(images, self.views.stamps_ns[rows], self.views.world_T_anchor[rows]), self.k
        )
        return [Answers.of(ranking, number) for number in range(len(rows))]


@dataclass(frozen=True)
class HeldOut:
    """Which submaps of the training day are held out, as if they were queries of another day."""

    every_m: Positive
    """Path from one block to the next."""
    length_m: Positive
    around_m: Sequence[float]
    """A query is asked once more without the training submaps that are nearer than one of these,
    each in its turn: as a place never seen."""
    enough: Count = 150
    """Blocks: where there are fewer, the path between them is held out in its turn.

    A promise of .99 takes 99 accepted.
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
        """Fix all held-out submaps: as driven, aged, and without their surroundings in the map.

        The map is that of the other blocks. An aged submap is drawn and ranked anew. At places
        never seen an approach is refined from the `least_overlap` of those that were right. Signs
        are less what right fixes of other blocks lead to expect. Raises InputError for a map of
        another day.
        """
        mapped = Targets.read(day.map_path).world_T_anchor
        anchors = day.views.world_T_anchor
        if not np.array_equal(mapped, anchors):
            submaps = f"{len(mapped)} submaps that are not the {len(anchors)} of the training views"
            raise InputError(f"{day.map_path}: a map of {submaps}; is it of this data set?")
        held_sets = list(self._held_sets(day))
        seen = [
            question for held in held_sets for question in self._questions(day, held.rows, compute)
        ]
        world_T_true = anchors[[question.row for question in seen]]
        seen_fixes = self._fixes(fixer, day, seen, compute, progress, "held-out blocks")
        least = least_overlap(seen_fixes, world_T_true)
        unseen = [
            replace(question, left_out=question.left_out | self._around(anchors, question.row))
            for question in seen[::2]
        ]
        unseen_fixes = self._fixes(
            replace(fixer, least_overlap=least), day, unseen, compute, progress, "places never seen"
        )
        triples = zip(seen_fixes[::2], seen_fixes[1::2], unseen_fixes, strict=True)
        evidence = Evidence(
            [gated(fix, least, fixer.chances) for triple in triples for fix in triple],
            world_T_true[::2].repeat(3, axis=0),
            np.tile([False, False, True], len(unseen)),
            np.concatenate([held.block for held in held_sets]).repeat(3),
            least,
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
        """Each submap that is held out (submap,) as driven, then as a later day would see it."""
        rows = np.flatnonzero(held)
        drive = day.drive
        view = day.view  # a process gets these, not the model
        parts = [rows[first : first + PART] for first in range(0, len(rows), PART)]

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
        return [
            Question(row, is_aged, answers, held)
            for row, *both in zip(rows.tolist(), driven, aged, strict=True)
            for is_aged, answers in zip((False, True), both, strict=True)
        ]

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
        parts = [questions[first : first + PART] for first in range(0, len(questions), PART)]

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
        """The points (n, 3) of a row as a later day would see them, always the same ones."""
        return self.ageing.aged(points_m, np.random.default_rng((self.seed, row)))

    def _around(self, world_T_anchor: NDArray[np.float64], row: int) -> NDArray[np.bool_]:
        """The submaps (submap,) around a row, without which it is asked as a place never seen."""
        away_m = np.linalg.norm(world_T_anchor[:, :2, 3] - world_T_anchor[row, :2, 3], axis=1)
        return np.asarray(away_m < self.around_m[row % len(self.around_m)])


def least_overlap(fixes: Sequence[Fix], world_T_true: Poses) -> float:
    """From which overlap on an approach is worth refining, by the fixes of held-out submaps.

    All but LOST of the right hypotheses of q fixes, whose true poses are (q, 4, 4), came from
    approaches of more overlap; KEPT of that is asked for, and MOST_LEAST at most. 0 where none is
    right.
    """
    overlaps = [
        hypothesis.approached
        for fix, true in zip(fixes, world_T_true, strict=True)
        for hypothesis in fix.hypotheses
        if right(hypothesis.world_T_query[None], true[None])[0]
    ]
    if not overlaps:
        return 0.0
    return min(KEPT * float(np.quantile(overlaps, LOST)), MOST_LEAST)


def with_expectations(evidence: Evidence) -> Evidence:
    """The same evidence, with the signs of its right fixes as expectations.

    Each fix is judged by those of other blocks, as a query of another day is by all of them.
    """
    right_fixes = [
        (block, hypothesis)
        for fix, true, unseen, block in zip(
            evidence.fixes, evidence.world_T_true, evidence.unseen, evidence.block, strict=True
        )
        for hypothesis in fix.hypotheses
        if not unseen and right(hypothesis.world_T_query[None], true[None])[0]
    ]
    if not right_fixes:
        return evidence
    blocks_of_right = np.array([block for block, _ in right_fixes])
    xy_m = np.array([hypothesis.world_T_query[:2, 3] for _, hypothesis in right_fixes])
    all_signs = np.array([hypothesis.signs for _, hypothesis in right_fixes])
    judged_fixes = []
    for fix, block in zip(evidence.fixes, evidence.block, strict=True):
        is_other = blocks_of_right != block
        judged_fixes.append(judged_by(Expectations(xy_m[is_other], all_signs[is_other]), fix))
    return replace(evidence, fixes=judged_fixes, expectations=Expectations(xy_m, all_signs))


def judged_by(expectations: Expectations, fix: Fix) -> Fix:
    """The fix, its hypotheses' signs less what is expected where each of them lies."""
    return Fix.of(
        [
            replace(hypothesis, excess=expectations.excess(hypothesis.world_T_query[:2, 3]))
            for hypothesis in fix.hypotheses
        ]
    )


def gated(fix: Fix, least: float, chances: Chances) -> Fix:
    """The fix as a search with a least overlap finds it, of one without."""
    if fix.chance >= LIKELY:
        return fix
    return Fix.of(
        [hypothesis for hypothesis in fix.hypotheses if hypothesis.approached >= least], chances
    )
