"""The Log, which every reader returns, and the functions that the readers share.

A Log holds the scans of one drive with their stamps and poses, in the same frames for all data
sets, so the stages after the readers know no data set. The functions read tables and records of
bytes, check stamps and poses, and join scans with poses.
"""

import os
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import LATEST_NS, ROUNDED_NS, Poses, Stamps, Trajectory, pose
from pipeline.readers import vehicle

READERS = ("pipeline.readers.",)
"""The modules whose classes a yaml or a site may name as a reader: the roots for `build`."""
EARTH_M = 1e8
"""Positions further than this from the origin of their frame are damage: the centre of the Earth is
6.4e6 m away."""


@dataclass(frozen=True)
class Log:
    """An opened log: its scans, or the sweeps of its 2-D LiDAR, one a row.

    Vehicle and world frames are x forward, y left, z up, with the ground at z = 0. Only a log whose
    sweeps will be accumulated has its ground elsewhere in the vehicle frame: the submaps estimate
    it later. Each row has at least one of the two poses, unless the log was opened to have its
    poses estimated.
    """

    stamps_ns: Stamps
    """(scan,) strictly increasing."""
    world_T_scan: Poses
    """(scan, 4, 4) true poses at the stamps; NaN where there is none, as in an outage of the INS,
    or in all of a log whose poses are still to be estimated."""
    odom_T_scan: Poses
    """(scan, 4, 4) odometry at the stamps; NaN where there is none, and in the first row after a
    break in the odometry."""
    points: Callable[[int], NDArray[np.floating]]
    """Points (n, 3) in metres of the scan in a row, in the vehicle frame; raises LogError where the
    file is broken."""
    skipped: Counter[str]
    """Number of scans of the log that were left out, by reason."""
    notes: tuple[str, ...] = ()
    """Further lines for the user on how complete the log is."""
    odom_variance: NDArray[np.float64] | None = None
    """(scan, 2) uncertainty that the odometry states of itself, summed up since its start: variance
    of the position in m² (mean of x and y) and of the heading in rad². NaN where it states none;
    None for a log without any."""
    heading_rad: NDArray[np.float64] | None = None
    """(scan,) angle by which the vehicle turned to its left since the start, by a gyroscope. NaN
    where it is unknown and in the first row after a gap; None for a log without a gyroscope."""
    times_s: Callable[[int], NDArray[np.float64] | None] = lambda row: None
    """Seconds (n,) after the stamp at which each of the `points` of a row was measured; None if the
    log has no such times."""

    def poses(self, row: int) -> tuple[NDArray[np.float64], ...]:
        """The true pose, the odometry and, if the log has any, the odometry's variance of a row."""
        poses = (self.world_T_scan[row], self.odom_T_scan[row])
        return poses if self.odom_variance is None else (*poses, self.odom_variance[row])

    def select(self, rows: NDArray[np.int64]) -> Self:
        """A log with only the scans `rows` (m,) of this one.

        The caller has to mark, by NaN, where the odometry breaks because rows are left out.
        """
        return replace(
            self,
            stamps_ns=self.stamps_ns[rows],
            world_T_scan=self.world_T_scan[rows],
            odom_T_scan=self.odom_T_scan[rows],
            points=lambda row: self.points(int(rows[row])),
            odom_variance=None if self.odom_variance is None else self.odom_variance[rows],
            heading_rad=None if self.heading_rad is None else self.heading_rad[rows],
            times_s=lambda row: self.times_s(int(rows[row])),
        )


class Reader(Protocol):
    """A reader of one data set; its fields are the keys of the yaml of the data set."""

    def open(self, root: Path, sequence: str) -> Log:
        """Open a sequence below the root of the data set.

        Raises LogError for a log that cannot be read.
        """

    def sequences(self, root: Path) -> dict[str, list[str]]:
        """The names of the sequences below `root`, each with the files that it lacks.

        A sequence that lacks no file can be read.
        """


