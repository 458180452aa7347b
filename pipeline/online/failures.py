"""Failure cards of a log: pictures of fixes whose verdict is wrong, for `yearloc failures`.

A card shows the scan from above on the map, at the pose of the fix and at the true pose.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pipeline.core.frames import transformed
from pipeline.evaluation.failures import JudgedFix
from pipeline.mapping.from_above import INKS, Footprint, scan_on_map, standing
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix
from pipeline.posing.targets import Targets

SHOWN_M = 45.0
"""How far a card shows the map to each side of the robot."""
NEAREST_SUBMAPS = 2
"""How many submaps of the map are drawn below a scan."""


def of_log(scans: Sequence[Scan], fixes: Sequence[Fix]) -> Iterator[JudgedFix]:
    """The judged fixes of a log; scans without a true pose or without a fix are left out."""
    for scan, fix in zip(scans, fixes, strict=True):
        if np.isfinite(scan.world_T_scan).all() and fix.verdict != "no pose":
            yield JudgedFix(
                scan.name,
                lambda scan=scan: standing(scan.points()),  # type: ignore[misc]
                fix.world_T_sensor,
                scan.world_T_scan,
                fix.verdict == "accepted",
                fix.overlap,
                fix.novelty,
            )


def draw(targets: Targets, fix: JudgedFix, path: Path, heading_end: str) -> None:
    """Write a card as a PNG: the scan on the map at the pose of the fix, and at the true pose.

    `heading_end` is the last line of the card's title.
    """
    figure = Figure((10, 5.9), layout="constrained", dpi=110)
    placed_axes, true_axes = figure.subplots(1, 2)
    panels = ((placed_axes, fix.world_T_found), (true_axes, fix.world_T_true))
    for axes, world_T_scan in panels:
        offsets_m = targets.world_T_anchor[:, :2, 3] - world_T_scan[:2, 3]
        away_m = np.linalg.norm(offsets_m, axis=1)
        nearest = np.argsort(away_m)[:NEAREST_SUBMAPS]
        map_m = [
            transformed(targets.world_T_anchor[row], standing(targets.points_m(row)))
            for row in nearest.tolist()
        ]
        footprint = Footprint.of(np.concatenate(map_m), noise_points=0)  # a map is thinned
        ink = INKS[fix.accepted]
        scan_on_map(axes, footprint, fix.standing_m(), world_T_scan, ink, SHOWN_M)
        axes.set_xlabel(f"{2 * SHOWN_M:g} m across: the map grey, the scan in colour")
    verdict = "accepted" if fix.accepted else "rejected"
    placed_axes.set_title(f"placed: {verdict}, overlap {fix.overlap:.2f}", loc="left")
    true_axes.set_title(f"taken here, {away_m.min():.1f} m from training", loc="left")
    off_m, turn_deg = fix.off
    heading = (
        f"{fix.name}: {fix.kind}; {off_m:.1f} m and {turn_deg:.1f}° off; novelty "
        f"{fix.novelty:.3f}\n{heading_end}"
    )
    figure.suptitle(heading, x=0.01, ha="left", fontsize=11)
    figure.savefig(path)
