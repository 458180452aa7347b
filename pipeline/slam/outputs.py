"""What is written of an estimated drive: a TUM trajectory, a map of points, a picture."""

from pathlib import Path

import numpy as np
import small_gicp

from pipeline.core.errors import LogError
from pipeline.core.progress import Progress
from pipeline.core.schemas import Estimates
from pipeline.formats import folder, pcd
from pipeline.posing.registration import Points, moved
from pipeline.readers.deskew import scan_at_stamp
from pipeline.readers.log import Log

MAP_VOXEL_M = 0.2
MAP_EVERY_M = 1.0
MAP_RANGE_M = 60.0
GATHERED = 50
"""Scans that are gathered before their points are thinned."""


def tum_text(estimate: Estimates) -> str:
    """A line for each scan with a pose: stamp x y z qx qy qz qw, in s and m."""
    return "".join(
        folder.tum_row(int(estimate.stamps_ns[row]), estimate.world_T_scan[row]) + "\n"
        for row in np.flatnonzero(estimate.posed).tolist()
    )


def map_pcd(log: Log, estimate: Estimates, watch: Progress) -> bytes:
    """A PCD of the points of a drive in its world, one a voxel of MAP_VOXEL_M."""
    rows = [
        row
        for row in np.unique(estimate.path_m // MAP_EVERY_M, return_index=True)[1].tolist()
        if estimate.posed[row]
    ]
    whole = np.empty((0, 3))
    gathered: list[Points] = []
    for number, row in enumerate(watch.track(rows, len(rows), "map"), start=1):
        try:
            points_m = scan_at_stamp(log, estimate.odom_T_scan, estimate.breaks, row)
        except LogError:
            continue
        near = points_m[np.linalg.norm(points_m, axis=1) < MAP_RANGE_M]
        gathered.append(moved(estimate.world_T_scan[row], near))
        if number % GATHERED == 0 or number == len(rows):
            thin = small_gicp.voxelgrid_sampling(np.concatenate([whole, *gathered]), MAP_VOXEL_M)
            whole = np.asarray(thin.points())[:, :3]
            gathered = []
    return pcd.encode(whole)


def draw(estimate: Estimates, path: Path, title: str) -> None:
    """Draw the trajectory from above.

    Odometry grey, the result blue, loops green, overruled ones orange; breaks and what comes after
    the last loop red, for nothing bounds its drift.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 8), layout="constrained")
    axes = figure.subplots()
    odom_m = estimate.odom_T_scan[:, :2, 3]
    world_m = estimate.world_T_scan[:, :2, 3]
    used = estimate.used
    for part in np.split(np.arange(len(odom_m)), estimate.breaks):
        axes.plot(*odom_m[part].T, color="0.7", linewidth=1, label="" if part[0] else "odometry")
    axes.plot(*world_m.T, color="tab:blue", linewidth=1.5, label="result")
    last = int(estimate.later[used].max()) if used.any() else 0
    if not len(estimate.fixed):
        axes.plot(*world_m[last:].T, color="tab:red", linewidth=1.5, label="after the last loop")
    for is_used, colour, name in ((True, "tab:green", "loop"), (False, "tab:orange", "overruled")):
        for number, loop in enumerate(np.flatnonzero(used == is_used).tolist()):
            ends_m = world_m[[estimate.earlier[loop], estimate.later[loop]]]
            axes.plot(*ends_m.T, color=colour, marker="o", markersize=3, label=name * (number == 0))
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