@dataclass(frozen=True)
class Uncertainty:
    """The variance of an odometry, summed up since its start, over time."""

    stamps_ns: Stamps
    """(n,) increasing."""
    variance: NDArray[np.float64]
    """(n, 2) of the position in m² (mean of x and y) and of the heading in rad²."""

    def at(self, stamps_ns: Stamps) -> NDArray[np.float64]:
        """Variances (m, 2) at stamps (m,), interpolated linearly; NaN beyond the ends."""
        # np.interp computes in float64, which resolves only 256 ns of a time since 1970
        first_ns = self.stamps_ns[0]
        query_ns = stamps_ns - first_ns
        known_ns = self.stamps_ns - first_ns
        columns = [
            np.interp(query_ns, known_ns, column, left=np.nan, right=np.nan)
            for column in self.variance.T
        ]
        return np.stack(columns, axis=1)


class FileNumbers(NamedTuple):
    """The numbers that name the .bin files of a folder, in increasing order."""

    named: NDArray[np.int64]
    """(n,) of all files that are named by a number."""
    usable: NDArray[np.int64]
    """(k,) of those that hold a whole number of records."""


class PosedRows(NamedTuple):
    """The scans of a log that are used, with their poses."""

    rows: NDArray[np.int64]
    """(k,) index of each used scan among all scans."""
    world_T_scan: Poses
    """(k, 4, 4) true poses; all NaN for a log without them."""
    odom_T_scan: Poses
    """(k, 4, 4) odometry; NaN where there is none, and in the first row after a break."""
    notes: tuple[str, ...]
    """Lines for the user."""


def rows_with_poses(
    where: Path,
    stamps_ns: Stamps,
    ground_truth: Trajectory | None,
    odometry: Trajectory | None,
    skipped: Counter[str],
    question: str,
    scans: str = "scans",
    ground_truth_name: str = "the true poses",
    odometry_name: str = "the odometry",
    keeps_unplaced: bool = False,
) -> PosedRows:
    """Join scans, stamped `stamps_ns` (n,), with the true poses and the odometry of their log.

    Scans without a true pose are left out and counted in `skipped`, but with `keeps_unplaced` not
    those with odometry; if `ground_truth` is None, all scans are used. Raises LogError if no scan
    can be used; the error names `where` and the `scans`, and asks `question` (see
    `refuse_unposed`).
    """
    world_T_scan = np.full((len(stamps_ns), 4, 4), np.nan)
    has_ground_truth = np.ones(len(stamps_ns), bool)
    odom_T_scan = world_T_scan.copy()
    has_odometry = ~has_ground_truth
    notes: tuple[str, ...] = ()
    if ground_truth is not None:
        world_T_scan, has_ground_truth = ground_truth.at(stamps_ns)
        notes += vehicle.describe_faults(ground_truth_name, ground_truth)
    if odometry is not None:
        odometry, break_notes = vehicle.split_at_jumps(odometry_name, odometry)
        odom_T_scan, has_odometry = odometry.at(stamps_ns)
        notes += break_notes
    is_used = has_ground_truth | (has_odometry & keeps_unplaced)
    if ground_truth is not None:
        count_unknown(stamps_ns[~is_used], ground_truth, skipped)
    if odometry is not None:
        # After a break of the odometry, scans are left out until one has a true pose: only that
        # says where they are. That one has NaN as odometry, which marks the break.
        breaks_ns = vehicle.find_breaks(odometry)
        break_counts = np.searchsorted(breaks_ns - ROUNDED_NS, stamps_ns, side="right")
        for break_count in np.unique(break_counts[is_used])[1:]:  # the first chain follows no other
            rows = np.flatnonzero(is_used & (break_counts == break_count))
            unplaced_count = (
                int(has_ground_truth[rows].argmax()) if has_ground_truth[rows].any() else len(rows)
            )
            is_used[rows[:unplaced_count]] = False
            odom_T_scan[rows[unplaced_count : unplaced_count + 1]] = np.nan
            skipped["between a break of the odometry and the next place"] += unplaced_count
    rows = np.flatnonzero(is_used)
    if ground_truth is not None and not len(rows):
        refuse_unposed(where, scans, stamps_ns, ground_truth, skipped=skipped, question=question)
    placeless_count = int((~has_ground_truth[rows]).sum())
    if placeless_count:
        notes += (
            f"{placeless_count:,} of {len(rows):,} sweeps have no place (no pose on "
            f"{ground_truth_name})",
        )
    return PosedRows(rows, world_T_scan[rows], odom_T_scan[rows], notes)


