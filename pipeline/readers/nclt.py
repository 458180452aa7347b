"""Reads a sequence of NCLT, scans of a 3-D LiDAR with true poses, as a Log (METHODS 7.1).

Its files are the scans in velodyne_sync/, the ground truth, and the wheel odometry with its
covariance. The raw packets in velodyne_hits.bin are read here too, for `yearloc inspect`. The
frames in the files are north-east-down; all results are x forward (north), y left (west), z up.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import LATEST_NS, Trajectory, flip_ned, pose
from pipeline.core.settings import Positive, checked
from pipeline.formats import nclt
from pipeline.readers import log
from pipeline.readers.log import Log, Uncertainty

HEADER_WORDS = nclt.PACKET_HEADER_BYTES // 2
"""16-bit words of a packet's header.

They are MAGIC_WORDS of PACKET_MAGIC, two with the count of its hits, the low one first, four with
its utime, and two that are not used.
"""
MAGIC_WORDS = 4
COUNT_WORD = 4
UTIME_WORD = 6
UTIME_WORDS = 4
HIT_WORDS = 4
"""The 16-bit words of a hit: x, y, z, then intensity and laser together."""


@dataclass(frozen=True)
@checked("reader")
class Nclt:
    """A folder of NCLT sequences, each named by its date."""

    max_gap_s: Positive = 0.5
    """Ground truth further apart than this is a gap; a scan in it is skipped."""
    lift_m: float = 0.0
    """Added to z, for a ground that is not at z = 0: NCLT's body frame has its origin near it."""
    poses: bool = True
    """False: all scans are taken, without true poses."""

    def open(self, root: Path, sequence: str) -> Log:
        """Open a sequence below `root`; raises LogError if it cannot be read."""
        folder = root / sequence / nclt.SCANS
        ground_truth_path = log.first_file(root, nclt.GROUND_TRUTH_PLACES, sequence)
        if ground_truth_path is None and self.poses:
            expected_path = root / nclt.GROUND_TRUTH_PLACES[0].format(sequence=sequence)
            raise LogError(
                f"{expected_path}: no ground truth there or in its other places; `yearloc fetch "
                "nclt DATE` brings it"
            )
        skipped: Counter[str] = Counter()
        utimes = nclt_utimes(folder, skipped)
        odometry_path = log.first_file(root, nclt.ODOMETRY_PLACES, sequence)
        odometry = None if odometry_path is None else read_poses(odometry_path, self.max_gap_s)
        ground_truth = (
            read_poses(ground_truth_path, self.max_gap_s)
            if self.poses and ground_truth_path
            else None
        )
        ground_truth_name = ground_truth_path.name if ground_truth_path else "the ground truth"
        posed = log.rows_with_poses(
            folder,
            utimes * 1000,
            ground_truth=ground_truth,
            odometry=odometry,
            skipped=skipped,
            question=f"is {ground_truth_name} of this date?",
        )
        utimes = utimes[posed.rows]
        stamps_ns = utimes * 1000
        notes = list(posed.notes)
        if odometry is None:
            notes.append("no odometry_mu_100hz.csv")
        covariance_path = log.first_file(root, nclt.COVARIANCE_PLACES, sequence)
        odom_variance = None
        if odometry is not None and covariance_path is not None:
            try:
                odom_variance = read_uncertainty(covariance_path).at(stamps_ns)
            except LogError as error:  # a log is read without it too
                notes.append(f"{error}: the odometry's covariance is not used")

        def points(row: int) -> NDArray[np.float64]:
            return read_velodyne_sync(folder / f"{utimes[row]}.bin", self.lift_m)

        return Log(
            stamps_ns=stamps_ns,
            world_T_scan=posed.world_T_scan,
            odom_T_scan=posed.odom_T_scan,
            points=points,
            skipped=+skipped,  # without the reasons that were counted as 0
            notes=tuple(notes),
            odom_variance=odom_variance,
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        """The sequences below `root`, each with the files that it lacks."""
        names = sorted(path.parent.name for path in root.glob(f"*/{nclt.SCANS}") if path.is_dir())
        missing: dict[str, list[str]] = {name: [] for name in names}
        for name in names if self.poses else ():
            if log.first_file(root, nclt.GROUND_TRUTH_PLACES, name) is None:
                missing[name].append(f"groundtruth_{name}.csv")
        return missing


def nclt_utimes(folder: Path, skipped: Counter[str]) -> NDArray[np.int64]:
    """The utimes (n,) that name the whole scans of a folder velodyne_sync/.

    Counts the other files in `skipped`. Raises LogError if there is no scan.
    """
    if not folder.is_dir():
        raise LogError(f"{folder}: no such folder of scans")
    files = log.numbered_files(
        folder, nclt.RECORD_BYTES, log.is_utime, "file name is no utime", skipped
    )
    if not len(files.usable):
        raise LogError(f"{folder}: holds no readable scan (UTIME.bin)")
    return files.usable


def read_velodyne_sync(path: str | Path, lift_m: float = 0.0) -> NDArray[np.float64]:
    """Points (n, 3) in metres of one motion-compensated scan in the body frame, raised by `lift_m`.

    The frame is x forward, y left, z up. Raises LogError for a missing file or one that ends within
    a record.
    """
    data = log.read_bytes(Path(path), nclt.RECORD_BYTES, "hits")
    return np.asarray(nclt.decode(np.frombuffer(data, "<u2"), lift_m))


def read_poses(path: str | Path, max_gap_s: float = 0.5) -> Trajectory:
    """Read ground truth or odometry: poses of the z-up body in the z-up world.

    Rows with NaN stay as gaps. Raises LogError naming the row that is not seven numbers or whose
    stamp does not increase.
    """
    path = Path(path)
    rows = log.read_table(path, 7, ",")
    stamps_ns = log.to_nanoseconds(path, rows[:, 0], "µs", 1000)
    is_finite = np.isfinite(rows).all(axis=1)
    xyz_m = rows[is_finite, 1:4]
    angles_rad = rows[is_finite, 4:7]
    world_T_body = np.full((len(rows), 4, 4), np.nan)
    world_T_body[is_finite] = flip_ned(pose(xyz_m, angles_rad))
    return Trajectory(stamps_ns, world_T_body, max_gap_s)


def read_uncertainty(path: str | Path) -> Uncertainty:
    """Read odometry_cov.csv, whose rows hold the covariance of the motion since the row before.

    The errors of the motions are taken as independent, so their variances add up; rows that hold a
    NaN add nothing. Raises LogError naming the row that is not 22 numbers or whose stamp does not
    increase.
    """
    path = Path(path)
    rows = log.read_table(path, nclt.COVARIANCE_COLUMNS, ",")
    rows = rows[np.isfinite(rows).all(axis=1)]
    x_m2, y_m2, heading_rad2 = rows[:, nclt.VARIANCE_COLUMNS].T
    position_m2 = (x_m2 + y_m2) / 2  # one variance for both axes
    motion_variance = np.column_stack([position_m2, heading_rad2])
    stamps_ns = log.to_nanoseconds(path, rows[:, 0], "µs", 1000)
    return Uncertainty(stamps_ns, np.cumsum(motion_variance, axis=0))


@dataclass(frozen=True)
class Packets:
    """The packets of a velodyne_hits.bin.

    Their hits are raw: in the frame of the sensor, and not motion compensated.
    """

    words: NDArray[np.uint16]
    """The file as 16-bit words, mapped from disk: it may have gigabytes."""
    starts: NDArray[np.int64]
    """(packet,) index of the first word of each packet."""
    offsets: NDArray[np.int64]
    """(packet + 1,) packet i has the hits offsets[i]:offsets[i + 1]."""
    utimes: NDArray[np.int64]
    """(packet,) microseconds since 1970."""

    def hits(self, packet: int) -> NDArray[np.uint16]:
        """The hits (n, 4) of one packet as 16-bit words.

        The columns are x, y, z as `formats.nclt` encodes them, then intensity and laser together.
        """
        start = self.starts[packet] + HEADER_WORDS
        count = self.offsets[packet + 1] - self.offsets[packet]
        return self.words[start : start + HIT_WORDS * count].reshape(-1, HIT_WORDS)


def read_packets(path: Path) -> Packets:
    """Find the packets of a velodyne_hits.bin.

    Raises LogError for an empty file, or naming the byte of a broken packet.
    """
    nbytes = path.stat().st_size
    if not nbytes:
        raise LogError(f"{path}: empty; expected Velodyne packets: fetch the file again")
    whole_words_bytes = nbytes // 2 * 2  # without an odd last byte
    words = np.memmap(path, np.uint8, "r")[:whole_words_bytes].view("<u2")
    starts, offsets, end = _find_packets(words)
    if 2 * end != nbytes:
        raise LogError(
            f"{path}: no whole packet at byte {2 * end}; the file is damaged or cut short: fetch "
            "it again"
        )
    utime_words = UTIME_WORD + np.arange(UTIME_WORDS)
    utimes = words[starts[:, None] + utime_words].view("<u8")[:, 0]
    if (utimes >= LATEST_NS // 1000).any():
        raise LogError(
            f"{path}: a packet is stamped {utimes.max()}, which is no time in µs; the file is "
            "damaged"
        )
    return Packets(words, starts, offsets, utimes.astype(np.int64))


@njit(cache=True, nogil=True)
def _find_packets(
    words: NDArray[np.uint16],
) -> tuple[NDArray[np.int64], NDArray[np.int64], np.int64]:
    """Find the packets in a file's words.

    Returns the index of the first word (packet,) and the number of the first hit (packet + 1,) of
    each packet, and the index of the word after the last whole packet. A packet is a header (see
    HEADER_WORDS), followed by HIT_WORDS for each hit.
    """
    starts = np.empty(len(words) // HEADER_WORDS + 1, np.int64)
    offsets = np.empty(len(words) // HEADER_WORDS + 1, np.int64)
    packet_count = np.int64(0)
    start = np.int64(0)
    offsets[0] = 0
    while start + HEADER_WORDS <= len(words):
        has_magic = True
        for word in range(MAGIC_WORDS):
            has_magic &= words[start + word] == nclt.PACKET_MAGIC
        low_word = np.int64(words[start + COUNT_WORD])
        high_word = np.int64(words[start + COUNT_WORD + 1])
        hit_count = low_word + (high_word << 16)
        next_start = start + HEADER_WORDS + HIT_WORDS * hit_count
        if not has_magic or next_start > len(words):
            break
        starts[packet_count] = start
        offsets[packet_count + 1] = offsets[packet_count] + hit_count
        packet_count += 1
        start = next_start
    return starts[:packet_count].copy(), offsets[: packet_count + 1].copy(), start
