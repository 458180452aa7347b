"""Held-out fixes: what a fix is worth, learned on blocks of the training day that the map is asked about without them."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError, InputError
from pipeline.matching.holdout import blocks
from pipeline.matching.ranking import Localizer, Rows
from pipeline.posing.fix import Fix, Fixer, poses
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import Evidence, features, right
from pipeline.running.compute import Compute
from pipeline.running.progress import Progress
from pipeline.running.settings import Positive, check

CLEAR = 0.01
"""A hypothesis is clear if so few of the wrong ones have less spread."""
PART = 16
"""Queries that a process takes at a time."""


@dataclass(frozen=True)
class HeldOut:
    """Which submaps of the training day are asked, as if they were queries of another day."""

    every_m: Positive
    """Path from one block to the next."""
    length_m: Positive
    around_m: Positive
    """A query is asked a second time without the training submaps that are so near: as a place never seen."""

    def __post_init__(self) -> None:
        check(self, "held_out")
        if not self.length_m < self.every_m:
            raise ConfigError(f"held_out.length_m={self.length_m}: expected less than held_out.every_m={self.every_m}")

    def evidence(
        self, fixer: Fixer, map_path: Path, localizer: Localizer, views: Rows, places: NDArray[np.int64], k: int,
        compute: Compute, progress: Progress,
    ) -> tuple[Evidence, float]:  # fmt: skip
        """Fixes of held-out submaps, each with the others' map and without its surroundings; and below which spread in metres
        a hypothesis is clear.

        `views` and `places` (submap,) are the training day's, a row each as in the map; raises InputError for a map of others.
        """
        mapped = Targets.read(map_path).world_T_anchor
        if not np.array_equal(mapped, views.world_T_anchor):
            submaps = f"{len(mapped)} submaps that are not the {len(views.world_T_anchor)} of the training views"
            raise InputError(f"{map_path}: a map of {submaps}; is it of this data set?")
        held = blocks(views.world_T_anchor, places, self.every_m, self.length_m)
        rows = np.flatnonzero(held)
        answers_m = localizer(Rows(views.images[:][rows], views.stamps_ns[rows], views.world_T_anchor[rows]), k).xy_m
        anchors_m, parts = views.world_T_anchor[:, :2, 3], [slice(first, first + PART) for first in range(0, len(rows), PART)]

        def asked(fixer: Fixer, around_m: float) -> list[Fix]:
            def fixes(part: slice) -> list[Fix]:
                targets, found = Targets.read(map_path), []
                for row, xy_m in zip(rows[part], answers_m[part], strict=True):
                    near = np.linalg.norm(anchors_m - anchors_m[row], axis=1) < around_m
                    found.append(fixer.fix(targets.points_m(row), targets, xy_m, held | near))
                return found

            done = progress.track(compute.each(fixes, parts), len(parts), f"held-out blocks without {around_m:g} m around")
            return [fix for part in done for fix in part]

        unseen = asked(fixer, self.around_m)
        wrong_m = [one.alignment.spread_m for fix in unseen for one in fix.hypotheses]
        clear_m = float(np.quantile(wrong_m, CLEAR)) if wrong_m else 0.0
        both = asked(replace(fixer, clear_m=clear_m), 0.0) + unseen
        return Evidence(features(both), right(poses(both), np.concatenate([views.world_T_anchor[rows]] * 2))), clear_m