def count_unknown(stamps_ns: Stamps, ground_truth: Trajectory, skipped: Counter[str]) -> None:
    """Count in `skipped` why `ground_truth` has no pose at `stamps_ns` (n,)."""
    is_outside = (stamps_ns < ground_truth.stamps_ns[0]) | (stamps_ns > ground_truth.stamps_ns[-1])
    skipped["outside the poses' span"] += int(is_outside.sum())
    skipped["in a gap of the poses"] += int((~is_outside).sum())


def refuse_unposed(
    where: Path,
    scans: str,
    stamps_ns: Stamps,
    ground_truth: Trajectory,
    skipped: Counter[str],
    question: str,
) -> None:
    """Raise LogError for a log of which no scan, stamped `stamps_ns` (n,), has a true pose.

    The error calls the scans `scans`, and gives the reasons in `skipped` and the time spans of the
    scans and of the poses. If these spans do not overlap, it also asks the user `question`, on the
    clock, the unit or the file.
    """
    reasons = ", ".join(f"{count:,} {reason}" for reason, count in (+skipped).most_common())
    step_s = (
        float(np.median(np.diff(ground_truth.stamps_ns))) / 1e9
        if len(ground_truth.stamps_ns) > 1
        else 0.0
    )
    hint = ""
    if stamps_ns[-1] < ground_truth.stamps_ns[0] or ground_truth.stamps_ns[-1] < stamps_ns[0]:
        hint = f"; {question}"
    elif step_s > ground_truth.max_gap_s:
        hint = (
            f"; poses are usually {step_s:.3g} s apart, more than "
            f"reader.max_gap_s={ground_truth.max_gap_s:g}"
        )
    spans = f"they span {_span(stamps_ns)}, the poses {_span(ground_truth.stamps_ns)}"
    raise LogError(
        f"{where}: none of its {len(stamps_ns)} {scans} has a pose: {reasons}; {spans}{hint}"
    )


def _span(stamps_ns: Stamps) -> str:
    """The first and the last of the stamps (n,), in seconds since 1970, as text."""
    return f"{stamps_ns[0] / 1e9:.3f} … {stamps_ns[-1] / 1e9:.3f} s"


def first_file(root: Path, places: tuple[str, ...], sequence: str) -> Path | None:
    """The first of `places`, patterns with {sequence}, that is a file below `root`, else None."""
    paths = (root / place.format(sequence=sequence) for place in places)
    return next((path for path in paths if path.is_file()), None)


def read_bytes(path: Path, record_bytes: int, records_name: str) -> bytes:
    """The bytes of a file of records.

    Raises LogError if it is missing or does not hold a whole number of records.
    """
    try:
        data = path.read_bytes()
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise LogError(f"{path}: no such file") from None
    if len(data) % record_bytes:
        raise LogError(
            f"{path}: {len(data)} bytes are no whole number of {record_bytes}-byte {records_name}; "
            "the file is cut short"
        )
    return data


def read_table(path: Path, columns: int, delimiter: str | None = None) -> NDArray[np.float64]:
    """The numbers (row, column) of a text file with so many `columns`.

    Raises LogError naming the wrong row.
    """
    try:
        # numpy warns of an empty file, which is refused below
        with path.open(encoding="utf-8") as file, warnings.catch_warnings(action="ignore"):
            rows = np.loadtxt(file, delimiter=delimiter, ndmin=2)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise LogError(f"{path}: no such file") from None
    except ValueError as error:  # UnicodeDecodeError is one
        raise LogError(
            f"{path}: expected {columns} numbers a row; {str(error).splitlines()[0]}"
        ) from None
    if rows.size and rows.shape[1] != columns:
        is_tum = columns == 12 and rows.shape[1] == 8
        hint = (
            "; 8 numbers a row are a TUM trajectory's: reader.poses_format: tum" if is_tum else ""
        )
        raise LogError(f"{path}: expected {columns} numbers a row, found {rows.shape[1]}{hint}")
    if not rows.size:
        raise LogError(f"{path}: holds no rows")
    return rows


