"""Failure cards: a picture of each accepted fix that is wrong and each right one that was rejected."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.frames import apart
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix, Site
from pipeline.posing.verdict import RIGHT_DEG, RIGHT_M

WALL_M, SHOWN_M = 0.5, 45.0
"""Points below are ground; around the robot so much is drawn."""
MAP, QUERY = "#9A9A9A", "#B2182B"


@dataclass(frozen=True)
class Failure:
    """A fix that the verdict got wrong."""

    scan: Scan
    fix: Fix
    error_m: float
    error_deg: float

    @property
    def kind(self) -> str:
        return "accepted, and wrong" if self.fix.verdict == "accepted" else "rejected, and right"

    @property
    def name(self) -> str:
        """Of its picture's file, without the suffix."""
        letters = "".join(letter if letter.isalnum() else "_" for letter in self.scan.name)
        return f"{self.fix.verdict}_{letters}"


def failures(scans: Sequence[Scan], fixes: Sequence[Fix]) -> list[Failure]:
    """Those whose verdict is wrong, wrong accepted ones of least novelty first, then rejected right ones of the highest.

    Scans without a true pose are passed over.
    """
    found = []
    for scan, fix in zip(scans, fixes, strict=True):
        if np.isfinite(scan.world_T_scan).all() and fix.verdict != "no pose":
            (error_m,), (error_deg,) = apart(fix.world_T_sensor[None], scan.world_T_scan[None])
            is_right = error_m < RIGHT_M and error_deg < RIGHT_DEG
            if is_right != (fix.verdict == "accepted"):
                found.append(Failure(scan, fix, float(error_m), float(error_deg)))
    return sorted(
        found, key=lambda one: (one.fix.verdict, one.fix.novelty if one.fix.verdict == "accepted" else -one.fix.novelty)
    )


def draw(site: Site, failure: Failure, promise: float, path: Path) -> None:
    """Write a card as a PNG: the scan on the map where it was placed, and where it was taken."""
    points_m = failure.scan.points()
    points_m = points_m[points_m[:, 2] > WALL_M]
    figure = Figure((10, 5.6), layout="constrained", dpi=110)
    placed, true = figure.subplots(1, 2)
    fix = failure.fix
    _from_above(placed, site, points_m, fix.world_T_sensor)
    placed.set_title(f"placed: {fix.verdict}, overlap {fix.overlap:.2f}", loc="left")
    nearest_m = _from_above(true, site, points_m, failure.scan.world_T_scan)
    true.set_title(f"taken here, {nearest_m:.1f} m from training", loc="left")
    novelty = f"novelty {fix.novelty:.3f}, rejected from {site.promises[promise]:.3f} on (promise {promise:g})"
    error = f"{failure.error_m:.1f} m and {failure.error_deg:.1f}° off"
    where = f"{failure.scan.name}{', simulated' if site.about['simulated'] else ''}"
    figure.suptitle(f"{where}: {failure.kind}; {error}; {novelty}", x=0.01, ha="left", fontsize=11)
    figure.savefig(path)


def _from_above(axes: Axes, site: Site, points_m: NDArray[np.float64], world_T_scan: NDArray[np.float64]) -> float:
    """Draw the two submaps nearest a pose and the scan at it; returns how far the nearest is in metres."""
    centre_m = world_T_scan[:2, 3]
    away_m = np.linalg.norm(site.targets.world_T_anchor[:, :2, 3] - centre_m, axis=1)
    for row in np.argsort(away_m)[:2]:
        pose, mapped_m = site.targets.world_T_anchor[row], site.targets.points_m(int(row))
        mapped_m = mapped_m[mapped_m[:, 2] > WALL_M] @ pose[:3, :3].T + pose[:3, 3]
        axes.plot(*mapped_m[:, :2].T, ".", color=MAP, markersize=1.2, zorder=1)
    seen_m = points_m @ world_T_scan[:3, :3].T + world_T_scan[:3, 3]
    axes.plot(*seen_m[::3, :2].T, ".", color=QUERY, markersize=1.0, zorder=2)
    (x, y), (ahead_x, ahead_y) = centre_m.tolist(), (centre_m + 6 * world_T_scan[:2, 0]).tolist()
    axes.annotate("", (ahead_x, ahead_y), (x, y), arrowprops={"arrowstyle": "->", "color": "black", "lw": 2})
    axes.set_xlim(centre_m[0] - SHOWN_M, centre_m[0] + SHOWN_M)
    axes.set_ylim(centre_m[1] - SHOWN_M, centre_m[1] + SHOWN_M)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]: the map grey, the scan red")
    return float(away_m.min())
