"""NCLT: velodyne_sync scans, velodyne_hits.bin, ground truth and wheel odometry (METHODS 7.1).

The files' frames are north-east-down; everything handed out is x forward (north), y left (west), z up.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.errors import LogError
from pipeline.formats import nclt
from pipeline.frames import Trajectory, flip_ned, pose
from pipeline.readers import log
from pipeline.readers.log import Log


@dataclass(frozen=True)
class Nclt:
    """A folder of NCLT sequences, one date a sequence."""

    max_gap_s: float = 0.5
    """Ground truth further apart than this is a gap; a scan in it is skipped."""
    lift_m: float = 0.0
    """Added to z. NCLT's body frame has its origin at about ground level."""

    def open(self, root: Path, sequence: str) -> Log:
        folder = root / sequence / nclt.SCANS
        truth_path = log.located(root, nclt.TRUTH_PLACES, sequence)
        if truth_path is None:
            raise LogError(
                f"{root / nclt.TRUTH_PLACES[0].format(sequence=sequence)}: no ground truth there or in its other places"
            )
        skipped: Counter[str] = Counter()
        paths = _scan_files(folder, skipped)
        utimes = np.array([int(path.stem) for path in paths], np.int64)
        odometry_path = log.located(root, nclt.ODOMETRY_PLACES, sequence)
        odometry = None if odometry_path is None else read_poses(odometry_path, self.max_gap_s)
        rows, world_T_scan, odom_T_scan = log.posed(utimes * 1000, read_poses(truth_path, self.max_gap_s), odometry, skipped)
        kept = [paths[row] for row in rows]
        lift = np.array([0.0, 0.0, self.lift_m])
        notes = () if odometry_path is not None else ("no odometry_mu_100hz.csv",)
        return Log(
            utimes[rows] * 1000, world_T_scan, odom_T_scan, lambda row: read_velodyne_sync(kept[row]) + lift, +skipped, notes
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        names = sorted(path.parent.name for path in root.glob(f"*/{nclt.SCANS}") if path.is_dir())
        return {name: [] if log.located(root, nclt.TRUTH_PLACES, name) else [f"groundtruth_{name}.csv"] for name in names}


def read_velodyne_sync(path: str | Path) -> NDArray[np.float64]:
    """Points (n, 3) in metres of one scan: body frame, x forward, y left, z up, motion compensated.

    Raises LogError for a missing file or one that is no whole number of records.
    """
    data = log.read_bytes(Path(path), nclt.RECORD_BYTES, "hits")
    points: NDArray[np.float64] = nclt.decode(np.frombuffer(data, "<u2"))
    return points


def read_poses(path: str | Path, max_gap_s: float = 0.5) -> Trajectory:
    """Ground truth or odometry: poses of the z-up body in the z-up world; rows with NaN stay, as gaps."""
    path = Path(path)
    rows = log.table(path, 7, ",")
    stamps_ns = log.nanoseconds(path, rows[:, 0], "µs", 1000)
    known = np.isfinite(rows).all(axis=1)
    world_T_body = np.full((len(rows), 4, 4), np.nan)
    world_T_body[known] = flip_ned(pose(rows[known, 1:4], rows[known, 4:7]))
    return Trajectory(stamps_ns, world_T_body, max_gap_s)


@dataclass(frozen=True)
class Hits:
    """A whole velodyne_hits.bin: raw returns in the sensor's frame (z up), not motion compensated."""

    points_m: NDArray[np.float64]
    """(hit, 3)."""
    intensity: NDArray[np.uint8]
    laser: NDArray[np.uint8]
    utimes: NDArray[np.int64]
    """(packet,) microseconds since 1970."""
    offsets: NDArray[np.int64]
    """(packet+1,) packet i is hits offsets[i]:offsets[i+1]."""


def read_velodyne_hits(path: str | Path) -> Hits:
    """Every packet of a velodyne_hits.bin; raises LogError with the byte where a packet is broken."""
    path = Path(path)
    data = _mapped(path)
    words = data[: len(data) // 2 * 2].view("<u2")
    starts, offsets, end = _packets(words)
    if 2 * end != len(data):
        raise LogError(f"{path}: no whole packet at byte {2 * end}; the file is damaged or cut short")
    hits = int(offsets[-1])
    points, utimes = np.empty((hits, 3)), np.empty(len(starts), np.uint64)
    intensity, laser = np.empty(hits, np.uint8), np.empty(hits, np.uint8)
    _unpack(words, starts, offsets, points.reshape(-1), intensity, laser, utimes)
    if (utimes >= log.LATEST_NS // 1000).any():
        raise LogError(f"{path}: a packet is stamped {utimes.max()}, which is no time in µs; the file is damaged")
    return Hits(points, intensity, laser, utimes.astype(np.int64), offsets)


def _mapped(path: Path) -> NDArray[np.uint8]:
    """A file's bytes, gigabytes perhaps, without a copy of them."""
    try:
        return np.memmap(path, np.uint8, "r") if path.stat().st_size else np.empty(0, np.uint8)
    except (FileNotFoundError, IsADirectoryError):
        raise LogError(f"{path}: no such file") from None


@njit(cache=True, nogil=True)
def _packets(words: NDArray[np.uint16]) -> tuple[NDArray[np.int64], NDArray[np.int64], np.int64]:
    """First word and first hit of each packet (of hits: one more, the end), and the word after the last whole one."""
    starts, offsets = np.empty(len(words) // 12 + 1, np.int64), np.empty(len(words) // 12 + 1, np.int64)
    found, at = np.int64(0), np.int64(0)
    offsets[0] = 0
    while at + 12 <= len(words):
        magic = True
        for word in range(4):
            magic &= words[at + word] == nclt.PACKET_MAGIC
        hits = np.int64(words[at + 4]) + (np.int64(words[at + 5]) << 16)
        if not magic or at + 12 + 4 * hits > len(words):
            break
        starts[found], offsets[found + 1] = at, offsets[found] + hits
        found += 1
        at += 12 + 4 * hits
    return starts[:found].copy(), offsets[: found + 1].copy(), at


@njit(cache=True, nogil=True, error_model="numpy")
def _unpack(
    words: NDArray[np.uint16],
    starts: NDArray[np.int64],
    offsets: NDArray[np.int64],
    points: NDArray[np.float64],
    intensity: NDArray[np.uint8],
    laser: NDArray[np.uint8],
    utimes: NDArray[np.uint64],
) -> None:
    """Every packet's stamp and hits into flat `points` (3 n,) and the rest (n,)."""
    for packet in range(starts.shape[0]):
        start, first, end = starts[packet], offsets[packet], offsets[packet + 1]
        utimes[packet] = 0
        for word in range(4):
            utimes[packet] |= np.uint64(words[start + 6 + word]) << np.uint64(16 * word)
        hits = words[start + 12 : start + 12 + 4 * (end - first)]
        nclt.metres(hits, points[3 * first : 3 * end])
        for i in range(end - first):
            intensity[first + i] = hits[4 * i + 3] & 0xFF
            laser[first + i] = hits[4 * i + 3] >> 8


def _scan_files(folder: Path, skipped: Counter[str]) -> list[Path]:
    """Scan files in order of time; counts those whose name or length cannot be right."""
    if not folder.is_dir():
        raise LogError(f"{folder}: no such folder of scans")
    good: list[Path] = []
    for path in folder.glob("*.bin"):
        length = path.stat().st_size
        if not path.is_file() or not path.stem.isdecimal() or path.stem[0] == "0" or int(path.stem) >= log.LATEST_NS // 1000:
            skipped["file name is no utime"] += 1
        elif length == 0:
            skipped["empty file"] += 1
        elif length % nclt.RECORD_BYTES:
            skipped["truncated record"] += 1
        else:
            good.append(path)
    if not good:
        raise LogError(f"{folder}: holds no readable scan (UTIME.bin)")
    return sorted(good, key=lambda path: int(path.stem))
