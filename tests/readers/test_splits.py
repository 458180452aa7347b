"""Tests the splits of a log: by path, by time, cut in two, or by visits."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import ConfigError, LogError
from pipeline.readers.log import Log
from pipeline.readers.splits import Split, names, open_split
from tests.readers.damage import one_line

LAP = 100
ANGLES = np.arange(250) * 2 * np.pi / LAP
XYZ_M = np.column_stack([20 * np.cos(ANGLES), 20 * np.sin(ANGLES), np.zeros(250)])
"""Two and a half laps of a circle with a radius of 20 m, 100 scans a lap, one a second."""


class Laps:
    """A reader of one log with a scan a second, whose points hold the number of their scan."""

    def __init__(self, xyz_m: np.ndarray = XYZ_M) -> None:
        """Make a log with scans at these positions (n, 3)."""
        self.xyz_m = xyz_m

    def open(self, root: Path, sequence: str) -> Log:
        count = len(self.xyz_m)
        poses = np.tile(np.eye(4), (count, 1, 1))
        poses[:, :3, 3] = self.xyz_m
        return Log(
            np.arange(count) * 10**9,
            poses,
            poses.copy(),
            lambda row: np.full((1, 3), float(row)),
            Counter(),
            odom_variance=np.full((count, 2), np.arange(float(count))[:, None]),
            times_s=lambda row: np.array([row / 1000]),
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        return {"laps": []}


def split(name: str) -> Log:
    """A split of the log."""
    return open_split(Laps(), Path("root"), f"laps+{name}")


def seconds(name: str) -> list[int]:
    """The stamps of a split in seconds, which are the rows of its scans in the log."""
    return (split(name).stamps_ns // 10**9).tolist()


@pytest.mark.parametrize(
    ("rule", "rows"),
    [
        ("path:2:0", [range(125), range(125, 250)]),
        ("time:5:10", [range(50), *(range(50 * i + 9, 50 * i + 50) for i in range(1, 5))]),
        ("cut:100s", [range(100), range(129, 250)]),
        ("cut:100m:0", [range(80), range(80, 250)]),  # 1.2564 m a second
        # From 97 s on, the scans lie within 5 m of the start. Those until 105 s are left out, since
        # they are less than 10 s after a first visit.
        ("visits:10", [range(97), range(106, 250)]),
    ],
)
def test_a_rule_makes_sequences_and_they_are_splits(rule: str, rows: list[range]) -> None:
    splits = [seconds(name.removeprefix("laps+")) for name in names("laps", rule)]
    assert splits == [list(split) for split in rows]


def test_the_whole_log_is_a_sequence_too() -> None:
    assert len(open_split(Laps(), Path("root"), "laps").stamps_ns) == 250


def test_points_times_and_variances_are_those_of_the_splits_scans() -> None:
    found = split("later+10s")
    assert found.points(0).tolist() == [[106.0] * 3]
    assert found.times_s(0).tolist() == [0.106]
    assert found.odom_variance is not None
    assert found.odom_variance[0].tolist() == [106.0, 106.0]
    assert "144 of the 250 scans of laps" in found.notes
    unplaced_m = np.where(np.arange(250)[:, None] == 200, np.nan, XYZ_M)
    assert 200 not in Split("later", apart_s=10).rows(np.arange(250) * 10**9, unplaced_m)


def test_a_revisit_is_within_5_m_and_later_than_the_time_between_splits() -> None:
    there_and_back = np.column_stack([np.abs(np.arange(-60, 61.0)), np.zeros((121, 2))])
    rows = Split("first", apart_s=5).rows(np.arange(121) * 10**9, there_and_back)
    assert rows.tolist() == list(range(61))  # a revisit is within 5 m, more than 5 s later


def test_the_odometry_breaks_where_scans_are_left_out() -> None:
    # 20 m along x, 10 m back, then 20 m along y, a metre a second. From 22 s (at x = 18, where
    # x = 13 was 9 s before) until 35 s (at y = 5), scans are revisits, so they are left out.
    out = np.column_stack([np.arange(21.0), np.zeros(21)])
    back = np.column_stack([np.arange(19.0, 9, -1), np.zeros(10)])
    aside = np.column_stack([np.full(20, 10.0), np.arange(1.0, 21)])
    xy_m = np.concatenate([out, back, aside])
    reader = Laps(np.column_stack([xy_m, np.zeros(len(xy_m))]))
    log = open_split(reader, Path("root"), "laps+first+8s")
    assert (log.stamps_ns // 10**9).tolist() == [*range(22), *range(36, 51)]
    assert np.flatnonzero(np.isnan(log.odom_T_scan[:, 0, 0])).tolist() == [22]


@pytest.mark.parametrize("rule", ["halves?", "path:1", "path", "time:2:x", "cut:5", "visits:-1"])
def test_another_rule_is_refused(rule: str) -> None:
    with one_line(ConfigError, "expected path:2, time:3, cut:440m, cut:400s or visits"):
        names("laps", rule)


def test_a_split_that_does_not_exist_raises_an_error_of_one_line() -> None:
    with one_line(ConfigError, "split 3 of 2; expected 1 to 2"):
        split("path3of2")
    with one_line(LogError, r"no scan is in its split from900s; the log has 250"):
        split("from900s")
