"""MapClosures, its authors' program: one day's local maps are the database, another's the queries.

It runs on one core.

`python local_maps.py TRAIN TEST REACH_M OUT`: TRAIN and TEST are npz files of scans: points (n, 3),
offsets (scan + 1,), placed_T_scan (scan, 4, 4), and TEST's asked (query,), rows of scans. OUT is an
npz of two sets of answers: `own_` of the test day's local maps as its authors' program cuts them,
`asked_` of a local map at each queried row, of the path driven last.
"""

import os

os.environ["OPENCV_FOR_THREADS_NUM"] = "1"  # before the libraries are loaded

import sys
import time
from collections.abc import Iterator
from multiprocessing import get_context
from typing import Any

import numpy as np
from map_closures.config import MapClosuresConfig  # type: ignore[import-not-found]
from map_closures.map_closures import MapClosures  # type: ignore[import-not-found]
from map_closures.voxel_map import VoxelMap  # type: ignore[import-not-found]

Array = np.ndarray[Any, Any]
Local = tuple[int, int, int, Array]
"""A local map: the scan whose frame it has, its first scan and the one after its last, points (n,
3)."""
FAR = 10
"""It never compares maps whose numbers are as near as 3."""
config = MapClosuresConfig()
closures = MapClosures(config)


class Day:
    """A day's scans."""

    def __init__(self, path: str) -> None:
        arrays = np.load(path)
        self.points = arrays["points"]
        self.offsets = arrays["offsets"]
        self.placed_T_scan = arrays["placed_T_scan"]
        self.asked = arrays["asked"]

    def integrate(self, local_map: Any, frame: int, row: int) -> float:
        """Insert scan `row` into a map in the frame of another scan; returns their distance (m)."""
        frame_T_scan = np.linalg.inv(self.placed_T_scan[frame]) @ self.placed_T_scan[row]
        local_map.integrate_frame(
            self.points[self.offsets[row] : self.offsets[row + 1]], frame_T_scan
        )
        return float(np.linalg.norm(frame_T_scan[:3, 3]))

    def own(self, reach_m: float) -> Iterator[Local]:
        """Local maps one after the other: each ends `reach_m` from its start, and its points near
        its end are part of the next."""
        local_map = VoxelMap(config.density_map_resolution, reach_m)
        start = 0
        last = len(self.placed_T_scan) - 1
        for row in range(last + 1):
            if self.integrate(local_map, start, row) > reach_m or row == last:
                yield start, start, row + 1, local_map.point_cloud()
                start_T_end = np.linalg.inv(self.placed_T_scan[start]) @ self.placed_T_scan[row]
                local_map.remove_far_away_points(start_T_end[:3, 3])
                kept = local_map.point_cloud()
                local_map.clear()
                local_map.integrate_frame(kept, np.linalg.inv(start_T_end))
                start = row

    def last(self, reach_m: float) -> Iterator[Local]:
        """A local map at each queried row: the scans of the last `reach_m` before it."""
        for end in self.asked.tolist():
            local_map = VoxelMap(config.density_map_resolution, reach_m)
            first = end
            while self.integrate(local_map, end, first) <= reach_m and first > 0:
                first -= 1
            yield end, first, end + 1, local_map.point_cloud()


def ask(number: int, local: Local) -> tuple[Any, ...]:
    """A local map's scans, its best match in the database, its frame in that map, inliers, and
    milliseconds of CPU time."""
    *rows, points = local
    start = time.process_time()
    closure = closures.get_best_closure(number, points)
    took_ms = 1e3 * (time.process_time() - start)
    return *rows, closure.source_id, np.linalg.inv(closure.pose), closure.number_of_inliers, took_ms


def main(train: str, test: str, reach_m: float, out: str) -> None:
    """Each map is queried in a process of its own, since a query joins the database."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # no thread is left behind by a fork
    frames = []
    for number, (start, _, _, points) in enumerate(Day(train).own(reach_m)):
        frames.append(start)
        closures.get_best_closure(number, points)
    day = Day(test)
    answers = dict[str, Any]()
    for kind, maps in (("own", day.own(reach_m)), ("asked", day.last(reach_m))):
        with get_context("fork").Pool(1, maxtasksperchild=1) as pool:
            closest = [pool.apply(ask, (len(frames) + FAR, local)) for local in maps]
        frame, first, stop, source, pose, inliers, took_ms = (
            np.array(column) for column in zip(*closest, strict=True)
        )
        answers |= {
            f"{kind}_frame": frame,
            f"{kind}_first": first,
            f"{kind}_stop": stop,
            f"{kind}_took_ms": took_ms,
        }
        answers |= {
            f"{kind}_reference": np.array(frames)[np.where(inliers > 0, source, 0)],
            f"{kind}_reference_T_frame": pose,
        }
        answers |= {
            f"{kind}_inliers": inliers,
            f"{kind}_accepted": inliers > config.inliers_threshold,
        }
    np.savez(out, **answers)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), sys.argv[4])
