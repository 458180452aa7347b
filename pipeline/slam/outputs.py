"""What `yearloc slam` writes: trajectory (TUM), point-cloud map and picture."""

from pathlib import Path

import numpy as np

from pipeline.core.errors import LogError
from pipeline.core.frames import transformed
from pipeline.core.progress import Progress
from pipeline.core.schemas import Estimates
from pipeline.formats import folder
from pipeline.mapping.tiled_map import Thinning, TiledMap
from pipeline.readers.deskew import scan_at_stamp
from pipeline.readers.log import Log

MAP_VOXEL_M = 0.2
"""Side of the map's voxels, each with one point."""
MAP_EVERY_M = 1.0
"""Path from one scan that is added to the map to the next."""
MAP_RANGE_M = 60.0
"""Points of a scan farther away than this are not added to the map."""


def tum_text(estimate: Estimates) -> str:
    """A line for each scan with a pose: stamp in s, x y z in m, the quaternion qx qy qz qw."""
    text = ""
    for row in np.flatnonzero(estimate.posed).tolist():
        stamp_ns = int(estimate.stamps_ns[row])
        text += folder.format_tum_row(stamp_ns, estimate.world_T_scan[row]) + "\n"
    return text


def slam_map(log: Log, estimate: Estimates, watch: Progress) -> TiledMap:
    """The map of a drive's points in its world; unreadable scans are left out.

    Raises InputError if no scan has points.
    """
    # the first scan in each MAP_EVERY_M of path, if it has a pose
    _, first_rows = np.unique(estimate.path_m // MAP_EVERY_M, return_index=True)
    rows = first_rows[estimate.posed[first_rows]].tolist()
    thinning = Thinning(MAP_VOXEL_M)
    for row in watch.track(rows, len(rows), "map"):
        try:
            points_m = scan_at_stamp(log, estimate.odom_T_scan, estimate.breaks, row)
        except LogError:
            continue
        near = points_m[np.linalg.norm(points_m, axis=1) < MAP_RANGE_M]
        thinning.add(transformed(estimate.world_T_scan[row], near))
    return thinning.tiled()


def draw(estimate: Estimates, path: Path, title: str) -> None:
    """Draw the trajectory from above, and save it as a PNG.

    Odometry is grey, the result blue, loops and fixes on a map green, and loops that the result
    overrules orange. Breaks are red, and so is the drive after the last loop, whose drift is
    unbounded.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 8), layout="constrained")
    axes = figure.subplots()
    odom_m = estimate.odom_T_scan[:, :2, 3]
    world_m = estimate.world_T_scan[:, :2, 3]
    is_used = estimate.used
    for part in np.split(np.arange(len(odom_m)), estimate.breaks):
        label = "odometry" if part[0] == 0 else ""
        axes.plot(*odom_m[part].T, color="0.7", linewidth=1, label=label)
    axes.plot(*world_m.T, color="tab:blue", linewidth=1.5, label="result")
    if not len(estimate.fixed):
        last_row = int(estimate.later[is_used].max()) if is_used.any() else 0
        axes.plot(
            *world_m[last_row:].T, color="tab:red", linewidth=1.5, label="after the last loop"
        )
    ends = np.stack([estimate.earlier, estimate.later], axis=1)  # (loop, 2)
    for loops, colour, label in (
        (ends[is_used], "tab:green", "loop"),
        (ends[~is_used], "tab:orange", "overruled"),
    ):
        lines_m = np.insert(world_m[loops], 2, np.nan, axis=1)  # NaN ends a line
        if len(loops):
            axes.plot(*lines_m.reshape(-1, 2).T, "o-", color=colour, markersize=3, label=label)
    if len(estimate.fixed):
        axes.plot(*world_m[estimate.fixed].T, "o", color="tab:green", markersize=3, label="fix")
    if len(estimate.breaks):
        axes.plot(*world_m[estimate.breaks].T, "x", color="tab:red", markersize=8, label="break")
    axes.set_aspect("equal", "datalim")
    axes.set_xlabel("x in m")
    axes.set_ylabel("y in m")
    axes.set_title(title)
    axes.legend(loc="best", frameon=False)
    figure.savefig(path, dpi=120, format="png", metadata={"Software": None})
