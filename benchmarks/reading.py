"""Races to read cached NCLT scans: yearloc, numpy's structured types, struct, the bytes alone."""

import struct
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.race import Race, race
from pipeline.formats import nclt
from pipeline.readers.nclt import read_velodyne_sync

HITS = 120_000
FILES = 16
RECORD = np.dtype([("x", "<u2"), ("y", "<u2"), ("z", "<u2"), ("intensity", "u1"), ("laser", "u1")])


def run() -> list[Race]:
    """Scans of 120,000 hits."""
    with tempfile.TemporaryDirectory() as name:
        return _races(Path(name))


def _races(folder: Path) -> list[Race]:
    rng = np.random.default_rng(0)
    paths = [folder / f"{i}.bin" for i in range(FILES)]
    for path in paths:
        path.write_bytes(rng.integers(0, 2**16, (HITS, 4), dtype=np.uint16).tobytes())
    if not np.array_equal(read_velodyne_sync(paths[0]), structured(paths[0], np.float64)):
        raise AssertionError("velodyne_sync: the points differ from numpy's")
    scans = race(
        f"velodyne_sync, {HITS:,} hits, metres [n, 3] in float64 (bytes equal numpy's)",
        {
            "yearloc": lambda i: read_velodyne_sync(paths[i % FILES]),
            "np.fromfile, structured type, float64": lambda i: structured(
                paths[i % FILES], np.float64
            ),
            "np.fromfile, structured type, float32": lambda i: structured(
                paths[i % FILES], np.float32
            ),
            "the bytes alone": lambda i: paths[i % FILES].read_bytes(),
        },
        rounds=100,
    )
    one_by_one = race(
        "the same, one hit at a time",
        {
            "yearloc": lambda i: read_velodyne_sync(paths[i % FILES]),
            "struct.unpack": lambda i: unpacked_scan(paths[i % FILES]),
        },
        rounds=5,
    )
    return [scans, one_by_one]


def structured(path: Path, kind: type) -> NDArray[np.floating]:
    """The usual way with numpy."""
    raw = np.fromfile(path, RECORD)
    points: NDArray[np.floating] = np.empty((len(raw), 3), kind)
    for axis, (name, sign) in enumerate((("x", 1), ("y", -1), ("z", -1))):
        points[:, axis] = (raw[name] * nclt.GRAIN_M + nclt.OFFSET_M) * sign
    return points


def unpacked_scan(path: Path) -> NDArray[np.float64]:
    """The style of the data set's own sample code."""
    data = path.read_bytes()
    points: list[tuple[float, ...]] = []
    for at in range(0, len(data), nclt.RECORD_BYTES):
        x, y, z, _, _ = struct.unpack("<HHHBB", data[at : at + nclt.RECORD_BYTES])
        points.append((x * 0.005 - 100.0, -(y * 0.005 - 100.0), -(z * 0.005 - 100.0)))
    return np.array(points)
