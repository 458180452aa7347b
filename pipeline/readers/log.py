"""What every reader opens: one drive's scans, each with its stamp and poses, and how many had to be left out."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import LogError
from pipeline.frames import Poses, Stamps, Trajectory


@dataclass(frozen=True)
class Log:
    """An opened log: its scans, or the sweeps of its 2-D LiDAR. Frames: vehicle and world are x forward, y left, z up.

    Ground is at z = 0, but for the vehicle frame of a log whose sweeps are to be accumulated: a submap finds the ground itself.
    Each row has one of the two poses at least.
    """

    stamps_ns: Stamps
    """(scan,) strictly increasing."""
    world_T_scan: Poses
    """(scan, 4, 4) ground truth at the stamps; NaN where there is none, as in an outage of the INS."""
    odom_T_scan: Poses
    """(scan, 4, 4) the log's odometry at the stamps; NaN where it has none, and in the first row after a break in it."""
    points: Callable[[int], NDArray[np.floating]]
    """Points (n, 3) in metres of one scan, in the vehicle frame; raises LogError where the file is broken."""
    skipped: Counter[str]
    """Scans that the log has and this does not: reason to count."""
    notes: tuple[str, ...] = ()
    """What else a person should know of the log's completeness."""


EARTH_M = 1e8
"""No position is as far from its frame's origin: the Earth's centre is 6.4e6 m away."""
LATEST_NS = 2**62
"""Stamps are 64-bit nanoseconds; a later one (after 2116) is damage."""


class Reader(Protocol):
    """A data set's reader: its fields are the keys of its yaml, which declares frames and heights."""

    def open(self, root: Path, sequence: str) -> Log:
        """Open a sequence below the data set's root; raises LogError for what cannot be read."""

    def sequences(self, root: Path) -> dict[str, list[str]]:
        """The sequences found below `root`, each with what it lacks (nothing: it can be read)."""


def located(root: Path, places: tuple[str, ...], sequence: str) -> Path | None:
    """The first of `places` (patterns with {sequence}) that is a file below `root`."""
    paths = (root / place.format(sequence=sequence) for place in places)
    return next((path for path in paths if path.is_file()), None)


def read_bytes(path: Path, record_bytes: int, what: str) -> bytes:
    """A file of records; raises LogError if it is missing or holds no whole number of them."""
    try:
        data = path.read_bytes()
    except (FileNotFoundError, IsADirectoryError):
        raise LogError(f"{path}: no such file") from None
    if len(data) % record_bytes:
        raise LogError(f"{path}: {len(data)} bytes are no whole number of {record_bytes}-byte {what}; the file is cut short")
    return data


def table(path: Path, columns: int, delimiter: str | None = None) -> NDArray[np.float64]:
    """A text file's numbers (rows, columns); raises LogError naming the row that does not fit."""
    try:
        with path.open() as file:
            rows = np.loadtxt(file, delimiter=delimiter, ndmin=2)
    except (FileNotFoundError, IsADirectoryError):
        raise LogError(f"{path}: no such file") from None
    except (ValueError, UnicodeDecodeError, UserWarning) as error:
        raise LogError(f"{path}: expected {columns} numbers a row; {str(error).splitlines()[0]}") from None
    if rows.size and rows.shape[1] != columns:
        raise LogError(f"{path}: expected {columns} numbers a row, found {rows.shape[1]}")
    if not rows.size:
        raise LogError(f"{path}: holds no rows")
    return rows


def nanoseconds(path: Path, stamps: NDArray[np.float64], unit: str, unit_ns: int) -> Stamps:
    """Stamps (n,) given in a unit of so many nanoseconds; raises LogError naming the first that is none or does not increase."""
    late = LATEST_NS / unit_ns
    bad = np.flatnonzero(~(np.abs(stamps) < late))
    if len(bad):
        raise LogError(f"{path}: row {bad[0] + 1} is stamped {stamps[bad[0]]:g}, which is no time in {unit}")
    back = np.flatnonzero(np.diff(stamps) <= 0)
    if len(back):
        before, after = stamps[back[0] : back[0] + 2]
        raise LogError(f"{path}: row {back[0] + 2} is stamped {after:.15g} {unit}, after {before:.15g}; stamps must increase")
    whole = np.floor(stamps)
    return whole.astype(np.int64) * unit_ns + np.rint((stamps - whole) * unit_ns).astype(np.int64)


def refuse_poses(path: Path, poses: Poses, known: NDArray[np.bool_]) -> None:
    """Raise LogError naming the first of the `known` rows of `poses` (n, 4, 4), read from `path`, that no body can have."""
    far = ~(np.abs(poses[:, :3, 3]) < EARTH_M).all(axis=1)
    R = np.nan_to_num(poses[:, :3, :3]).clip(-2, 2)
    skew = (np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2)) > 1e-3) | (np.linalg.det(R) < 0)
    for wrong, why in ((far, "is not finite, or lies nowhere on Earth; positions are in metres"), (skew, "has no rotation")):
        rows = np.flatnonzero(wrong & known)
        if len(rows):
            raise LogError(f"{path}: row {rows[0] + 1} {why}")


def posed(
    stamps_ns: Stamps, truth: Trajectory, odometry: Trajectory | None, skipped: Counter[str]
) -> tuple[NDArray[np.int64], Poses, Poses]:
    """Rows of `stamps_ns` with a known true pose, those poses, and the odometry's there; counts the others in `skipped`."""
    world_T_scan, known = truth.at(stamps_ns)
    outside = (stamps_ns < truth.stamps_ns[0]) | (stamps_ns > truth.stamps_ns[-1])
    skipped.update(
        {"outside the poses' span": int((outside & ~known).sum()), "in a gap of the poses": int((~outside & ~known).sum())}
    )
    rows = np.flatnonzero(known)
    odom_T_scan = np.full((len(rows), 4, 4), np.nan) if odometry is None else odometry.at(stamps_ns[rows])[0]
    return rows, world_T_scan[rows], odom_T_scan
