"""Gathers the points of submaps: the artifacts of scans and submaps in; points a submap out.

Neighbouring submaps share scans; each scan is read and laid out once all the same.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.schemas import PoseColumn, Scans, Submaps

BLOCK = 256
"""Scans read together."""


@dataclass(frozen=True)
class Gathering:
    """An iterator over the points of submaps, of which each gathers a window of scans.

    In memory are the points of one window and of one block of scans.
    """

    scans: Scans
    layout: PoseColumn
    first: NDArray[np.int64]
    """(submap,) the oldest scan of its window."""
    last: NDArray[np.int64]
    """(submap,) the newest scan, in whose frame the points are given; never decreasing."""
    ground_m: NDArray[np.float64]
    """(submap,) height of the ground in that frame, which is taken off."""
    used: NDArray[np.bool_]
    """(scan,) whether it is gathered at all."""

    def __len__(self) -> int:
        return len(self.last)

    def __iter__(self) -> Iterator[NDArray[np.float64]]:
        """Points (n, 3) in metres of each submap, in its anchor's frame, z up from the ground."""
        start_T_scan = self.scans.load(self.layout)
        laid: deque[tuple[int, NDArray[np.float64]]] = deque()
        scans = scan_points(self.scans, int(self.first[0]), int(self.last[-1]) + 1)
        used_scans = ((row, points) for row, points in scans if self.used[row])
        for first_scan, last_scan, ground_m in zip(
            self.first, self.last, self.ground_m, strict=True
        ):
            while not laid or laid[-1][0] < last_scan:
                row, points = next(used_scans)
                laid.append((row, transformed(start_T_scan[row], points)))
            while laid[0][0] < first_scan:
                laid.popleft()
            inside = np.concatenate([points for _, points in laid])
            yield transformed(np.linalg.inv(start_T_scan[last_scan]), inside) - (0.0, 0.0, ground_m)


def scan_points(scans: Scans, start: int, stop: int) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Rows start … stop − 1 of a scans artifact, each with its points (n, 3) in metres.

    BLOCK scans are read together.
    """
    offsets = scans.offsets
    grain_m = scans.grain_m
    for block_start in range(start, stop, BLOCK):
        end = min(block_start + BLOCK, stop)
        points = scans["points"][offsets[block_start] : offsets[end]] * grain_m
        block_offsets = offsets[block_start : end + 1] - offsets[block_start]
        for row, (first, last) in enumerate(pairwise(block_offsets), start=block_start):
            yield row, points[first:last]


def submap_points(scans: Scans, submaps: Submaps, rows: slice) -> Iterator[NDArray[np.float64]]:
    """Points (n, 3) in metres of these rows of a submaps artifact, in each anchor's frame.

    z is up from the ground. Submaps of one scan each are read in one slice and never leave the
    scan's own frame, so no rounding is added.
    """
    first, last, ground_m = (
        np.asarray(submaps[name][rows]) for name in ("first", "scans", "ground_m")
    )
    if (first != last).any():
        yield from Gathering(scans, submaps.layout, first, last, ground_m, submaps.used)
        return
    offsets = np.asarray(scans["offsets"][last[0] : last[-1] + 2])
    points = np.asarray(scans["points"][offsets[0] : offsets[-1]])
    for row, height_m in zip(last - last[0], ground_m, strict=True):
        cloud = points[offsets[row] - offsets[0] : offsets[row + 1] - offsets[0]]
        yield cloud * scans.grain_m - (0.0, 0.0, height_m)


@njit(cache=True, nogil=True, error_model="numpy")
def transformed(a_T_b: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (n, 3) of frame b in frame a; for such slim matrices BLAS would wake its threads."""
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
