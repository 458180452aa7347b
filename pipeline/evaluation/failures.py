"""Fixes whose verdict is wrong: a wrong pose accepted, or a right one rejected.

In: the fixes of a test sequence, or of a log with true poses. Out: those that fail, the surest
verdicts first, of which `yearloc failures` and the report draw cards.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.frames import RIGHT_WITHIN, Poses, distance_and_turn
from pipeline.core.schemas import Fixes
from pipeline.evaluation.numbers import within
from pipeline.mapping.from_above import Drive
from pipeline.perturbations import Case, read_cases


@dataclass(frozen=True)
class JudgedFix:
    """A fix whose true pose is known."""

    name: str
    standing_m: Callable[[], NDArray[np.float64]]
    """Reads the scan's points (n, 3) that stand on the ground."""
    world_T_found: Poses
    """(4, 4) the pose of the fix."""
    world_T_true: Poses
    """(4, 4) the true pose."""
    accepted: bool
    overlap: float
    novelty: float
    right_within: tuple[float, float] = RIGHT_WITHIN
    """A pose is right within these metres and degrees of the true one."""

    @property
    def off(self) -> tuple[float, float]:
        """How far the pose is from the true one, in metres and degrees."""
        away_m, turn_deg = distance_and_turn(self.world_T_found[None], self.world_T_true[None])
        return float(away_m[0]), float(turn_deg[0])

    @property
    def fails(self) -> bool:
        """Whether the verdict is wrong: a wrong pose accepted, or a right one rejected."""
        return bool(within(self.right_within, *np.array(self.off))) != self.accepted

    @property
    def kind(self) -> str:
        """What is wrong with the verdict, in words."""
        return "accepted, and wrong" if self.accepted else "rejected, and right"

    @property
    def file_name(self) -> str:
        """The name of the card's file."""
        letters = "".join(letter if letter.isalnum() else "_" for letter in self.name)
        return f"{'accepted' if self.accepted else 'rejected'}_{letters}.png"


def failures(fixes: Iterable[JudgedFix]) -> list[JudgedFix]:
    """The fixes whose verdict is wrong, the surest verdicts first.

    Accepted fixes come first, from the least novelty to the most; then rejected fixes, from the
    most novelty to the least.
    """
    failed = [fix for fix in fixes if fix.fails]
    accepted = sorted((fix for fix in failed if fix.accepted), key=lambda fix: fix.novelty)
    rejected = sorted((fix for fix in failed if not fix.accepted), key=lambda fix: -fix.novelty)
    return accepted + rejected


def target_precisions(fixes: Fixes) -> dict[float, float]:
    """The target precisions that fixes have thresholds for: precision to threshold of novelty."""
    pose_thresholds = zip(fixes.target_precisions, fixes.pose_thresholds, strict=True)
    return {precision: novelty for precision, novelty in pose_thresholds if novelty > 0}


def reject_from(fixes: Fixes, target_precision: float | None, strict: bool = False) -> float:
    """The threshold of novelty for a target precision; 0 for None, which accepts nothing.

    It is that of the precision that is kept for it (`Fixes.kept_precision`). If `strict`, raises
    ConfigError for a target precision that the fixes have no threshold for.
    """
    if target_precision is None:
        return 0.0
    possible_precisions = target_precisions(fixes)
    if strict and target_precision not in possible_precisions:
        possible = (
            f"they have thresholds for {', '.join(map(str, possible_precisions))}"
            if possible_precisions
            else "they have none at all; --target-precision none draws every pose as rejected"
        )
        raise ConfigError(
            f"--target-precision {target_precision:g}: these poses have no threshold for it; "
            f"{possible}"
        )
    return fixes.reject_from(target_precision)


def unperturbed(fixes: Fixes, count: int) -> slice:
    """The rows of the `count` unperturbed queries; the cases lie one after another."""
    case = read_cases(fixes.cases).index(Case())
    return slice(case * count, (case + 1) * count)


def of_drive(
    fixes: Fixes, drive: Drive, reject_from: float, name: str = "{}"
) -> Iterator[JudgedFix]:
    """The judged fixes of an unperturbed test sequence of a study.

    A fix is accepted if its novelty is below `reject_from`. The number of the query replaces {} in
    `name`.
    """
    rows = unperturbed(fixes, len(drive.world_T_anchor))
    world_T_query = fixes.load("world_T_query")[rows]
    novelty = fixes.load("novelty")[rows, 0].astype(np.float64)
    overlap = fixes.load("overlap")[rows].astype(np.float64)
    for row in np.flatnonzero(np.isfinite(world_T_query).all((1, 2))).tolist():
        yield JudgedFix(
            name.format(row),
            partial(drive.standing_m, row),
            world_T_query[row],
            drive.world_T_anchor[row],
            bool(novelty[row] < reject_from),
            overlap[row],
            novelty[row],
            fixes.right_within,
        )
