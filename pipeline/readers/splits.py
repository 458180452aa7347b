"""Opens a split of a log as a sequence.

So one long log that returns to its places serves as a day to train on and as days to test on. The
splits of a log NAME are named:

    NAME+path1of2      its first half by path
    NAME+time2of3      its second third by time
    NAME+until440m     what comes before 440 m of path (440s: before 440 s)
    NAME+from440m      what comes after that
    NAME+first         the scans at places where the log has not been before
    NAME+later         the scans at places where it has been before

With +60s at the end, scans within 60 s of an earlier split are left out.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import travelled_m
from pipeline.readers.log import Log, Reader

SHARE = r"(?P<by>path|time)(?P<number>[1-9]\d?)of(?P<of>[1-9]\d?)"
CUT = r"(?P<side>until|from)(?P<at>\d{1,9})(?P<unit>[ms])"
NAME = re.compile(
    rf"(?P<log>.+?)\+(?:{SHARE}|{CUT}|(?P<visit>first|later))(?:\+(?P<apart>\d{{1,6}})s)?"
)
"""The name of a split."""
RULE = re.compile(
    r"(?:(?P<by>path|time):(?P<of>[2-9]|[1-9]\d)|cut:(?P<at>\d{1,9}[ms])|visits)"
    r"(?::(?P<apart>\d{1,6}))?"
)
"""A rule that makes splits of a log: path:2, time:3, cut:440m, cut:400s or visits, and perhaps the
seconds between splits after another colon."""
APART_S = 30
"""After so many seconds a robot at walking pace sees little of what it saw before; a car sooner."""
NEAR_M = 5.0
"""A scan within this distance of an earlier one is at the same place."""


@dataclass(frozen=True)
class Split:
    """A split of a log: by path, by time, or by first and later visits."""

    by: str
    """path, time, first or later."""
    number: int = 1
    """The number of the split among `of` splits, from 1."""
    of: int = 2
    """The number of splits."""
    at: float | None = None
    """Metres or seconds at which the second of two splits begins; None: splits are equally long."""
    apart_s: int = APART_S
    """Scans nearer in time than this to an earlier split, or to a first visit, are left out, since
    they would show what training has just seen."""

    @classmethod
    def named(cls, sequence: str) -> tuple[str, Self | None]:
        """The name of the log that a sequence belongs to, and its split; None for the whole log.

        Raises ConfigError for a split whose number is larger than the number of splits.
        """
        match = NAME.fullmatch(sequence)
        if match is None:
            return sequence, None
        apart_s = int(match["apart"] or APART_S)
        if match["side"]:
            by = "path" if match["unit"] == "m" else "time"
            number = 1 if match["side"] == "until" else 2
            split = cls(by, number, at=float(match["at"]), apart_s=apart_s)
        elif match["visit"]:
            split = cls(match["visit"], apart_s=apart_s)
        else:
            split = cls(match["by"], int(match["number"]), int(match["of"]), apart_s=apart_s)
        if split.number > split.of:
            raise ConfigError(
                f"sequence={sequence}: split {split.number} of {split.of}; expected 1 to {split.of}"
            )
        return match["log"], split

    @property
    def needs_path(self) -> bool:
        """Whether the poses of a log are needed to find the scans of this split."""
        return self.by != "time"

    def rows(self, stamps_ns: NDArray[np.int64], xyz_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """The rows (k,) of this split, of a log with these stamps (n,) and positions (n, 3).

        Positions are NaN where unknown.
        """
        apart_ns = self.apart_s * 10**9
        if self.by in ("first", "later"):
            is_revisit = revisited(stamps_ns, xyz_m, apart_ns)
            if self.by == "first":
                return np.flatnonzero(~is_revisit)
            return np.flatnonzero(is_revisit & _is_apart(stamps_ns, ~is_revisit, apart_ns))
        progress = (stamps_ns - stamps_ns[0]) / 1e9 if self.by == "time" else travelled_m(xyz_m)
        if self.at is None:
            ends = progress[-1] * np.arange(1, self.of) / self.of  # of all splits but the last
        else:
            ends = np.array([self.at])
        split_numbers = 1 + np.searchsorted(ends, progress, side="right")
        is_apart = _is_apart(stamps_ns, split_numbers < self.number, apart_ns)
        return np.flatnonzero((split_numbers == self.number) & is_apart)


def names(log: str, rule: str) -> list[str]:
    """The names of the sequences into which a rule divides a log.

    path:2 and time:3 make two or three equal splits; cut:440m and cut:400s make two splits; visits
    makes the first and the later visits. A number at the end, as in path:2:60, is the time in
    seconds between splits. Raises ConfigError for another rule.
    """
    match = RULE.fullmatch(rule)
    if match is None:
        rules = "path:2, time:3, cut:440m, cut:400s or visits"
        raise ConfigError(
            f"split={rule}: expected {rules}, and seconds between splits after another colon"
        )
    if match["by"]:
        count = int(match["of"])
        endings = [f"{match['by']}{number}of{count}" for number in range(1, count + 1)]
    elif match["at"]:
        endings = [f"until{match['at']}", f"from{match['at']}"]
    else:
        endings = ["first", "later"]
    gap_ending = f"+{match['apart']}s" if match["apart"] else ""
    return [f"{log}+{ending}{gap_ending}" for ending in endings]


def open_split(reader: Reader, root: Path, sequence: str) -> Log:
    """Open a sequence: a log, or the split of a log that the name of the sequence ends in.

    Where scans are left out, the odometry breaks. Raises LogError for a log that cannot be read, or
    a split without scans.
    """
    name, split = Split.named(sequence)
    log = reader.open(root, name)
    if split is None:
        return log
    rows = split.rows(log.stamps_ns, log.world_T_scan[:, :3, 3])
    if not len(rows):
        raise LogError(
            f"{root / name}: no scan is in its split {sequence[len(name) + 1 :]}; the log has "
            f"{len(log.stamps_ns)}"
        )
    odom_T_scan = log.odom_T_scan[rows]
    odom_T_scan[1:][np.diff(rows) > 1] = np.nan
    notes = (*log.notes, f"{len(rows)} of the {len(log.stamps_ns)} scans of {name}")
    return replace(log.select(rows), odom_T_scan=odom_T_scan, notes=notes)


def revisited(
    stamps_ns: NDArray[np.int64], xyz_m: NDArray[np.float64], apart_ns: int
) -> NDArray[np.bool_]:
    """True (n,) where a row lies within NEAR_M of a row more than `apart_ns` earlier."""
    is_revisit = np.zeros(len(stamps_ns), bool)
    posed_rows = np.flatnonzero(np.isfinite(xyz_m).all(axis=1))
    places_m = xyz_m[posed_rows]
    neighbours = KDTree(places_m).query_ball_point(places_m, NEAR_M)
    for row, near_rows in zip(posed_rows, neighbours, strict=True):
        earliest_ns = stamps_ns[posed_rows[near_rows]].min()  # at the latest that of the row itself
        is_revisit[row] = earliest_ns < stamps_ns[row] - apart_ns
    return is_revisit


def _is_apart(
    stamps_ns: NDArray[np.int64], is_other: NDArray[np.bool_], apart_ns: int
) -> NDArray[np.bool_]:
    """True (n,) where a row is at least `apart_ns` in time from all rows of `is_other` (n,)."""
    if not is_other.any():
        return np.ones(len(stamps_ns), bool)
    other_ns = stamps_ns[is_other]
    next_other = np.searchsorted(other_ns, stamps_ns)
    has_next = next_other < len(other_ns)
    has_previous = next_other > 0
    # where there is no such row, the index is clipped, and the time that it gives is not used
    to_next_ns = other_ns[np.minimum(next_other, len(other_ns) - 1)] - stamps_ns
    since_previous_ns = stamps_ns - other_ns[np.maximum(next_other - 1, 0)]
    is_before_next = ~has_next | (to_next_ns >= apart_ns)
    is_after_previous = ~has_previous | (since_previous_ns >= apart_ns)
    return is_before_next & is_after_previous
