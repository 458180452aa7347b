"""Taking a log in: the grain of points, the order of blocks, and what is left out."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError, LogError
from pipeline.core.progress import Progress
from pipeline.mapping.scans import Intake
from pipeline.readers.log import Log


def log(clouds: Sequence[np.ndarray | None], xs: Sequence[float] | None = None) -> Log:
    """A log of a drive along x, with a scan every metre, or at `xs`.

    A cloud that is None cannot be read.
    """
    poses = np.tile(np.eye(4), (len(clouds), 1, 1))
    poses[:, 0, 3] = np.arange(len(clouds)) if xs is None else xs

    def points(row: int) -> np.ndarray:
        cloud = clouds[row]
        if cloud is None:
            raise LogError(f"scan {row} is broken")
        return cloud

    stamps = 1000 * np.arange(1, len(clouds) + 1)
    return Log(stamps, poses, np.full_like(poses, np.nan), points, Counter({"empty file": 2}))


def taken(intake: Intake) -> tuple[np.ndarray, np.ndarray]:
    """The points and the offsets of all blocks."""
    blocks = list(intake.blocks(Compute(workers=2), Progress()))
    return np.concatenate([points for points, _ in blocks]), np.concatenate(
        [offsets for _, offsets in blocks]
    )


def flat(n: int, value_m: float) -> np.ndarray:
    """Points (n, 3) whose coordinates all have one value."""
    return np.full((n, 3), value_m)


def test_points_are_rounded_to_the_grain() -> None:
    # 5 mm: 1 m is 200 units; 7.4 mm is 1.48 units, hence 1; −7.6 mm is −1.52, hence −2.
    points, offsets = taken(Intake(log([np.array([[1, 0.0074, -0.0076]]), flat(2, 0.5)]), 0.005, 0))
    np.testing.assert_array_equal(points, [[200, 1, -2], [100, 100, 100], [100, 100, 100]])
    assert points.dtype == np.int16
    assert offsets.tolist() == [0, 1, 3]


def test_offsets_go_on_from_block_to_block() -> None:
    # 70 scans are three blocks of at most 32; scan i has i % 3 points.
    lengths = [i % 3 for i in range(70)]
    intake = Intake(log([flat(n, i / 10) for i, n in enumerate(lengths)]), 0.005, 0)
    points, offsets = taken(intake)
    assert offsets.tolist() == [0, *np.cumsum(lengths).tolist()]
    np.testing.assert_array_equal(points[:, 0], np.repeat(20 * np.arange(70), lengths))
    assert intake.poses()["stamps_ns"].tolist() == [1000 * i for i in range(1, 71)]


def test_scans_that_cannot_be_read_are_left_out_and_counted() -> None:
    clouds = [None, flat(2, 1.0), None, flat(1, 2.0)] + [None] * 30 + [flat(3, 3.0)]
    intake = Intake(log(clouds), 0.005, 0)
    points, offsets = taken(intake)
    assert offsets.tolist() == [0, 2, 3, 6]
    np.testing.assert_array_equal(points[:, 0], [200, 200, 400, 600, 600, 600])
    assert intake.poses()["stamps_ns"].tolist() == [2000, 4000, 35_000]
    np.testing.assert_array_equal(intake.poses()["world_T_scan"][:, 0, 3], [1, 3, 34])
    assert intake.skipped() == {"empty file": 2, "unreadable scan": 32}
    assert (
        intake.summary()
        == "3 scans, 0.0 M points, 2 skipped (empty file), 32 skipped (unreadable scan)"
    )


def test_a_first_block_that_is_all_broken_still_starts_the_offsets() -> None:
    _, offsets = taken(Intake(log([None] * 32 + [flat(4, 1.0)]), 0.005, 0))
    assert offsets.tolist() == [0, 4]


def test_points_beyond_16_bits_are_dropped_and_counted() -> None:
    # 32767 units of 5 mm are 163.835 m; one unit more is beyond. A point that is no number goes
    # too.
    far = np.array(
        [[163.835, 0, 0], [163.84, 0, 0], [0, -163.84, 0], [0, 0, -163.835], [np.nan, 0, 0]]
    )
    intake = Intake(log([far]), 0.005, 0)
    points, offsets = taken(intake)
    np.testing.assert_array_equal(points, [[32_767, 0, 0], [0, 0, -32_767]])
    assert offsets.tolist() == [0, 2]
    assert intake.clipped() == 3
    assert "3 points beyond 164 m dropped" in intake.summary()


def test_scans_can_be_thinned_along_the_path() -> None:
    # At 0, 0.5, 1, 1.5 and 2 m a sample a metre takes the third and the fifth.
    intake = Intake(log([flat(1, i) for i in range(5)], [0, 0.5, 1, 1.5, 2]), 0.005, 1.0)
    points, _ = taken(intake)
    np.testing.assert_array_equal(points[:, 0], [400, 800])
    assert intake.poses()["stamps_ns"].tolist() == [3000, 5000]


@pytest.mark.parametrize("clouds", [[], [None], [None] * 40])
def test_a_log_without_a_readable_scan_is_refused(clouds: list[None]) -> None:
    with pytest.raises(LogError, match="no scan"):
        taken(Intake(log(clouds), 0.005, 0))


@pytest.mark.parametrize("grain_m", [0.0, -0.005, float("nan")])
def test_a_grain_that_is_no_length_is_a_config_error(grain_m: float) -> None:
    with pytest.raises(ConfigError, match="grain_m"):
        Intake(log([]), grain_m, 0)


def test_a_break_in_the_odometry_outlives_the_scan_that_marked_it() -> None:
    # Scan 2 marks the break and cannot be read; scan 3 marks it now, 1 and 4 keep their odometry.
    drive = log([flat(1, 1.0), flat(1, 1.0), None, flat(1, 1.0), flat(1, 1.0)])
    odometry = drive.world_T_scan.copy()
    odometry[2] = np.nan
    intake = Intake(replace(drive, odom_T_scan=odometry), 0.005, 0)
    taken(intake)
    is_break = np.isnan(intake.poses()["odom_T_scan"]).all(axis=(1, 2))
    assert is_break.tolist() == [False, False, True, False]
