"""Tells a 3-D map from the scans of a robot, by content: a path in, yes or no out.

The points of a scan are the farther apart the farther they are from the sensor, which is at the
origin of its frame. The points of a map are about equally dense wherever a robot drove. The tiles
of a map lie beside each other; consecutive scans overlap.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pipeline.core.errors import LogError
from pipeline.formats import autoware, folder, pcd
from pipeline.opening.map_files import BLOCKS

ONLY_MAPS = (".ply", ".las", ".laz")
"""Suffixes of files that are never read as scans."""
MOST_POINTS = 1_000_000
"""A file of more points is a map: scanners of robots take fewer in a turn."""
FEWEST_POINTS = 500
"""Fewer points do not tell."""
OUTSIDE_M = 10.0
"""A cloud whose box is farther than this from the origin is not in a sensor's frame."""
NEAREST_M = 1.0
"""Points nearer than this to the sensor are mostly of the robot."""
SAMPLE = 5_000
"""Points whose nearest neighbour is looked for."""
RING = 0.3
"""Width of a ring, in logarithms of the distance."""
FEWEST_IN_RING = 50
FEWEST_RINGS = 4
SCAN_SLOPE = 0.5
"""The spacing of a scan's points grows with the distance to a greater power than this. Recorded
scans have .7 to 1.3, a recorded map −.3 to .3."""
PAIRS = 6
"""Pairs of neighbouring files of a folder that are looked at."""
APART_SHARE = 0.1
"""Tiles overlap by less than this share of the smaller one."""


def is_map_file(path: Path) -> bool:
    """Whether a file is a 3-D map, not a scan; a file that cannot be read is none."""
    if path.suffix.lower() in ONLY_MAPS:
        return True
    if path.suffix.lower() in (".yaml", ".yml"):
        return autoware.read_metadata(path) is not None
    if path.suffix.lower() != ".pcd":
        return False
    if path.stat().st_size > folder.LARGEST_BYTES:
        return True
    points_m = _points(path)
    if points_m is None or not len(points_m) or np.ptp(points_m[:, 2]) == 0:
        return False  # what is wrong with it is said of a scan too
    return len(points_m) > MOST_POINTS or not is_scan(points_m)


def is_map_folder(path: Path) -> bool:
    """Whether a folder holds the tiles of a 3-D map: Autoware names them, or they do not overlap.

    A folder with one .pcd is what the file is.
    """
    yamls = [file for file in path.iterdir() if file.suffix in (".yaml", ".yml")]
    beside = path.resolve().parent / autoware.METADATA
    files = sorted(file for file in path.iterdir() if file.suffix.lower() in BLOCKS)
    if any(autoware.read_metadata(file) for file in yamls if file.is_file()):
        return True
    if not files or any(file.suffix in (".bin", ".npy") for file in path.iterdir()):
        return False
    if all(file.suffix.lower() in ONLY_MAPS for file in files):
        return True
    if beside.is_file() and autoware.read_metadata(beside):
        return True
    if len(files) == 1:
        return is_map_file(files[0])
    firsts = np.unique(np.linspace(0, len(files) - 2, PAIRS).round().astype(int))
    return all(_are_apart(files[first], files[first + 1]) for first in firsts)


def is_scan(points_m: NDArray[np.float64], centre_m: NDArray[np.float64] | None = None) -> bool:
    """Whether finite points (n, 3) are a scan from about the centre (3,), by default the origin.

    Too few points to tell are taken for a scan.
    """
    if len(points_m) < FEWEST_POINTS:
        return True
    offsets_m = points_m if centre_m is None else points_m - centre_m
    outside_m = np.maximum(offsets_m.min(axis=0), -offsets_m.max(axis=0))
    if outside_m[:2].max() > OUTSIDE_M:
        return False
    range_m = np.linalg.norm(offsets_m, axis=1)
    far = np.flatnonzero(range_m > NEAREST_M)
    if len(far) < FEWEST_POINTS:
        return True
    sample = np.random.default_rng(0).choice(far, min(SAMPLE, len(far)), replace=False)
    apart_m = np.asarray(cKDTree(points_m).query(points_m[sample], k=2)[0])[:, 1]
    is_single = apart_m > 0  # points that are there twice tell nothing
    log_range = np.log(range_m[sample][is_single])
    log_apart = np.log(apart_m[is_single])
    rings = np.floor(log_range / RING).astype(np.int64)
    numbers, counts = np.unique(rings, return_counts=True)
    numbers = numbers[counts >= FEWEST_IN_RING]
    if len(numbers) < FEWEST_RINGS:
        return True
    x = [np.median(log_range[rings == number]) for number in numbers]
    y = [np.median(log_apart[rings == number]) for number in numbers]
    return float(np.polyfit(x, y, 1)[0]) > SCAN_SLOPE


def _points(path: Path) -> NDArray[np.float64] | None:
    """The finite points (n, 3) of a .pcd, one more than MOST_POINTS at most; None if damaged."""
    try:
        block = next(pcd.blocks(path, MOST_POINTS + 1), np.empty((0, 3)))
    except LogError:
        return None
    return block[np.isfinite(block).all(axis=1)]


def _are_apart(first: Path, second: Path) -> bool:
    """Whether the boxes of two files, seen from above, hardly overlap."""
    boxes = []
    for path in (first, second):
        points_m = _points(path) if path.suffix.lower() == ".pcd" else None
        if points_m is None or not len(points_m):
            return False
        boxes.append(np.percentile(points_m[:, :2], (1, 99), axis=0))
    low = np.maximum(boxes[0][0], boxes[1][0])
    high = np.minimum(boxes[0][1], boxes[1][1])
    overlap_m2 = float(np.prod((high - low).clip(0)))
    smaller_m2 = float(min(np.prod(box[1] - box[0]) for box in boxes))
    return overlap_m2 <= APART_SHARE * smaller_m2
