"""Takes a log in: the scans of a reader's log in; the columns of a scans artifact out.

Points become 16-bit whole numbers of a grain, such as 5 mm. Scans that cannot be read, or that a
thinning leaves out, are missing in the artifact and counted.
"""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError, LogError
from pipeline.core.progress import Progress
from pipeline.mapping.submaps import sample_path
from pipeline.readers.log import Log

BLOCK = 32
"""Scans that a worker reads at once."""
LARGEST = 32_767
"""Of a 16-bit coordinate, in grains."""


class Block(NamedTuple):
    """Some scans as they are stored, one after the other."""

    points: NDArray[np.int16]
    """(n, 3), in units of the grain."""
    lengths: list[int]
    """Points of each scan."""
    rows: list[int]
    """Row in the log of each scan."""
    unreadable: int
    """Scans that could not be read."""
    clipped: int
    """Points that lie too far away to be stored."""


class Intake:
    """One log on its way into a scans artifact: first all `blocks`, then `poses` and counts."""

    def __init__(self, log: Log, grain_m: float, every_m: float) -> None:
        """`grain_m` is the unit of coordinates; one scan is taken every `every_m` of path, or all.

        All with 0. Raises ConfigError for no grain.
        """
        if not grain_m > 0:
            raise ConfigError(f"grain_m={grain_m}: expected a length above 0")
        self._log = log
        self._grain_m = grain_m
        self._rows = (
            sample_path(log.world_T_scan[:, :3, 3], every_m)
            if every_m > 0
            else np.arange(len(log.stamps_ns))
        )
        self._kept: list[int] = []
        self._skipped = Counter(log.skipped)
        self._clipped = 0
        self._points = 0

    def blocks(
        self, compute: Compute, progress: Progress
    ) -> Iterator[tuple[NDArray[np.int16], NDArray[np.int64]]]:
        """Points (n, 3) of blocks of scans in units of the grain, with the offsets of their scans.

        An offset is where a scan ends; the first block's also begin with 0. Raises LogError if no
        scan can be read.
        """
        total = -(-len(self._rows) // BLOCK)
        first_offset = [0]
        for block in progress.track(
            compute.rows(self._read, len(self._rows), BLOCK), total, "read"
        ):
            self._kept += block.rows
            self._skipped += Counter({"unreadable scan": block.unreadable})
            self._clipped += block.clipped
            end_offsets = self._points + np.cumsum(block.lengths, dtype=np.int64)
            self._points += len(block.points)
            yield block.points, np.concatenate([np.array(first_offset, np.int64), end_offsets])
            first_offset = []
        if not self._kept:
            raise LogError(
                "no scan of this sequence can be read with a known pose; `yearloc inspect` of its "
                "folder says why"
            )

    def poses(self) -> dict[str, NDArray[np.generic]]:
        """The other columns of the readable scans: stamps, poses, and the variance of odometry."""
        rows = np.array(self._kept, np.int64)
        odom_variance = (
            np.full((len(rows), 2), np.nan)
            if self._log.odom_variance is None
            else self._log.odom_variance[rows]
        )
        return {
            "stamps_ns": self._log.stamps_ns[rows],
            "world_T_scan": self._log.world_T_scan[rows],
            "odom_T_scan": self._odometry(rows),
            "odom_variance": odom_variance,
        }

    def _odometry(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Odometry (n, 4, 4) of some rows of the log, NaN where it breaks.

        A scan without odometry marks a break. If it is left out, the next one that is kept marks it
        in its place: nobody may measure a step over the break.
        """
        odom_T_scan = self._log.odom_T_scan[rows]
        is_break = ~np.isfinite(self._log.odom_T_scan).all(axis=(1, 2))
        breaks_before = np.concatenate([[0], np.cumsum(is_break)])  # (row of the log,)
        first_new_rows = np.concatenate([[0], rows[:-1] + 1])
        odom_T_scan[breaks_before[rows] > breaks_before[first_new_rows]] = np.nan
        return odom_T_scan

    def skipped(self) -> dict[str, int]:
        """Scans left out: reason to count."""
        return dict(sorted(self._skipped.items()))

    def clipped(self) -> int:
        """Points beyond the 16-bit range, dropped."""
        return self._clipped

    def summary(self) -> str:
        """Scans, points and what was left out, as one line."""
        parts = [f"{len(self._kept)} scans", f"{self._points / 1e6:.1f} M points"]
        parts += [f"{count} skipped ({reason})" for reason, count in self.skipped().items()]
        if self._clipped:
            parts.append(f"{self._clipped} points beyond {LARGEST * self._grain_m:.0f} m dropped")
        return ", ".join(parts)

    def _read(self, start: int, stop: int) -> Block:
        """Read some scans as they are stored.

        Workers send 16-bit numbers, a quarter of what they read.
        """
        points = [np.empty((0, 3), np.int16)]
        rows = []
        clipped = 0
        for row in self._rows[start:stop].tolist():
            try:
                units = np.rint(self._log.points(row) / self._grain_m)
            except LogError:
                continue
            if not np.abs(units).max(initial=0) <= LARGEST:  # NaN is not either
                inside = (np.abs(units) <= LARGEST).all(axis=1)
                clipped += int((~inside).sum())
                units = units[inside]
            rows.append(row)
            points.append(units.astype(np.int16))
        return Block(
            np.concatenate(points),
            [len(scan) for scan in points[1:]],
            rows,
            stop - start - len(rows),
            clipped,
        )
