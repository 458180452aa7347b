"""Keys: the scans of a drive, one every few metres, that loops and the graph join (keyframes).

In: a log and its odometry (`Track`). Out: for each key its pose by odometry, its thinned points and
its Scan Context, for the later steps of `yearloc slam` (METHODS 12).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses, travelled_m
from pipeline.core.progress import Progress
from pipeline.mapping.appearance import measure_ground_m
from pipeline.mapping.tiled_map import GRAIN_M
from pipeline.matching.shifts import Spectra
from pipeline.posing.registration import Points
from pipeline.posing.targets import Targets, thinned
from pipeline.readers.deskew import scan_at_stamp
from pipeline.readers.log import Log, lifted
from pipeline.slam.odometry import Track
from pipeline.views.scan_context import ScanContext

LOOKED_AT = 9
"""Number of keys, evenly spread, from which the height of the ground is estimated."""
NEAR_M = 15.0
"""The vehicle's tilt is estimated from the ground within this distance (drive.py)."""


@dataclass(frozen=True)
class Keys:
    """The k keys of a drive. A key's frame is its scan's, moved so that the ground is at z = 0."""

    rows: NDArray[np.int64]
    """(k,) the row of each key's scan in the log."""
    parts: NDArray[np.int64]
    """(k,) the number of each key's part of the drive; odometry breaks between two parts."""
    path_m: NDArray[np.float64]
    """(k,) length of the path up to each key."""
    odom_T_key: Poses
    """(k, 4, 4) pose of each key by odometry, in the frame of its part."""
    heights_m: NDArray[np.float32]
    """(k, ring, sector) the Scan Context of each key."""
    points: NDArray[np.int16]
    """(n, 3) thinned points of all keys, one after the other, in units of GRAIN_M."""
    offsets: NDArray[np.int64]
    """(k + 1,) key i has points[offsets[i]:offsets[i + 1]]."""
    lift_m: float
    """The height added to all points, so that the ground is at z = 0."""

    @classmethod
    def read(
        cls,
        log: Log,
        track: Track,
        every_m: float,
        voxel_m: float,
        range_m: float,
        view: ScanContext,
        watch: Progress,
    ) -> Self:
        """Choose one scan in every `every_m` of path, and read these scans.

        Their points within `range_m` are thinned to one a voxel of `voxel_m`. A scan that cannot be
        read is left out.
        """
        rows, path_m = key_rows(track, every_m)
        lift_m = -ground_m(log, rows)
        readable_keys: list[int] = []
        heights_m = []
        points: list[NDArray[np.int16]] = []
        for number, row in enumerate(watch.track(rows.tolist(), len(rows), "keys")):
            try:
                points_m = scan_at_stamp(log, track.odom_T_scan, track.breaks, row)
                points_m[:, 2] += lift_m
            except LogError:
                continue
            readable_keys.append(number)
            heights_m.append(view(points_m))
            points.append(thinned(points_m, range_m, voxel_m).astype(np.int16))
        rows = rows[readable_keys]
        return cls(
            rows,
            track.parts[rows],
            path_m[readable_keys],
            lifted(track.odom_T_scan[rows], lift_m),
            np.stack(heights_m),
            np.concatenate(points),
            np.cumsum([0, *map(len, points)]),
            lift_m,
        )

    def targets(self, world_T_key: Poses, range_m: float) -> Targets:
        """The keys as submaps for registration, at poses (k, 4, 4)."""
        arrays: dict[str, NDArray[Any]] = {
            "points": self.points,
            "offsets": self.offsets,
            "world_T_anchor": world_T_key,
        }
        return Targets(arrays, GRAIN_M, range_m, single=True)

    def points_m(self, key: int) -> Points:
        """The thinned points (n, 3) of a key, z up from the ground."""
        return np.asarray(self.points[self.offsets[key] : self.offsets[key + 1]] * GRAIN_M)

    @cached_property
    def spectra(self) -> Spectra:
        """The Scan Contexts of all keys, transformed for fast comparison."""
        return Spectra.learned(self.heights_m)


def key_rows(track: Track, every_m: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The rows (k,) of the scans that become keys, and the metres of path (k,) up to each.

    The first scan of each part is a key, then one scan every `every_m` of path. A break adds no
    path.
    """
    rows = np.flatnonzero(np.isfinite(track.odom_T_scan).all(axis=(1, 2)))
    parts = track.parts[rows]
    path_m = travelled_m(track.odom_T_scan[rows, :3, 3], np.diff(parts) == 0)
    keys = spaced(parts, path_m, every_m)
    return rows[keys], path_m[keys]


def spaced(parts: NDArray[np.int64], path_m: NDArray[np.float64], every_m: float) -> list[int]:
    """The rows, of n scans or keys, of the first in each part, then of one every `every_m` of path.

    `parts` and `path_m` are (n,).
    """
    chosen: list[int] = []
    for row in range(len(parts)):
        if (
            not chosen
            or parts[row] != parts[chosen[-1]]
            or path_m[row] - path_m[chosen[-1]] >= every_m
        ):
            chosen.append(row)
    return chosen


def ground_m(log: Log, rows: Sequence[int] | NDArray[np.int64]) -> float:
    """The median z of the ground in a few of the scans `rows`; 0 if none of them can be read."""
    if not len(rows):
        return 0.0
    numbers = np.unique(np.linspace(0, len(rows) - 1, LOOKED_AT).astype(int))
    heights_m = []
    for number in numbers:
        try:
            points_m = np.asarray(log.points(int(rows[number])), np.float64)
        except LogError:
            continue
        if len(points_m):
            heights_m.append(measure_ground_m(points_m, np.hypot(points_m[:, 0], points_m[:, 1])))
    return float(np.median(heights_m)) if heights_m else 0.0
