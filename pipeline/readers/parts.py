"""Parts of a log: one long log with revisits becomes a day to train on and days to test on.

Sequences of a log NAME: NAME+path1of2 is its first half by path, NAME+time2of3 its second third by
time, NAME+until440m what comes before 440 m of path (or 440s) and NAME+from440m the rest,
NAME+first the scans at places where the log has not been before and NAME+later those where it has.
+60s at the end keeps so much time between parts.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core.errors import ConfigError, LogError
from pipeline.readers.log import Log, Reader

SHARE = r"(?P<by>path|time)(?P<number>[1-9]\d?)of(?P<of>[1-9]\d?)"
CUT = r"(?P<side>until|from)(?P<at>\d{1,9})(?P<unit>[ms])"
NAME = re.compile(
    rf"(?P<log>.+?)\+(?:{SHARE}|{CUT}|(?P<visit>first|later))(?:\+(?P<apart>\d{{1,6}})s)?"
)
RULE = re.compile(
    r"(?:(?P<by>path|time):(?P<of>[2-9]|[1-9]\d)|cut:(?P<at>\d{1,9}[ms])|visits)"
    r"(?::(?P<apart>\d{1,6}))?"
)
APART_S = 30
"""After it a robot at walking pace sees little of what it saw before; a car sooner."""
NEAR_M = 5.0
"""A place within this distance of an earlier one is visited again."""


@dataclass(frozen=True)
class Part:
    """A part of a log: by path, by time, or by first and later visits."""

    by: str
    """path, time, first or later."""
    number: int = 1
    """Of `of` parts, from 1."""
    of: int = 2
    at: float | None = None
    """Metres or seconds where the second of two parts begins; None: parts are equally long."""
    apart_s: int = APART_S
    """Scans nearer in time than this to those of an earlier part, or of first visits, are left out.

    Both would show the same.
    """

    @classmethod
    def named(cls, sequence: str) -> tuple[str, Self | None]:
        """The name of the log that a sequence belongs to, and its part; None for the whole log.

        Raises ConfigError for a part whose number is larger than the number of parts.
        """
        match = NAME.fullmatch(sequence)
        if match is None:
            return sequence, None
        apart_s = int(match["apart"] or APART_S)
        if match["side"]:
            side = 1 if match["side"] == "until" else 2
            part = cls(
                "path" if match["unit"] == "m" else "time",
                side,
                at=float(match["at"]),
                apart_s=apart_s,
            )
        else:
            part = cls(
                match["visit"] or match["by"],
                int(match["number"] or 1),
                int(match["of"] or 2),
                apart_s=apart_s,
            )
        if part.number > part.of:
            raise ConfigError(
                f"sequence={sequence}: part {part.number} of {part.of}; expected 1 to {part.of}"
            )
        return match["log"], part

    @property
    def needs_path(self) -> bool:
        """Whether poses tell which scans it holds."""
        return self.by != "time"

    def rows(self, stamps_ns: NDArray[np.int64], xyz_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """The rows of this part of a log with these stamps (n,) and positions (n, 3).

        Positions are NaN where unknown.
        """
        apart_ns = self.apart_s * 10**9
        if self.by in ("first", "later"):
            is_revisit = revisited(stamps_ns, xyz_m, apart_ns)
            return np.flatnonzero(
                is_revisit & _away(stamps_ns, ~is_revisit, apart_ns)
                if self.by == "later"
                else ~is_revisit
            )
        progress = (stamps_ns - stamps_ns[0]) / 1e9 if self.by == "time" else _path_m(xyz_m)
        ends = (
            progress[-1] * np.arange(1, self.of) / self.of
            if self.at is None
            else np.array([self.at])
        )
        part = 1 + np.searchsorted(ends, progress, side="right")
        return np.flatnonzero(
            (part == self.number) & _away(stamps_ns, part < self.number, apart_ns)
        )


def names(log: str, rule: str) -> list[str]:
    """The names of the sequences that a rule makes of a log.

    path:2 and time:3 make equal parts, cut:440m and cut:400s two, visits the first and the later
    visits. A number at the end, as in path:2:60, is the time in seconds between parts. Raises
    ConfigError for another rule.
    """
    match = RULE.fullmatch(rule)
    if match is None:
        rules = "path:2, time:3, cut:440m, cut:400s or visits"
        raise ConfigError(
            f"parts={rule}: expected {rules}, and seconds between parts after another colon"
        )
    endings = ["first", "later"]
    if match["by"]:
        endings = [
            f"{match['by']}{number + 1}of{match['of']}" for number in range(int(match["of"]))
        ]
    elif match["at"]:
        endings = [f"until{match['at']}", f"from{match['at']}"]
    return [
        f"{log}+{ending}" + (f"+{match['apart']}s" if match["apart"] else "") for ending in endings
    ]


def open_part(reader: Reader, root: Path, sequence: str) -> Log:
    """Open a log, or the part of it that the sequence's name ends in.

    The odometry breaks where the part does. Raises LogError for a log that cannot be read, or a
    part without scans.
    """
    name, part = Part.named(sequence)
    log = reader.open(root, name)
    if part is None:
        return log
    rows = part.rows(log.stamps_ns, log.world_T_scan[:, :3, 3])
    if not len(rows):
        raise LogError(
            f"{root / name}: no scan is in its part {sequence[len(name) + 1 :]}; the log has "
            f"{len(log.stamps_ns)}"
        )
    odom_T_scan = log.odom_T_scan[rows]
    odom_T_scan[1:][np.diff(rows) > 1] = np.nan
    notes = (*log.notes, f"{len(rows)} of the {len(log.stamps_ns)} scans of {name}")
    return replace(log.of(rows), odom_T_scan=odom_T_scan, notes=notes)


def revisited(
    stamps_ns: NDArray[np.int64], xyz_m: NDArray[np.float64], apart_ns: int
) -> NDArray[np.bool_]:
    """Which rows (n,) lie within NEAR_M of a row more than `apart_ns` earlier."""
    is_revisit = np.zeros(len(stamps_ns), bool)
    posed_rows = np.flatnonzero(np.isfinite(xyz_m).all(axis=1))
    near = KDTree(xyz_m[posed_rows]).query_ball_point(xyz_m[posed_rows], NEAR_M)
    is_revisit[posed_rows] = [
        stamps_ns[posed_rows[rows]].min() < stamps_ns[row] - apart_ns
        for row, rows in zip(posed_rows, near, strict=True)
    ]
    return is_revisit


def _away(
    stamps_ns: NDArray[np.int64], other_rows: NDArray[np.bool_], apart_ns: int
) -> NDArray[np.bool_]:
    """Which rows (n,) are at least `apart_ns` before or after each of the `other_rows` (n,)."""
    is_away = np.ones(len(stamps_ns), bool)
    if other_rows.any():
        other_stamps_ns = stamps_ns[other_rows]
        after = np.searchsorted(other_stamps_ns, stamps_ns)
        is_away &= (after == len(other_stamps_ns)) | (
            other_stamps_ns[np.minimum(after, len(other_stamps_ns) - 1)] - stamps_ns >= apart_ns
        )
        is_away &= (after == 0) | (
            stamps_ns - other_stamps_ns[np.maximum(after - 1, 0)] >= apart_ns
        )
    return is_away


def _path_m(xyz_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Metres of path (n,) driven until each row."""
    steps_m = np.linalg.norm(np.diff(xyz_m, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(steps_m), steps_m, 0.0))])
