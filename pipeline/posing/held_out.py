"""Held-out fixes: evidence of what a fix is worth, from blocks of the training day.

Each block is localised on the map without it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, Seed, check
from pipeline.mapping.gathering import submap_points
from pipeline.matching.holdout import blocks, numbered
from pipeline.matching.ranking import Localizer, Rows
from pipeline.posing.ageing import Ageing
from pipeline.posing.fix import Fix
from pipeline.posing.registration import Points
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import Evidence

PART = 76
"""Queries that a process takes at a time."""


@dataclass(frozen=True)
class Drive:
    """The submaps of a sequence, by the paths of its artifacts."""

    scans: Path
    submaps: Path

    def points_m(self, row: int) -> Points:
        """The points (n, 3) of a submap, in its anchor's frame, z up from the ground."""
        scans = store.read(self.scans, schemas.Scans)
        submaps = store.read(self.submaps, schemas.Submaps)
        return next(iter(submap_points(scans, submaps, slice(row, row + 1))))


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

        The map is that of the other blocks. An aged submap is drawn and ranked anew. Raises
        InputError for a map of another day.
        """
        mapped = Targets.read(day.map_path).world_T_anchor
        anchors = day.views.world_T_anchor
        if not np.array_equal(mapped, anchors):
            submaps = f"{len(mapped)} submaps that are not the {len(anchors)} of the training views"
            raise InputError(f"{day.map_path}: a map of {submaps}; is it of this data set?")
        parts: list[Evidence] = []
        for later_m in np.arange(0.0, self.every_m - self.length_m / 2, self.length_m).tolist():
            if sum(part.blocks for part in parts) < self.enough:
                held = blocks(anchors, day.places, self.every_m, self.length_m, later_m)
                parts.append(self._evidence_of(fixer, day, held, compute, progress))
        return Evidence.joined(parts)

    def _evidence_of(
        self,
        fixer: Fixer,
        day: TrainingDay,
        held: NDArray[np.bool_],
        compute: Compute,
        progress: Progress,
    ) -> Evidence:
        """Fix the submaps that are held out (submap,) at a time."""
        rows = np.flatnonzero(held)
        anchors = day.views.world_T_anchor
        drive = day.drive
        map_path = day.map_path
        view = day.view  # a process gets these, not the model
        parts = [rows[first : first + PART] for first in range(0, len(rows), PART)]
        aged_views = list(
            compute.each(
                lambda part: [view(self._aged(drive.points_m(row), row)) for row in part.tolist()],
                parts,
            )
        )
        driven = day.answers(np.asarray(day.views.images[:])[rows], rows)
        aged = (
            day.answers(np.stack([image for part in aged_views for image in part]), rows)
            if len(rows)
            else []
        )
        answers = dict(zip(rows.tolist(), zip(driven, aged, strict=True), strict=True))
        tasks = [(part, {row: answers[row] for row in part.tolist()}) for part in parts]

        def fixes(part: tuple[NDArray[np.int64], dict[int, tuple[Answers, Answers]]]) -> list[Fix]:
            targets = Targets.read(map_path)
            fixes_of_part: list[Fix] = []
            for row in part[0].tolist():
                as_driven, as_aged = part[1][row]
                points_m = drive.points_m(row)
                fixes_of_part.append(fixer.fix(points_m, targets, as_driven, held))
                fixes_of_part.append(fixer.fix(self._aged(points_m, row), targets, as_aged, held))
                fixes_of_part.append(
                    fixer.fix(points_m, targets, as_driven, held | self._around(anchors, row))
                )
            return fixes_of_part

        finished_parts = progress.track(compute.each(fixes, tasks), len(tasks), "held-out blocks")
        all_fixes = [fix for part in finished_parts for fix in part]
        block = numbered(anchors, held, self.every_m, self.length_m)
        return Evidence(
            all_fixes,
            anchors[rows].repeat(3, axis=0),
            np.tile([False, False, True], len(rows)),
            block.repeat(3),
        )

    def _aged(self, points_m: Points, row: int) -> Points:
        """The points (n, 3) of a row as a later day would see them, always the same ones."""
        return self.ageing.aged(points_m, np.random.default_rng((self.seed, row)))

    def _around(self, world_T_anchor: NDArray[np.float64], row: int) -> NDArray[np.bool_]:
        """The submaps (submap,) around a row, without which it is asked as a place never seen."""
        away_m = np.linalg.norm(world_T_anchor[:, :2, 3] - world_T_anchor[row, :2, 3], axis=1)
        return np.asarray(away_m < self.around_m[row % len(self.around_m)])
