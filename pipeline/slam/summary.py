"""Summarises estimated poses in a few lines of text, which `yearloc slam` prints."""

import numpy as np

from pipeline.core.frames import step_lengths_m
from pipeline.core.schemas import Estimates

MOST_LINES = 5
"""Largest number of breaks that get a line each."""


def lines(estimate: Estimates) -> list[str]:
    """Lines on the number of scans with a pose, the breaks of odometry, and its drift."""
    count = len(estimate.stamps_ns)
    path_m = float(estimate.path_m[-1])
    summary = [
        f"{int(estimate.posed.sum()):,} of {count:,} scans have a pose, {path_m:,.0f} m of path"
    ]
    summary += [f"{number:,} without: {reason}" for reason, number in estimate.skipped.items()]
    summary += [_break_line(estimate, row) for row in estimate.breaks[:MOST_LINES].tolist()]
    if len(estimate.breaks) > MOST_LINES:
        summary.append(f"{len(estimate.breaks) - MOST_LINES} more breaks")
    if estimate.by_log.any():
        summary.append(
            f"{int(estimate.by_log.sum()):,} steps are the log's own odometry: neighbouring scans "
            "show too little of the same there"
        )
    summary.append(_fixed_line(estimate) if len(estimate.fixed) else _drift_line(estimate))
    return summary


def _break_line(estimate: Estimates, row: int) -> str:
    """A line on a break: the overlap of scan `row` with the scan before, and the time between."""
    usual_overlap = float(np.nanmedian(estimate.overlap))
    seconds = (estimate.stamps_ns[row] - estimate.stamps_ns[row - 1]) / 1e9
    return (
        f"no overlap at scan {row}: {estimate.overlap[row]:.2f} with the scan before, usually "
        f"{usual_overlap:.2f}; {seconds:.3g} s lie between them, usually {_spacing(estimate)}: a "
        "jump, a gap, or scans too far apart"
    )


def _spacing(estimate: Estimates) -> str:
    """The median time and distance between neighbouring scans."""
    step_s = float(np.median(np.diff(estimate.stamps_ns))) / 1e9
    steps_m = step_lengths_m(estimate.odom_T_scan[:, :3, 3])
    return f"{step_s:.3g} s and {np.nanmedian(steps_m):.3g} m"


def _fixed_line(estimate: Estimates) -> str:
    """A line on how many scans were located on a map, and how far along the path others are."""
    between_m = np.abs(estimate.path_m[:, None] - estimate.path_m[estimate.fixed])
    farthest_m = float(between_m[estimate.posed].min(axis=1).max())
    return (
        f"{len(estimate.fixed)} scans were found on the map; the farthest scan is "
        f"{farthest_m:,.0f} m of path from one of these"
    )


def _drift_line(estimate: Estimates) -> str:
    """A line on how well the loops agree, and how far the drive goes on after the last loop."""
    is_used = estimate.used
    path_m = estimate.path_m
    if not is_used.any():
        return (
            f"no loop: the drive comes back to no place, so its drift over {path_m[-1]:,.0f} m is "
            "unknown"
        )
    after_m = float(path_m[-1] - path_m[estimate.later[is_used].max()])
    residual_m = estimate.residual_m[is_used]
    return (
        f"{int(is_used.sum())} loops, {int((~is_used).sum())} overruled; they agree within "
        f"{np.median(residual_m):.2f} m in the median, {residual_m.max():.2f} m at most; after the "
        f"last one the drive goes on for {after_m:,.0f} m"
    )
