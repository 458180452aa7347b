"""Held-out fixes: what a fix is worth, learned on blocks of the training day that the map is asked about without them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError
from pipeline.matching.holdout import blocks
from pipeline.matching.ranking import Localizer, Rows
from pipeline.posing.answers import Signs, poses
from pipeline.posing.fix import Fix, Fixer
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import Evidence, right
from pipeline.running.progress import Progress
from pipeline.running.settings import check, positive


@dataclass(frozen=True)
class HeldOut:
    """Which submaps of the training day are asked, as if they were queries of another day."""

    every_m: float = 40.0
    """Path from one block to the next."""
    length_m: float = 4.0
    around_m: float = 20.0
    """A query is asked a second time without the training submaps that are so near: as a place never seen."""

    def __post_init__(self) -> None:
        check(self, "held_out")
        positive("held_out", every_m=self.every_m, length_m=self.length_m, around_m=self.around_m)
        if not self.length_m < self.every_m:
            raise ConfigError(f"held_out.length_m={self.length_m}: expected less than held_out.every_m={self.every_m}")

    def evidence(
        self,
        fixer: Fixer,
        targets: Targets,
        localizer: Localizer,
        views: Rows,
        places: NDArray[np.int64],
        k: int,
        progress: Progress,
    ) -> Evidence:
        """Fixes of held-out submaps, each with the others' map and without its surroundings.

        `views` and `places` (submap,) are the training day's, a row each as in `targets`.
        """
        held = blocks(targets.world_T_anchor, places, self.every_m, self.length_m)
        rows = np.flatnonzero(held)
        ranking = localizer(Rows(views.images[:][rows], views.stamps_ns[rows], views.world_T_anchor[rows]), k)
        asked = list(self._asked(fixer, targets, held, ranking.xy_m, progress))
        true = np.concatenate([targets.world_T_anchor[rows]] * 2)
        fixes = [fix for fix, _ in asked] + [fix for _, fix in asked]
        signs = [Signs.of(some, fixer.apart_m, ranking) for some in (fixes[: len(rows)], fixes[len(rows) :])]
        return Evidence(np.concatenate([one.features() for one in signs]), right(poses(fixes), true), len(rows))

    def _asked(
        self, fixer: Fixer, targets: Targets, held: NDArray[np.bool_], xy_m: NDArray[np.float64], progress: Progress
    ) -> Iterator[tuple[Fix, Fix]]:
        """The two fixes of each held-out row, whose answers lie at `xy_m` (row, k, 2)."""
        anchors_m = targets.world_T_anchor[:, :2, 3]
        for row, answers_m in progress.track(zip(np.flatnonzero(held), xy_m, strict=True), len(xy_m), "fix held-out blocks"):
            near = np.linalg.norm(anchors_m - anchors_m[row], axis=1) < self.around_m
            points_m = targets.points_m(int(row))
            yield tuple(  # type: ignore[misc]
                fixer.fix(points_m, targets, targets.nearest(answers_m, left_out)) for left_out in (held, held | near)
            )
