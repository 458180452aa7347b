"""Gathers the points of submaps: artifacts of scans and submaps in, the points of each submap out.

A submap gathers a window of scans, placed by their poses, in the frame of the newest scan, its
anchor. Neighbouring submaps share scans, but each scan is read and placed only once.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.frames import travelled_m
from pipeline.core.schemas import PoseColumn, Scans, Submaps

BLOCK = 256
"""Number of scans read together."""


@dataclass(frozen=True)
class Gathering:
    """An iterable over the points of submaps, each of which gathers a window of scans.

    It keeps the points of one window and of one block of scans in memory.
    """

    scans: Scans
    layout: PoseColumn
    """The column of the scans' poses by which they are placed."""
    first: NDArray[np.int64]
    """(submap,) the oldest scan of each window."""
    last: NDArray[np.int64]
    """(submap,) the newest scan of each window, the submap's anchor; must not decrease."""
    ground_m: NDArray[np.float64]
    """(submap,) height of the ground in the anchor's frame; it is subtracted from all heights."""
    used: NDArray[np.bool_]
    """(scan,) whether the scan is gathered."""

    def __len__(self) -> int:
        return len(self.last)

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Points (n, 3) in metres of each submap, in its anchor's frame, z up from the ground."""
        start_T_scan = self.scans.load(self.layout)
        scans = scan_points(self.scans, int(self.first[0]), int(self.last[-1]) + 1)
        used_scans = ((row, points) for row, points in scans if self.used[row])
        # the rows of the scans in the window, and their points in the frame of the start
        window: deque[tuple[int, NDArray[np.float64]]] = deque()
        for first_scan, last_scan, ground_m in zip(
            self.first, self.last, self.ground_m, strict=True
        ):
            # 1. Place the scans that enter the window, and drop those that leave it.
            while not window or window[-1][0] < last_scan:
                row, points = next(used_scans)
                window.append((row, transformed(start_T_scan[row], points)))
            while window[0][0] < first_scan:
                window.popleft()

            # 2. Move the window into the frame of its anchor, with the ground at z = 0.
            start_points = np.concatenate([points for _, points in window])
            anchor_T_start = np.linalg.inv(start_T_scan[last_scan])
            yield transformed(anchor_T_start, start_points) - (0.0, 0.0, ground_m)


def scan_points(scans: Scans, start: int, stop: int) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Yield the rows from `start` to before `stop` of a scans artifact, with their points (n, 3).

    Points are in metres in the scan's own frame. BLOCK scans are read together.
    """
    offsets = scans.offsets
    grain_m = scans.grain_m
    for block_start in range(start, stop, BLOCK):
        block_stop = min(block_start + BLOCK, stop)
        points = scans["points"][offsets[block_start] : offsets[block_stop]] * grain_m
        block_offsets = offsets[block_start : block_stop + 1] - offsets[block_start]
        for row, (scan_start, scan_stop) in enumerate(pairwise(block_offsets), start=block_start):
            yield row, points[scan_start:scan_stop]


def submap_points(scans: Scans, submaps: Submaps, rows: slice) -> Iterator[NDArray[np.float64]]:
    """Yield the points (n, 3) in metres of some rows of a submaps artifact.

    They are in the anchor's frame, z up from the ground. If each of these submaps is one scan, all
    are read in one slice, and the points stay in the scan's own frame: no rounding is added.
    """
    first = np.asarray(submaps["first"][rows])
    last = np.asarray(submaps["scans"][rows])
    ground_m = np.asarray(submaps["ground_m"][rows])
    if (first != last).any():
        yield from Gathering(scans, submaps.layout, first, last, ground_m, submaps.used)
        return
    # Scan i has the points from offset i to before offset i + 1.
    offsets = np.asarray(scans["offsets"][last[0] : last[-1] + 2])
    points = np.asarray(scans["points"][offsets[0] : offsets[-1]])
    for row, height_m in zip(last - last[0], ground_m, strict=True):
        cloud = points[offsets[row] - offsets[0] : offsets[row + 1] - offsets[0]]
        yield cloud * scans.grain_m - (0.0, 0.0, height_m)


def gathered_m(scans: Scans, submaps: Submaps) -> float:
    """The path in metres over which submaps gather scans, as a median; 0 for single scans."""
    first, last = submaps.load("first"), submaps.load("scans")
    if not len(last):
        return 0.0
    path_m = travelled_m(scans.load(submaps.layout)[:, :3, 3])
    return float(np.median(path_m[last] - path_m[first]))


@njit(cache=True, nogil=True, error_model="numpy")
def transformed(a_T_b: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (n, 3) in metres, transformed from frame b into frame a by the pose a_T_b (4, 4).

    The loop is compiled, since BLAS would wake its threads for these slim matrices.
    """
    transformed_points = np.empty((len(points), 3), np.float64)
    for i in range(len(points)):
        for row in range(3):
            x = points[i, 0]
            y = points[i, 1]
            z = points[i, 2]
            transformed_points[i, row] = (
                a_T_b[row, 0] * x + a_T_b[row, 1] * y + a_T_b[row, 2] * z + a_T_b[row, 3]
            )
    return transformed_points
