"""Reading NCLT's files from the page cache: ours against numpy's structured types, struct, and touching every byte."""

import struct
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.race import Race, race
from pipeline.formats import nclt
from pipeline.readers.nclt import read_velodyne_hits, read_velodyne_sync

HITS, FILES = 120_000, 16
PACKETS, STRUCT_PACKETS, PACKET_HITS = 40_000, 2_000, 342
"""110 MB of velodyne_hits.bin; struct reads a twentieth of it, and its time is scaled."""
RECORD = np.dtype([("x", "<u2"), ("y", "<u2"), ("z", "<u2"), ("intensity", "u1"), ("laser", "u1")])


def run() -> list[Race]:
    """Scans of 120,000 hits, and a drive's raw packets."""
    with tempfile.TemporaryDirectory() as folder:
        return [*_scans(Path(folder)), _packets(Path(folder))]


def _scans(folder: Path) -> list[Race]:
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
            "np.fromfile, structured type, float64": lambda i: structured(paths[i % FILES], np.float64),
            "np.fromfile, structured type, float32": lambda i: structured(paths[i % FILES], np.float32),
            "the bytes alone": lambda i: paths[i % FILES].read_bytes(),
        },
        rounds=100,
    )
    one_by_one = race(
        "the same, one hit at a time",
        {"yearloc": lambda i: read_velodyne_sync(paths[i % FILES]), "struct.unpack": lambda i: unpacked_scan(paths[i % FILES])},
        rounds=5,
    )
    return [scans, one_by_one]


def _packets(folder: Path) -> Race:
    packet = np.dtype(
        [("magic", "<u2", 4), ("hits", "<u4"), ("utime", "<u8"), ("pad", "u1", 4), ("records", RECORD, PACKET_HITS)]
    )
    made = np.zeros(PACKETS, packet)
    made["magic"], made["hits"], made["utime"] = nclt.PACKET_MAGIC, PACKET_HITS, 10**15 + 500 * np.arange(PACKETS)
    bits = np.random.default_rng(0).integers(0, 2**16, (PACKETS, PACKET_HITS, 4), dtype=np.uint16)
    made["records"] = bits.view(RECORD)[..., 0]
    whole, part = folder / "velodyne_hits.bin", folder / "part.bin"
    whole.write_bytes(made.tobytes())
    part.write_bytes(made[:STRUCT_PACKETS].tobytes())
    size_mb = whole.stat().st_size / 1e6
    del made, bits
    ours, theirs = read_velodyne_hits(part), unpacked_hits(part)
    if not (np.array_equal(ours.points_m, theirs[:, :3]) and np.array_equal(ours.intensity, theirs[:, 3])):
        raise AssertionError("velodyne_hits: the points differ from struct's")
    found = race(
        f"velodyne_hits.bin, {size_mb:.0f} MB, {PACKETS:,} packets",
        {
            "yearloc": lambda _: read_velodyne_hits(whole),
            "touching every byte": partial(touched, whole),
            "struct.unpack, scaled": lambda _: unpacked_hits(part),
        },
        rounds=5,
    )
    times = dict(found.median_ms)
    times["struct.unpack, scaled"] *= PACKETS / STRUCT_PACKETS
    return Race(found.name, times)


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


def unpacked_hits(path: Path) -> NDArray[np.float64]:
    """The same for packets: x, y, z, intensity, laser of every hit."""
    hits = []
    with path.open("rb") as file:
        while head := file.read(nclt.PACKET_HEADER_BYTES):
            number = struct.unpack("<4HIQ4x", head)[4]
            for _ in range(number):
                x, y, z, intensity, laser = struct.unpack("<HHHBB", file.read(nclt.RECORD_BYTES))
                hits.append((x * 0.005 - 100.0, -(y * 0.005 - 100.0), -(z * 0.005 - 100.0), intensity, laser))
    return np.array(hits, np.float64)


def touched(path: Path, _: int) -> int:
    """The limit: every byte of the mapped file, once."""
    return int(_sum(np.memmap(path, np.uint8, "r")))


@njit(cache=True, nogil=True)
def _sum(data: NDArray[np.uint8]) -> np.int64:
    total = np.int64(0)
    for i in range(data.shape[0]):
        total += data[i]
    return total