def to_nanoseconds(path: Path, stamps: NDArray[np.float64], unit: str, unit_ns: int) -> Stamps:
    """Stamps (n,) in ns from `stamps` (n,) in `unit`, which is `unit_ns` ns.

    Raises LogError naming the first that is no time, or does not increase.
    """
    bad_rows = np.flatnonzero(~(np.abs(stamps) < LATEST_NS / unit_ns))
    if len(bad_rows):
        row = bad_rows[0]
        raise LogError(
            f"{path}: row {row + 1} is stamped {stamps[row]:g}, which is no time in {unit}"
        )
    # whole units and the fraction apart, since float64 cannot hold nanoseconds since 1970
    whole_units = np.floor(stamps)
    fraction_ns = np.rint((stamps - whole_units) * unit_ns).astype(np.int64)
    stamps_ns = whole_units.astype(np.int64) * unit_ns + fraction_ns
    backward_steps = np.flatnonzero(np.diff(stamps_ns) <= 0)
    if len(backward_steps):
        row = backward_steps[0] + 1
        before = stamps[row - 1]
        after = stamps[row]
        raise LogError(
            f"{path}: row {row + 1} is stamped {after:.15g} {unit}, after {before:.15g}; "
            "stamps must increase"
        )
    return np.asarray(stamps_ns)


def refuse_poses(path: Path, poses: Poses, to_check: NDArray[np.bool_]) -> None:
    """Raise LogError naming the first row of `poses` (n, 4, 4) that is not a pose.

    Only rows that are True in `to_check` (n,) are checked; `path` is the file of the poses.
    """
    is_far = ~(np.abs(poses[:, :3, 3]) < EARTH_M).all(axis=1)
    R = np.nan_to_num(poses[:, :3, :3]).clip(-2, 2)  # no number that could overflow below
    deviation = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    is_no_rotation = (deviation > 1e-3) | (np.linalg.det(R) < 0)  # files round their numbers
    for is_wrong, reason in (
        (is_far, "is not finite, or lies nowhere on Earth; positions are in metres"),
        (is_no_rotation, "has no rotation"),
    ):
        rows = np.flatnonzero(is_wrong & to_check)
        if len(rows):
            raise LogError(f"{path}: row {rows[0] + 1} {reason}")


def raised(height_m: float) -> Poses:
    """The pose (4, 4) of a frame that lies `height_m` above its parent."""
    parent_T_raised = np.eye(4)
    parent_T_raised[2, 3] = height_m
    return parent_T_raised


def lifted(world_T_body: Poses, height_m: float) -> Poses:
    """The same poses (n, 4, 4) after the body's and the world's frame were moved `height_m` down.

    Readers move both to the ground, so that it is at z = 0 in either frame.
    """
    return raised(height_m) @ world_T_body @ np.linalg.inv(raised(height_m))


def parse_extrinsic(key: str, xyzrpy: object) -> Poses:
    """The pose (4, 4) of a sensor from x, y, z in metres and roll, pitch, yaw in degrees.

    Raises ConfigError naming the setting `key` if `xyzrpy` is not six numbers.
    """
    numbers = list(xyzrpy) if isinstance(xyzrpy, Sequence) else []
    if len(numbers) != 6 or not all(
        isinstance(number, int | float) and np.isfinite(number) for number in numbers
    ):
        raise ConfigError(
            f"{key}={xyzrpy}: expected [x, y, z, roll, pitch, yaw] in metres and degrees"
        )
    row = np.array([numbers], np.float64)
    return np.asarray(pose(row[:, :3], np.radians(row[:, 3:]))[0])


def is_utime(stem: str) -> bool:
    """Whether a file name without its suffix is a stamp in whole microseconds since 1970."""
    return stem.isascii() and stem.isdecimal() and stem[0] != "0" and int(stem) < LATEST_NS // 1000


def numbered_files(
    folder: Path,
    record_bytes: int,
    is_number: Callable[[str], object],
    reason: str,
    skipped: Counter[str],
) -> FileNumbers:
    """The numbers that name the .bin files of a folder.

    Counts in `skipped` the files whose name fails `is_number` (under `reason`), the empty ones and
    the truncated ones.
    """
    named: list[int] = []
    usable: list[int] = []
    with os.scandir(folder) as entries:
        for entry in entries:
            stem, _, suffix = entry.name.rpartition(".")
            if suffix != "bin":
                continue
            if not is_number(stem):
                skipped[reason] += 1
                continue
            named.append(int(stem))
            length = entry.stat().st_size if entry.is_file() else 0
            if length == 0:
                skipped["empty file"] += 1
            elif length % record_bytes:
                skipped["truncated record"] += 1
            else:
                usable.append(int(stem))
    return FileNumbers(np.array(sorted(named), np.int64), np.array(sorted(usable), np.int64))
