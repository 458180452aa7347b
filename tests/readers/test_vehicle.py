"""Tests the checks of a vehicle's poses, and the gaps that odometry gets where it was set back."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.frames import Trajectory, pose
from pipeline.formats.bag import BagWriter
from pipeline.readers.bag import Bag
from pipeline.readers.folder import Folder
from pipeline.readers.log import Log
from pipeline.readers.vehicle import describe_faults, find_breaks, find_jumps, split_at_jumps
from tests.readers.bags import START_NS, STEP_NS, at, cloud
from tests.readers.logs import START, folder_log

TENTH_NS = 100_000_000


def drive(
    xyz_m: np.ndarray, rpy_deg: tuple[float, float, float] = (0, 0, 0), step_ns: int = TENTH_NS
) -> Trajectory:
    """A trajectory through positions (n, 3), ten a second, with the same attitude throughout."""
    poses = pose(np.asarray(xyz_m, np.float64), np.radians(np.tile(rpy_deg, (len(xyz_m), 1))))
    return Trajectory(step_ns * np.arange(len(xyz_m), dtype=np.int64), poses, 0.5)


def straight(count: int = 100, along: tuple[float, float, float] = (1, 0, 0)) -> np.ndarray:
    """Positions (count, 3) along a line, a metre per tenth of a second."""
    return np.arange(count)[:, None] * np.array(along, np.float64)


# Warnings


@pytest.mark.parametrize(
    ("way", "rpy_deg", "says"),
    [
        ((1, 0, 0), (180, 0, 0), "tilted by up to 180°, where a vehicle stands upright: is the "),
        ((1, 0, 0), (180, 0, 0), "is the quaternion written w first"),
        ((1, 0, 0), (90, 0, 0), "tilted by up to 90°"),
        ((0, 0, 1), (0, 0, 0), "drives along its own z axis: are its axes a camera's"),
        ((0, 1, 0), (0, 0, 0), "drives sideways, along its own y axis"),
        ((0.6, 0, 0.8), (0, -40, 0), "climbs or falls by 53° most of the way"),
    ],
)
def test_what_no_vehicle_does_gives_a_warning(
    way: tuple[float, float, float], rpy_deg: tuple[float, float, float], says: str
) -> None:
    (line,) = describe_faults("/odom", drive(straight(along=way), rpy_deg))
    assert line.startswith("/odom: ")
    assert says in line


def test_a_heading_that_does_not_follow_the_path_gives_a_warning() -> None:
    """A circle of 100 m driven without turning, as where only positions were measured."""
    turn_rad = np.linspace(0, 2 * np.pi, 600)
    circle = drive(100 * np.column_stack([np.cos(turn_rad), np.sin(turn_rad), 0 * turn_rad]))
    (line,) = describe_faults("x", circle)
    assert "heading does not follow its way" in line
    rpy_rad = np.column_stack([0 * turn_rad, 0 * turn_rad, turn_rad + np.pi / 2])
    ahead = pose(circle.world_T_body[:, :3, 3], rpy_rad)
    assert describe_faults("x", Trajectory(circle.stamps_ns, ahead, 0.5)) == ()


def test_positions_in_millimetres_give_a_warning() -> None:
    (line,) = describe_faults("x", drive(1000 * straight()))
    assert line.startswith("x: the body drives at 10,000 m/s most of the way: are its positions in")
    assert line.endswith(" metres, its stamps in order?")


def test_a_vehicle_gives_no_warning() -> None:
    """On a slope of 20 %, pitched and rolled by 10°, driving backwards, standing; and where nothing
    is known."""
    assert describe_faults("x", drive(straight(along=(0.98, 0, 0.2)), (10, -10, 0))) == ()
    assert describe_faults("x", drive(-straight())) == ()
    assert describe_faults("x", drive(np.zeros((50, 3)))) == ()
    assert describe_faults("x", drive(np.full((5, 3), np.nan))) == ()


# Jumps


def test_a_step_far_longer_than_those_around_it_is_a_jump() -> None:
    xyz_m = straight(20)
    xyz_m[11:, 0] -= 11  # set back to 0: 10 m back, where a metre was due
    assert find_jumps(drive(xyz_m)).tolist() == [11]
    (line,) = describe_faults("x", drive(xyz_m))
    assert "jumps once, first at 1.100 s by 10 m and 0° in 0.1 s: no vehicle drives so" in line


def test_a_turn_far_wider_than_those_around_it_is_a_jump() -> None:
    poses = drive(straight(20))
    poses.world_T_body[11:] = poses.world_T_body[11:] @ at(0, np.radians(120))
    assert find_jumps(poses).tolist() == [11]


def test_driving_off_braking_and_gaps_are_no_jumps() -> None:
    """From 0 to 3 m/s in a tenth of a second; a step over a second without poses; a first step of a
    metre after a gap of one."""
    fast = np.concatenate([np.zeros(10), 0.3 * np.arange(1, 11), np.full(10, 3.0)])
    assert not len(find_jumps(drive(np.column_stack([fast, 0 * fast, 0 * fast]))))
    gap = drive(straight(20))
    gap.stamps_ns[10:] += 10**9
    gap.world_T_body[10:, 0, 3] += 50
    assert not len(find_jumps(gap))
    with_gaps = drive(straight(20))
    with_gaps.world_T_body[[9, 11]] = np.nan  # one pose alone between two gaps
    with_gaps.world_T_body[10, 0, 3] += 50
    assert not len(find_jumps(with_gaps))


def test_a_topic_that_repeats_each_pose_does_not_jump() -> None:
    """A hundred poses a second of a robot that is posed ten times a second: nine steps of nothing,
    and one of a metre."""
    assert not len(find_jumps(drive(np.repeat(straight(20), 10, axis=0), step_ns=10**7)))


def test_odometry_that_is_set_back_gets_a_gap_and_a_note() -> None:
    xyz_m = straight(20)
    xyz_m[11:, 0] -= 11
    fixed, notes = split_at_jumps("/odom", drive(xyz_m))
    assert notes == (
        "/odom: jumps once, first at 1.100 s by 10 m and 0° in 0.1 s: the odometry starts again "
        "there",
    )
    known = fixed.at(np.array([100, 105, 110]) * 10**7)[1]
    assert known.tolist() == [True, False, True]
    assert find_breaks(fixed).tolist() == [11 * TENTH_NS]
    assert split_at_jumps("x", drive(straight(20)))[1] == ()


# In the readers


def with_odometry(root: Path, rows: list[str], decimals: list[str]) -> Log:
    """Open a user's sequence with this odometry, and scans at these decimals of its first
    second."""
    point = np.array([2, 1, 3, 0.5], "<f4").tobytes()
    scans = {f"scans/{START // 10**6}.{stem}.bin": point for stem in decimals}
    folder_log(root, scans=scans)
    (root / "drive/odometry.txt").write_text("".join(rows))
    return Folder(odometry="odometry.txt").open(root, "drive")


def test_the_first_scan_after_odometry_was_set_back_has_no_odometry(tmp_path: Path) -> None:
    """Scans every 0.1 s; the odometry is 0 … 5 m, then 0 … 5 m again while the ground truth goes on
    to 11 m."""
    rows = [f"{START / 1e6 + 0.1 * i:.1f} {i if i < 6 else i - 6} 0 0 0 0 0 1\n" for i in range(11)]
    log = with_odometry(tmp_path, rows, [f"{i:02d}5" for i in range(10, 90, 10)])
    # The scans lie 5 ms behind the poses 1 … 8: that behind pose 5 is on the jump, and the one
    # after it is the first of the new.
    assert np.flatnonzero(np.isnan(log.odom_T_scan[:, 0, 0])).tolist() == [4, 5]
    assert any("jumps once" in note for note in log.notes)


def test_a_row_of_nan_is_a_break_though_no_scan_lies_in_it(tmp_path: Path) -> None:
    """As conf/dataset/folder.yaml says: rows of NaN are breaks in the odometry."""
    known = [f"{START / 1e6 + 0.1 * i:.1f} {i} 0 0 0 0 0 1\n" for i in range(11)]
    known[4] = f"{START / 1e6 + 0.4:.1f} nan nan nan nan nan nan nan\n"
    log = with_odometry(tmp_path, known, ["10", "20", "60", "70"])
    assert np.flatnonzero(np.isnan(log.odom_T_scan[:, 0, 0])).tolist() == [2]


def test_odometry_of_a_bag_starts_again_where_it_was_set_back(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "drive", "mcap") as bag:
        bag.static_transform(START_NS, "base_link", "lidar", np.eye(4))
        for i in range(21):
            stamp_ns = START_NS + i * STEP_NS
            bag.odometry(stamp_ns, "map", "base_link", at(0.1 * i), "/ground_truth")
            odom_T_robot = at(0.1 * (i if i <= 10 else i - 11))
            bag.odometry(stamp_ns, "odom", "base_link", odom_T_robot, "/odom")
            cloud(bag, stamp_ns, "lidar", np.ones((5, 3)))
    log = Bag(ground_truth="/ground_truth", odometry="/odom").open(tmp_path, "drive")
    assert np.flatnonzero(np.isnan(log.odom_T_scan[:, 0, 0])).tolist() == [11]
    assert any("/odom: jumps once" in note for note in log.notes)
