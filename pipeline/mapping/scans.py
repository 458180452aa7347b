"""Reads a log into scans: a reader's log in, the columns of a scans artifact out.

The scans are thinned along the path if `every_m` is set, read in blocks by several workers, and
stored as 16-bit multiples of a grain, such as 5 mm. Scans that cannot be read, or that the reader
left out, are missing in the artifact; they are counted by reason.
"""

import math
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
"""Number of scans that a worker reads at once."""
MAX_COORDINATE = 32_767
"""Largest 16-bit coordinate, in grains."""


class Block(NamedTuple):
    """Some scans as they are stored, read by one worker."""

    points: NDArray[np.int16]
    """(n, 3) of all scans, one after the other, in units of the grain."""
    lengths: list[int]
    """Number of points of each scan."""
    rows: list[int]
    """Row of each scan in the log."""
    unreadable: int
    """Number of scans that could not be read."""
    clipped: int
    """Number of points too far away to be stored."""


class Intake:
    """Reads one log into the columns of a scans artifact.

    All `blocks` must be read first; then `poses` and the counts are known.
    """

    def __init__(self, log: Log, grain_m: float, every_m: float) -> None:
        """Prepare to read a log, with one scan every `every_m` of path, or all scans if it is 0.

        `grain_m` is the unit of the stored coordinates. Raises ConfigError if it is not positive.
        """
        if not grain_m > 0:
            raise ConfigError(f"grain_m={grain_m}: expected a length above 0")
        self._log = log
        self._grain_m = grain_m
        self._rows = np.arange(len(log.stamps_ns))
        if every_m > 0:
            self._rows = sample_path(log.world_T_scan[:, :3, 3], every_m)
        self._read_rows: list[int] = []
        self._skipped = Counter(log.skipped)
        self._clipped = 0
        self._points = 0

    def blocks(
        self, compute: Compute, progress: Progress
    ) -> Iterator[tuple[NDArray[np.int16], NDArray[np.int64]]]:
        """Yield blocks of scans: their points (n, 3) in units of the grain, and their offsets.

        An offset is the number of points up to the end of a scan; those of the first block begin
        with 0. Raises LogError if no scan can be read.
        """
        n_blocks = math.ceil(len(self._rows) / BLOCK)
        first_offset = [0]  # only in the first block
        for block in progress.track(
            compute.rows(self._read, len(self._rows), BLOCK), n_blocks, "read"
        ):
            self._read_rows += block.rows
            self._skipped += Counter({"unreadable scan": block.unreadable})
            self._clipped += block.clipped
            end_offsets = self._points + np.cumsum(block.lengths, dtype=np.int64)
            self._points += len(block.points)
            yield block.points, np.concatenate([np.array(first_offset, np.int64), end_offsets])
            first_offset = []
        if not self._read_rows:
            raise LogError(
                "no scan of this sequence can be read with a known pose; `yearloc inspect` of its "
                "folder says why"
            )

    def poses(self) -> dict[str, NDArray[np.generic]]:
        """The other columns of the scans that were read: stamps, poses and variances of odometry.

        Variances (scan, 2) are NaN if the log has none.
        """
        rows = np.array(self._read_rows, np.int64)
        odom_variance = np.full((len(rows), 2), np.nan)
        if self._log.odom_variance is not None:
            odom_variance = self._log.odom_variance[rows]
        return {
            "stamps_ns": self._log.stamps_ns[rows],
            "world_T_scan": self._log.world_T_scan[rows],
            "odom_T_scan": self._odometry(rows),
            "odom_variance": odom_variance,
        }

    def _odometry(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Poses by odometry (n, 4, 4) of some rows of the log, NaN at a row where it breaks."""
        odom_T_scan = self._log.odom_T_scan[rows]
        is_break = ~np.isfinite(self._log.odom_T_scan).all(axis=(1, 2))
        breaks_before = np.concatenate([[0], np.cumsum(is_break)])  # (row of the log,)
        # The log has a break between the previous row and this row if more breaks lie before this
        # row than before the first row after the previous one.
        rows_after_previous = np.concatenate([[0], rows[:-1] + 1])
        odom_T_scan[breaks_before[rows] > breaks_before[rows_after_previous]] = np.nan
        return odom_T_scan

    def skipped(self) -> dict[str, int]:
        """For each reason, the number of scans that were left out."""
        return dict(sorted(self._skipped.items()))

    def clipped(self) -> int:
        """Number of points beyond the 16-bit range, which were dropped."""
        return self._clipped

    def summary(self) -> str:
        """One line: the numbers of scans and points, and what was left out."""
        parts = [f"{len(self._read_rows)} scans", f"{self._points / 1e6:.1f} M points"]
        parts += [f"{count} skipped ({reason})" for reason, count in self.skipped().items()]
        if self._clipped:
            parts.append(
                f"{self._clipped} points beyond {MAX_COORDINATE * self._grain_m:.0f} m dropped"
            )
        return ", ".join(parts)

    def _read(self, start: int, stop: int) -> Block:
        """Read rows of the thinned log in a worker; rounded, they are a quarter of the bytes to
        send."""
        points = [np.empty((0, 3), np.int16)]  # so that a block without scans can be joined
        rows = []
        clipped = 0
        for row in self._rows[start:stop].tolist():
            try:
                units = np.rint(self._log.points(row) / self._grain_m)
            except LogError:
                continue
            if not np.abs(units).max(initial=0) <= MAX_COORDINATE:  # also where one is NaN
                is_inside = (np.abs(units) <= MAX_COORDINATE).all(axis=1)
                clipped += int((~is_inside).sum())
                units = units[is_inside]
            rows.append(row)
            points.append(units.astype(np.int16))
        return Block(
            np.concatenate(points),
            lengths=[len(scan) for scan in points[1:]],
            rows=rows,
            unreadable=stop - start - len(rows),
            clipped=clipped,
        )
