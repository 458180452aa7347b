"""Cuts a sequence into submaps: the poses and points of its scans in, a submaps artifact out.

For each submap the artifact says which scans it gathers, and how high the ground is. The newest of
these scans is the anchor, whose frame is the submap's frame. A submap is either one scan
(`SingleScan`) or all scans of the last metres of path (`Accumulated`).
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.frames import Poses, step_lengths_m, travelled_m
from pipeline.core.progress import Progress
from pipeline.core.schemas import PoseColumn, Scans, Submaps
from pipeline.core.settings import NotNegative, Positive, checked
from pipeline.mapping.appearance import measure_appearance
from pipeline.mapping.gathering import Gathering

ROUNDING_M = 1e-9
"""Sums of path lengths that differ by less than this are equal."""


@dataclass(frozen=True)
@checked("submap")
class SingleScan:
    """Makes a submap of one scan every `step_m` of path, or of every scan if that is 0.

    The reader has put the ground at z = 0 already.
    """

    step_m: NotNegative = 1.0

    def cut(self, scans: Scans, progress: Progress) -> Submaps:
        """Cut a sequence's scans into submaps."""
        rows = self.anchors(scans.world_T_scan)
        used = np.ones(len(scans.world_T_scan), bool)
        ground_m = np.zeros(len(rows))
        return submaps(scans, "world_T_scan", rows, rows, ground_m, used, left_out={})

    def anchors(self, world_T_scan: Poses) -> NDArray[np.int64]:
        """Rows of the scans that become submaps."""
        if self.step_m > 0:
            return sample_path(world_T_scan[:, :3, 3], self.step_m)
        return np.arange(len(world_T_scan))


@dataclass(frozen=True)
@checked("submap")
class Accumulated:
    """Makes submaps of all scans or 2-D sweeps of the last `window_m` of path (METHODS 2.9)."""

    step_m: float = 1.0
    """Path between two submaps."""
    window_m: Positive = 80.0
    """Length of the path, back from its anchor, whose scans a submap gathers."""
    layout: PoseColumn = "odom_T_scan"
    """The poses by which scans are placed and the path is measured: odometry or ground truth."""
    still_m: Positive = 0.01
    """A scan is left out if the path since the last used scan is shorter than this: minutes at a
    red light show nothing new."""
    ground_percentile: float = 5.0
    """The ground is at this percentile of the heights near the anchor; −1 if the reader has put it
    at z = 0 already."""
    ground_radius_m: Positive = 10.0
    """Distance from the anchor within which heights count for the ground."""

    def __post_init__(self) -> None:
        if not self.step_m >= self.still_m:
            raise ConfigError(
                f"submap.step_m={self.step_m}: expected at least still_m={self.still_m}"
            )
        if self.ground_percentile != -1 and not 0 <= self.ground_percentile <= 100:
            raise ConfigError(
                f"submap.ground_percentile={self.ground_percentile}: expected 0 to 100, or -1"
            )

    def cut(self, scans: Scans, progress: Progress) -> Submaps:
        """Cut a sequence's scans into submaps.

        An anchor without a true pose, a whole window or points near it makes no submap; such
        anchors are counted by the reason.
        """
        start_T_scan = scans.load(self.layout)
        first, rows, left_out = self.windows(start_T_scan, scans.world_T_scan)
        used = np.zeros(len(start_T_scan), bool)
        used[sample_path(start_T_scan[:, :3, 3], self.still_m)] = True
        used[first] = used[rows] = True  # the ends of windows, however near to other scans
        ground_m = np.zeros(len(rows))
        if self.ground_percentile >= 0 and len(rows):
            gathering = Gathering(scans, self.layout, first, rows, ground_m, used)
            tracked = progress.track(gathering, len(rows), "find the ground")
            ground_m = np.array([self._ground_m(points) for points in tracked])
            left_out["no point near the anchor"] = int(np.isnan(ground_m).sum())
        has_ground = np.isfinite(ground_m)
        return submaps(
            scans,
            self.layout,
            first[has_ground],
            rows[has_ground],
            ground_m[has_ground],
            used,
            left_out=dict(+left_out),  # without zero counts
        )

    def windows(
        self, start_T_scan: Poses, world_T_scan: Poses
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Counter[str]]:
        """Return the first and the last scan (submap,) of each window, and what was left out.

        The last result is the number of anchors without a window, by reason. `start_T_scan` (scan,
        4, 4) are the poses that place the scans; a row with a NaN is a break, which no window
        spans.
        """
        # 1. Sample anchors along the path.
        xyz_m = start_T_scan[:, :3, 3]
        rows = sample_path(xyz_m, self.step_m)
        has_pose = np.isfinite(xyz_m).all(axis=1)
        breaks = np.cumsum(~has_pose)
        path_m = travelled_m(xyz_m)

        # 2. A window begins `window_m` before its anchor, if that is behind the last break.
        # The first scan with an anchor's count of breaks is the last break itself, if there is one.
        first_after_break = np.searchsorted(breaks, breaks[rows]) + (breaks[rows] > 0)
        start_m = path_m[rows] - self.window_m
        is_whole = path_m[first_after_break] <= start_m + ROUNDING_M

        # 3. Leave out anchors without a whole window or a true pose.
        has_true_pose = np.isfinite(world_T_scan[rows]).all(axis=(1, 2))
        left_out = Counter(
            {
                "window not yet whole": int((~is_whole).sum()),
                "no true pose": int((is_whole & ~has_true_pose).sum()),
            }
        )
        first = np.maximum(np.searchsorted(path_m, start_m - ROUNDING_M), first_after_break)
        has_window = is_whole & has_true_pose
        return first[has_window], rows[has_window], left_out

    def _ground_m(self, points_m: NDArray[np.float64]) -> float:
        """Height of the ground under a submap's points (n, 3); NaN if none is near the anchor."""
        is_near = np.hypot(points_m[:, 0], points_m[:, 1]) < self.ground_radius_m
        if not is_near.any():
            return np.nan
        return float(np.percentile(points_m[is_near, 2], self.ground_percentile))


