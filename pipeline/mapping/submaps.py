"""Submaps: which scans make one, around which pose, and how high the ground lies there."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError
from pipeline.core.frames import Poses
from pipeline.core.progress import Progress
from pipeline.core.schemas import PoseColumn, Scans, Submaps
from pipeline.core.settings import NotNegative, Positive, check
from pipeline.mapping.appearance import appearance
from pipeline.mapping.gathering import Gathering


@dataclass(frozen=True)
class SingleScan:
    """One scan a submap, one submap every `step_m` of path; the reader has put the ground at 0."""

    step_m: NotNegative = 1.0

    def __post_init__(self) -> None:
        check(self, "submap")

    def cut(self, scans: Scans, progress: Progress) -> Submaps:
        """The submaps of a sequence's scans."""
        rows = self.anchors(scans.world_T_scan)
        used = np.ones(len(scans.world_T_scan), bool)
        return submaps(scans, "world_T_scan", rows, rows, np.zeros(len(rows)), used, {})

    def anchors(self, world_T_scan: Poses) -> NDArray[np.int64]:
        """Rows of the scans that become submaps."""
        return (
            sample_path(world_T_scan[:, :3, 3], self.step_m)
            if self.step_m > 0
            else np.arange(len(world_T_scan))
        )


@dataclass(frozen=True)
class Accumulated:
    """All scans or 2-D sweeps of the last `window_m` of path, in the newest one's frame.

    METHODS 2.9.
    """

    step_m: float = 1.0
    """Path between two submaps."""
    window_m: Positive = 80.0
    layout: PoseColumn = "odom_T_scan"
    """The poses that lay out the scans and measure the path: the log's odometry, or its truth."""
    still_m: Positive = 0.01
    """A scan less than this of path after the last one used is left out: minutes at a red light
    show nothing new."""
    ground_percentile: float = 5.0
    """The ground is this percentile of the heights within `ground_radius_m` of the anchor; −1: the
    reader has put it at 0."""
    ground_radius_m: Positive = 10.0

    def __post_init__(self) -> None:
        check(self, "submap")
        if not self.step_m >= self.still_m:
            raise ConfigError(
                f"submap.step_m={self.step_m}: expected at least still_m={self.still_m}"
            )
        if self.ground_percentile != -1 and not 0 <= self.ground_percentile <= 100:
            raise ConfigError(
                f"submap.ground_percentile={self.ground_percentile}: expected 0 to 100, or -1"
            )

    def cut(self, scans: Scans, progress: Progress) -> Submaps:
        """The submaps of a sequence's scans.

        An anchor without a place, a whole window or any ground makes none, and is counted.
        """
        start_T_scan = scans.load(self.layout)
        first, rows, left_out = self.windows(start_T_scan, scans.world_T_scan)
        used = np.zeros(len(start_T_scan), bool)
        used[sample_path(start_T_scan[:, :3, 3], self.still_m)] = True
        used[first] = used[rows] = True
        ground_m = np.zeros(len(rows))
        if self.ground_percentile >= 0 and len(rows):
            gathered = Gathering(scans, self.layout, first, rows, ground_m, used)
            ground_m = np.array(
                [
                    self._ground_m(points)
                    for points in progress.track(gathered, len(rows), "find the ground")
                ]
            )
            left_out["no point near the anchor"] = int(np.isnan(ground_m).sum())
        has_ground = np.isfinite(ground_m)
        return submaps(
            scans,
            self.layout,
            first[has_ground],
            rows[has_ground],
            ground_m[has_ground],
            used,
            dict(+left_out),
        )

    def windows(
        self, start_T_scan: Poses, world_T_scan: Poses
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], Counter[str]]:
        """First and last scan (submap,) of each window, and counts of anchors without, by reason.

        A row of `start_T_scan` (scan, 4, 4) that holds a NaN is a break: no window reaches across
        it.
        """
        xyz_m = start_T_scan[:, :3, 3]
        rows = sample_path(xyz_m, self.step_m)
        has_pose = np.isfinite(xyz_m).all(axis=1)
        breaks = np.cumsum(~has_pose)
        steps_m = np.linalg.norm(np.diff(xyz_m, axis=0), axis=1)
        path_m = np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(steps_m), steps_m, 0.0))])
        unbroken = np.searchsorted(breaks, breaks[rows]) + (breaks[rows] > 0)
        from_m = path_m[rows] - self.window_m
        is_whole = path_m[unbroken] <= from_m + 1e-9
        has_true_pose = np.isfinite(world_T_scan[rows]).all(axis=(1, 2))
        left_out = Counter(
            {
                "window not yet whole": int((~is_whole).sum()),
                "no true pose": int((is_whole & ~has_true_pose).sum()),
            }
        )
        first = np.maximum(np.searchsorted(path_m, from_m - 1e-9), unbroken)
        return first[is_whole & has_true_pose], rows[is_whole & has_true_pose], left_out

    def _ground_m(self, points_m: NDArray[np.float64]) -> float:
        is_near = np.hypot(points_m[:, 0], points_m[:, 1]) < self.ground_radius_m
        return (
            float(np.percentile(points_m[is_near, 2], self.ground_percentile))
            if is_near.any()
            else np.nan
        )


def submaps(
    scans: Scans,
    layout: PoseColumn,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    ground_m: NDArray[np.float64],
    used: NDArray[np.bool_],
    left_out: Mapping[str, int],
) -> Submaps:
    """The submaps that gather scans `first` to `last` (submap,), with what they look like.

    `ground_m` (submap,) is the height of the ground in the last scan's frame; the scans `used`
    (scan,) go into the submaps around them; `left_out` counts anchors without a submap by reason.
    """
    return Submaps(
        first,
        last,
        ground_m,
        used,
        scans.stamps_ns[last],
        scans.world_T_scan[last],
        layout,
        left_out,
        appearance(scans, layout, first, last, ground_m, used),
    )


def sample_path(xyz_m: NDArray[np.float64], step_m: float) -> NDArray[np.int64]:
    """Rows (m,) of positions (n, 3) sampled along the path (METHODS 2.2).

    The 3D steps between consecutive rows add up; at `step_m` or more a sample is taken and the sum
    starts at zero. Rows with a NaN are skipped, and a step across them does not count.
    """
    steps = np.linalg.norm(np.diff(xyz_m, axis=0), axis=1)
    has_position: NDArray[np.bool_] = np.all(np.isfinite(xyz_m), axis=1)
    rows = []
    travelled = 0.0
    for row, step in enumerate(np.where(np.isfinite(steps), steps, 0.0).tolist(), start=1):
        travelled += step
        if travelled >= step_m and has_position[row]:
            rows.append(row)
            travelled = 0.0
    return np.array(rows, np.int64)
