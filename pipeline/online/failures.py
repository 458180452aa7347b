"""Failure cards: a picture of each fix whose verdict is wrong, for `yearloc failures`.

A verdict is wrong if it accepts a wrong pose or rejects a right one. The fixes are those of a log
with true poses, or of a study. A card shows the scan from above on the map, where the fix placed it
and where it was taken.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.alterations import Case, read_cases
from pipeline.core import schemas, store
from pipeline.core.errors import ConfigError
from pipeline.core.frames import RIGHT_WITHIN, Poses, distance_and_turn, moved
from pipeline.mapping.gathering import submap_points
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix
from pipeline.posing.registration import Points
from pipeline.posing.targets import Targets

WALL_M = 0.5
"""Points below this are ground, and are not drawn."""
SHOWN_M = 45.0
"""A card shows so much to each side of the robot."""
MAP_GREY = "#9A9A9A"
SCAN_RED = "#B2182B"


@dataclass(frozen=True)
class JudgedFix:
    """A fix whose true pose is known."""

    name: str
    points_m: Callable[[], Points]
    """Reads the scan's points (n, 3)."""
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
        away_m, turn_deg = self.off
        right_m, right_deg = self.right_within
        is_right = away_m < right_m and turn_deg < right_deg
        return is_right != self.accepted

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
    """The fixes whose verdict is wrong, the worst first.

    Accepted ones come first, those of the least novelty before others; then rejected ones, those of
    the most novelty before others.
    """
    failed = [fix for fix in fixes if fix.fails]
    accepted = sorted((fix for fix in failed if fix.accepted), key=lambda fix: fix.novelty)
    rejected = sorted((fix for fix in failed if not fix.accepted), key=lambda fix: -fix.novelty)
    return accepted + rejected


def of_log(scans: Sequence[Scan], fixes: Sequence[Fix]) -> Iterator[JudgedFix]:
    """The judged fixes of a log; scans without a true pose or without a fix are left out."""
    for scan, fix in zip(scans, fixes, strict=True):
        if np.isfinite(scan.world_T_scan).all() and fix.verdict != "no pose":
            accepted = fix.verdict == "accepted"
            yield JudgedFix(
                scan.name,
                scan.points,
                fix.world_T_sensor,
                scan.world_T_scan,
                accepted,
                fix.overlap,
                fix.novelty,
            )


def of_study(fixes: Path, scans: Path, submaps: Path, promise: float | None) -> Iterator[JudgedFix]:
    """The judged fixes of a test sequence as it was driven, from its artifacts.

    A fix is accepted if it keeps `promise`; None accepts nothing. Raises ConfigError for a promise
    that the fixes cannot make.
    """
    answers = store.read(fixes, schemas.Fixes)
    anchors = store.read(submaps, schemas.Submaps)
    limits = zip(answers.promises, answers.promised, strict=True)
    promises = {precision: reject_from for precision, reject_from in limits if reject_from > 0}
    if promise is not None and promise not in promises:
        possible = (
            f"they can {' and '.join(map(str, promises))}"
            if promises
            else "nor any other; --promise none draws them"
        )
        raise ConfigError(f"--promise {promise:g}: these poses cannot promise that, {possible}")
    world_T_true = anchors.load("world_T_anchor")
    recorded = store.read(scans, schemas.Scans)
    # the queries as driven are one of the cases, which lie one after the other
    unaltered_case = read_cases(answers.cases).index(Case())
    count = len(world_T_true)
    case_rows = slice(unaltered_case * count, (unaltered_case + 1) * count)
    world_T_query = answers.load("world_T_query")[case_rows]
    pose_novelty = answers.load("novelty")[case_rows, 0].astype(np.float64)
    reject_from = 0.0 if promise is None else promises[promise]
    overlap = answers.load("overlap")[case_rows].astype(np.float64)
    for row in np.flatnonzero(np.isfinite(world_T_query).all((1, 2))).tolist():
        yield JudgedFix(
            f"{fixes.stem} query {row}",
            partial(_points, recorded, anchors, row),
            world_T_query[row],
            world_T_true[row],
            pose_novelty[row] < reject_from,
            overlap[row],
            pose_novelty[row],
            answers.right_within,
        )


def _points(scans: schemas.Scans, submaps: schemas.Submaps, row: int) -> Points:
    """The points (n, 3) of one submap, in its anchor's frame."""
    return next(iter(submap_points(scans, submaps, slice(row, row + 1))))


def draw(targets: Targets, fix: JudgedFix, path: Path, heading_end: str) -> None:
    """Write a card as a PNG: the scan on the map where it was placed, and where it was taken.

    `heading_end` is the last part of the card's title.
    """
    points_m = fix.points_m()
    points_m = points_m[points_m[:, 2] > WALL_M]
    figure = Figure((10, 5.6), layout="constrained", dpi=110)
    placed_axes, true_axes = figure.subplots(1, 2)
    _from_above(placed_axes, targets, points_m, fix.world_T_found)
    placed_axes.set_title(
        f"placed: {'accepted' if fix.accepted else 'rejected'}, overlap {fix.overlap:.2f}",
        loc="left",
    )
    nearest_m = _from_above(true_axes, targets, points_m, fix.world_T_true)
    true_axes.set_title(f"taken here, {nearest_m:.1f} m from training", loc="left")
    away_m, turn_deg = fix.off
    heading = (
        f"{fix.name}: {fix.kind}; {away_m:.1f} m and {turn_deg:.1f}° off; novelty "
        f"{fix.novelty:.3f}, {heading_end}"
    )
    figure.suptitle(heading, x=0.01, ha="left", fontsize=11)
    figure.savefig(path)


def _from_above(
    axes: Axes, targets: Targets, points_m: NDArray[np.float64], world_T_scan: NDArray[np.float64]
) -> float:
    """Draw a scan's points (n, 3) at a pose (4, 4), over the two submaps nearest to it.

    Returns the distance to the nearest submap in metres.
    """
    centre_m = world_T_scan[:2, 3]
    away_m = np.linalg.norm(targets.world_T_anchor[:, :2, 3] - centre_m, axis=1)
    for row in np.argsort(away_m)[:2]:
        pose = targets.world_T_anchor[row]
        mapped_m = targets.points_m(int(row))
        mapped_m = moved(pose, mapped_m[mapped_m[:, 2] > WALL_M])
        axes.plot(*mapped_m[:, :2].T, ".", color=MAP_GREY, markersize=1.2, zorder=1)
    seen_m = moved(world_T_scan, points_m)
    # every third point, which shows as much
    axes.plot(*seen_m[::3, :2].T, ".", color=SCAN_RED, markersize=1.0, zorder=2)
    # an arrow of 6 m from the robot ahead, along its x axis
    x_m, y_m = centre_m.tolist()
    ahead_x_m, ahead_y_m = (centre_m + 6 * world_T_scan[:2, 0]).tolist()
    arrow = {"arrowstyle": "->", "color": "black", "lw": 2}
    axes.annotate("", (ahead_x_m, ahead_y_m), (x_m, y_m), arrowprops=arrow)
    axes.set_xlim(centre_m[0] - SHOWN_M, centre_m[0] + SHOWN_M)
    axes.set_ylim(centre_m[1] - SHOWN_M, centre_m[1] + SHOWN_M)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]: the map grey, the scan red")
    return float(away_m.min())
