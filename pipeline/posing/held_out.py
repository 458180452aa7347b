"""Held-out fixes: what a fix is worth, learned on blocks of the training day that the map is asked about without them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError
from pipeline.matching.holdout import blocks
from pipeline.matching.ranking import Localizer, Rows
from pipeline.posing.fix import Fix, Fixer, poses
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import Evidence, features, right
from pipeline.running.compute import Compute
from pipeline.running.progress import Progress
from pipeline.running.settings import check, positive

PART = 16
"""Queries that a process takes at a time."""


@dataclass(frozen=True)
class HeldOut:
    """Which submaps of the training day are asked, as if they were queries of another day."""

    every_m: float
    """Path from one block to the next."""
    length_m: float
    around_m: float
    """A query is asked a second time without the training submaps that are so near: as a place never seen."""

    def __post_init__(self) -> None:
        check(self, "held_out")
        positive("held_out", every_m=self.every_m, length_m=self.length_m, around_m=self.around_m)
        if not self.length_m < self.every_m:
            raise ConfigError(f"held_out.length_m={self.length_m}: expected less than held_out.every_m={self.every_m}")

    def evidence(
        self, fixer: Fixer, map_path: Path, localizer: Localizer, views: Rows, places: NDArray[np.int64], k: int,
        compute: Compute, progress: Progress,
    ) -> Evidence:  # fmt: skip
        """Fixes of held-out submaps, each with the others' map and without its surroundings.

        `views` and `places` (submap,) are the training day's, a row each as in the map.
        """
        held = blocks(views.world_T_anchor, places, self.every_m, self.length_m)
        rows = np.flatnonzero(held)
        answers_m = localizer(Rows(views.images[:][rows], views.stamps_ns[rows], views.world_T_anchor[rows]), k).xy_m

        def fixes(part: slice) -> list[tuple[Fix, Fix]]:
            targets = Targets(map_path)
            return [self._twice(fixer, targets, held, row, xy_m) for row, xy_m in zip(rows[part], answers_m[part], strict=True)]

        parts = [slice(first, first + PART) for first in range(0, len(rows), PART)]
        found = progress.track(compute.each(fixes, parts), len(parts), "fix held-out blocks")
        pairs = [pair for part in found for pair in part]
        both = [fix for fix, _ in pairs] + [fix for _, fix in pairs]
        return Evidence(features(both), right(poses(both), np.concatenate([views.world_T_anchor[rows]] * 2)))

    def _twice(
        self, fixer: Fixer, targets: Targets, held: NDArray[np.bool_], row: int, answers_m: NDArray[np.float64]
    ) -> tuple[Fix, Fix]:
        """The fixes of one held-out row, whose answers lie at (k, 2)."""
        anchors_m, points_m = targets.world_T_anchor[:, :2, 3], targets.points_m(row)
        near = np.linalg.norm(anchors_m - anchors_m[row], axis=1) < self.around_m
        seen, unseen = (fixer.fix(points_m, targets, targets.nearest(answers_m, out)) for out in (held, held | near))
        return seen, unseen
