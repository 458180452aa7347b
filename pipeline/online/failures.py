"""Failure cards: a picture of each accepted fix that is wrong and each right one that was
rejected."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline import schemas, store
from pipeline.alterations import Case, read_cases
from pipeline.errors import ConfigError
from pipeline.frames import Poses, apart
from pipeline.mapping.gathering import submap_points
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix
from pipeline.posing.registration import Points
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import RIGHT_DEG, RIGHT_M
from pipeline.store import Artifact

WALL_M = 0.5
SHOWN_M = 45.0
"""Points below are ground; around the robot so much is drawn."""
MAP = "#9A9A9A"
QUERY = "#B2182B"


@dataclass(frozen=True)
class Judged:
    """A fix whose truth is known."""

    name: str
    points_m: Callable[[], Points]
    """Reads the scan's points (n, 3)."""
    world_T_found: Poses
    world_T_true: Poses
    accepted: bool
    overlap: float
    novelty: float

    @property
    def off(self) -> tuple[float, float]:
        """Metres and degrees from the true pose."""
        away_m, turn_deg = apart(self.world_T_found[None], self.world_T_true[None])
        return float(away_m[0]), float(turn_deg[0])

    @property
    def fails(self) -> bool:
        """Whether the verdict is wrong."""
        away_m, turn_deg = self.off
        return (away_m < RIGHT_M and turn_deg < RIGHT_DEG) != self.accepted

    @property
    def kind(self) -> str:
        return "accepted, and wrong" if self.accepted else "rejected, and right"

    @property
    def file_name(self) -> str:
        letters = "".join(letter if letter.isalnum() else "_" for letter in self.name)
        return f"{'accepted' if self.accepted else 'rejected'}_{letters}.png"


def failures(judged: Iterable[Judged]) -> list[Judged]:
    """Those whose verdict is wrong: accepted ones of least novelty first, then rejected ones of the
    highest."""
    return sorted(
        (one for one in judged if one.fails),
        key=lambda one: (not one.accepted, one.novelty * (1 if one.accepted else -1)),
    )


def of_log(scans: Sequence[Scan], fixes: Sequence[Fix]) -> Iterator[Judged]:
    """The fixes of a log; scans without a true pose and fixes without any are passed over."""
    for scan, fix in zip(scans, fixes, strict=True):
        if np.isfinite(scan.world_T_scan).all() and fix.verdict != "no pose":
            accepted = fix.verdict == "accepted"
            yield Judged(
                scan.name,
                scan.points,
                fix.world_T_sensor,
                scan.world_T_scan,
                accepted,
                fix.overlap,
                fix.novelty,
            )


def of_study(fixes: Path, scans: Path, submaps: Path, promise: float | None) -> Iterator[Judged]:
    """The fixes of a test sequence as it was driven, from its artifacts; raises ConfigError for a
    promise that they cannot make. None accepts nothing."""
    found = store.read(fixes, schemas.FIXES)
    anchors = store.read(submaps, schemas.SUBMAPS)
    limits = zip(found.attrs["promises"], found.attrs["promised"], strict=True)
    kept = {one: reject_from for one, reject_from in limits if reject_from > 0}
    if promise is not None and promise not in kept:
        can = (
            f"they can {' and '.join(map(str, kept))}"
            if kept
            else "nor any other; --promise none draws them"
        )
        raise ConfigError(f"--promise {promise:g}: these poses cannot promise that, {can}")
    world_T_true = anchors.load("world_T_anchor")
    recorded = store.read(scans, schemas.SCANS)
    driven = read_cases(found.attrs).index(Case())
    own = slice(driven * len(world_T_true), (driven + 1) * len(world_T_true))
    world_T_query = found.load("world_T_query")[own]
    novelty = found.load("novelty")[own].astype(np.float64)
    reject_from = 0.0 if promise is None else kept[promise]
    overlap = found.load("overlap")[own].astype(np.float64)
    for row in np.flatnonzero(np.isfinite(world_T_query).all((1, 2))).tolist():
        known = (
            world_T_query[row],
            world_T_true[row],
            novelty[row, 0] < reject_from,
            overlap[row],
            novelty[row, 0],
        )
        yield Judged(f"{fixes.stem} query {row}", partial(_points, recorded, anchors, row), *known)


def _points(scans: Artifact, submaps: Artifact, row: int) -> Points:
    """The points (n, 3) of one submap, in its anchor's frame."""
    return next(iter(submap_points(scans, submaps, slice(row, row + 1))))


def draw(targets: Targets, one: Judged, path: Path, told: str) -> None:
    """Write a card as a PNG: the scan on the map where it was placed, and where it was taken;
    `told` ends its heading."""
    points_m = one.points_m()
    points_m = points_m[points_m[:, 2] > WALL_M]
    figure = Figure((10, 5.6), layout="constrained", dpi=110)
    placed, true = figure.subplots(1, 2)
    _from_above(placed, targets, points_m, one.world_T_found)
    placed.set_title(
        f"placed: {'accepted' if one.accepted else 'rejected'}, overlap {one.overlap:.2f}",
        loc="left",
    )
    nearest_m = _from_above(true, targets, points_m, one.world_T_true)
    true.set_title(f"taken here, {nearest_m:.1f} m from training", loc="left")
    away_m, turn_deg = one.off
    heading = (
        f"{one.name}: {one.kind}; {away_m:.1f} m and {turn_deg:.1f}° off; novelty "
        f"{one.novelty:.3f}, {told}"
    )
    figure.suptitle(heading, x=0.01, ha="left", fontsize=11)
    figure.savefig(path)


def _from_above(
    axes: Axes, targets: Targets, points_m: NDArray[np.float64], world_T_scan: NDArray[np.float64]
) -> float:
    """Draw the two submaps nearest a pose and the scan at it; returns how far the nearest is in
    metres."""
    centre_m = world_T_scan[:2, 3]
    away_m = np.linalg.norm(targets.world_T_anchor[:, :2, 3] - centre_m, axis=1)
    for row in np.argsort(away_m)[:2]:
        pose = targets.world_T_anchor[row]
        mapped_m = targets.points_m(int(row))
        mapped_m = mapped_m[mapped_m[:, 2] > WALL_M] @ pose[:3, :3].T + pose[:3, 3]
        axes.plot(*mapped_m[:, :2].T, ".", color=MAP, markersize=1.2, zorder=1)
    seen_m = points_m @ world_T_scan[:3, :3].T + world_T_scan[:3, 3]
    axes.plot(*seen_m[::3, :2].T, ".", color=QUERY, markersize=1.0, zorder=2)
    (x, y) = centre_m.tolist()
    (ahead_x, ahead_y) = (centre_m + 6 * world_T_scan[:2, 0]).tolist()
    axes.annotate(
        "", (ahead_x, ahead_y), (x, y), arrowprops={"arrowstyle": "->", "color": "black", "lw": 2}
    )
    axes.set_xlim(centre_m[0] - SHOWN_M, centre_m[0] + SHOWN_M)
    axes.set_ylim(centre_m[1] - SHOWN_M, centre_m[1] + SHOWN_M)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]: the map grey, the scan red")
    return float(away_m.min())