def submaps(
    scans: Scans,
    layout: PoseColumn,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    ground_m: NDArray[np.float64],
    used: NDArray[np.bool_],
    left_out: Mapping[str, int],
) -> Submaps:
    """Make the artifact of submaps that gather the scans from `first` to `last` (submap,).

    Only scans that are `used` (scan,) are gathered. `ground_m` (submap,) is the height of the
    ground in the last scan's frame, and `left_out` the number of anchors without a submap, by
    reason. What the submaps look like is measured and added (`mapping.appearance`).
    """
    appearance_measures = measure_appearance(scans, layout, first, last, ground_m, used)
    return Submaps(
        first,
        last,
        ground_m,
        used,
        scans.stamps_ns[last],
        scans.world_T_scan[last],
        layout,
        left_out,
        appearance_measures,
    )


def sample_path(xyz_m: NDArray[np.float64], step_m: float) -> NDArray[np.int64]:
    """Sample positions (n, 3) along the path, one about every `step_m`; returns their rows (m,).

    The 3-D steps from row to row are summed up; when the sum reaches `step_m`, a sample is taken
    and the sum starts again at zero (METHODS 2.2). Rows with a NaN are never taken, and the steps
    to and from them do not count.
    """
    steps_m = step_lengths_m(xyz_m)
    steps_m[~np.isfinite(steps_m)] = 0.0
    has_position: NDArray[np.bool_] = np.all(np.isfinite(xyz_m), axis=1)
    rows = []
    since_sample_m = 0.0
    for row, moved_m in enumerate(steps_m.tolist(), start=1):
        since_sample_m += moved_m
        if since_sample_m >= step_m and has_position[row]:
            rows.append(row)
            since_sample_m = 0.0
    return np.array(rows, np.int64)
