"""Poses and trajectories, with values that are worked out by hand."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.core.frames import (
    Trajectory,
    days_between,
    distance_and_turn,
    flip_ned,
    pose,
    rpy,
    step_lengths_m,
    transformed,
    travelled_m,
    yaw,
)

SECOND = 10**9


def poses(*rows: tuple[float, float, float, float]) -> np.ndarray:
    """Poses of (x, y, z, heading in degrees)."""
    table = np.array(rows, float)
    return pose(table[:, :3], np.column_stack([np.zeros((len(table), 2)), np.deg2rad(table[:, 3])]))


def test_a_heading_of_90_degrees_turns_forward_into_left() -> None:
    # The body stands at (10, 20, 1) and looks along +y: 2 m ahead of it is (10, 22, 1), 1 m to its
    # left (9, 20, 1).
    world_T_body = poses((10, 20, 1, 90))[0]
    points = transformed(world_T_body, np.array([[2, 0, 0], [0, 1, 0]], np.float32))
    np.testing.assert_allclose(points, [[10, 22, 1], [9, 20, 1]], atol=1e-6)
    plane_T_body = world_T_body[[0, 1, 3]][:, [0, 1, 3]]
    for pose_of_plane in (world_T_body, plane_T_body):
        np.testing.assert_allclose(transformed(pose_of_plane, np.array([[2.0, 0]])), [[10, 22]])
        assert yaw(pose_of_plane) == pytest.approx(np.pi / 2)


def test_the_path_is_as_long_as_its_steps_that_count() -> None:
    # 5 m in the plane and 12 m up are 13 m; the steps to and from the unknown place count as 0
    xyz_m = np.array([[0.0, 0, 0], [3, 4, 12], [np.nan, 0, 0], [0, 0, 0], [0, 0, 2]])
    np.testing.assert_allclose(travelled_m(xyz_m), [0, 13, 13, 13, 15])
    np.testing.assert_allclose(travelled_m(xyz_m[:, :2]), [0, 5, 5, 5, 5])
    is_step = np.array([False, True, True, True])
    np.testing.assert_allclose(travelled_m(xyz_m, is_step), [0, 0, 0, 0, 2])
    np.testing.assert_allclose(step_lengths_m(xyz_m), [13, np.nan, np.nan, 2])
    assert travelled_m(xyz_m[:0]).shape == (0,)


def test_the_last_turn_of_a_pose_is_the_heading() -> None:
    # R = Rz(90°) Ry(0) Rx(90°): body z goes to −y by the roll, then to +x by the heading.
    world_T_body = pose(np.zeros((1, 3)), np.array([[np.pi / 2, 0, np.pi / 2]]))
    np.testing.assert_allclose(world_T_body[0, :3, :3] @ [0, 0, 1], [1, 0, 0], atol=1e-12)


def test_roll_pitch_and_yaw_come_back_and_yaw_is_counter_clockwise_from_x() -> None:
    angles = np.array([[0.1, -0.2, 3.0], [-3.0, 1.2, -0.4]])
    np.testing.assert_allclose(rpy(pose(np.zeros((2, 3)), angles)), angles, atol=1e-12)
    np.testing.assert_allclose(
        np.rad2deg(yaw(poses((0, 0, 0, 0), (0, 0, 0, 90), (0, 0, 0, -135)))), [0, 90, -135]
    )


def test_north_east_down_becomes_z_up() -> None:
    # 1 m north, 2 m east, 3 m down, looking east (heading 90° clockwise seen from above): z-up (1,
    # −2, −3), looking along −y.
    z_up = flip_ned(poses((1, 2, 3, 90)))
    np.testing.assert_allclose(z_up[0, :3, 3], [1, -2, -3])
    assert np.rad2deg(yaw(z_up))[0] == pytest.approx(-90)
    poses_ned = pose(np.array([[1.0, -2, 3]]), np.array([[0.3, -0.2, 2.0]]))
    np.testing.assert_allclose(flip_ned(flip_ned(poses_ned)), poses_ned, atol=1e-15)  # and back


def test_a_pose_halfway_is_halfway_in_place_and_turn() -> None:
    # From 170° to −170° is 20° through 180°, not 340° through 0.
    path = Trajectory(np.array([0, SECOND]), poses((0, 0, 0, 170), (2, 4, -6, -170)), max_gap_s=1.0)
    world_T_body, known = path.at(np.array([SECOND // 2, SECOND // 4]))
    assert known.all()
    np.testing.assert_allclose(world_T_body[:, :3, 3], [[1, 2, -3], [0.5, 1, -1.5]])
    np.testing.assert_allclose(np.abs(np.rad2deg(yaw(world_T_body))), [180, 175])


def test_slerp_turns_about_one_axis_at_constant_speed() -> None:
    # Rolled by 90° at the end, 30° after a third of the time.
    ends = pose(np.zeros((2, 3)), np.array([[0, 0, 0], [np.pi / 2, 0, 0]]))
    world_T_body, _ = Trajectory(np.array([0, 3 * SECOND]), ends, 5.0).at(np.array([SECOND]))
    np.testing.assert_allclose(np.rad2deg(rpy(world_T_body)), [[30, 0, 0]], atol=1e-9)


@pytest.mark.parametrize("stamp", [-1_001, 3 * SECOND + 1_001, 10**18, -(10**18)])
def test_there_is_no_pose_beyond_the_ends(stamp: int) -> None:
    path = Trajectory(
        np.array([0, SECOND, 2 * SECOND, 3 * SECOND]), poses(*[(i, 0, 0, 0) for i in range(4)]), 1.0
    )
    world_T_body, known = path.at(np.array([stamp]))
    assert not known.any()
    assert np.isnan(world_T_body).all()


@pytest.mark.parametrize("off_ns", [-1_000, -456, 456, 1_000])
def test_a_pose_whose_stamp_was_rounded_to_a_microsecond_is_a_pose(off_ns: int) -> None:
    """At the ends and beside a gap too, where nothing can be interpolated."""
    path = Trajectory(np.array([0, 10 * SECOND]), poses((0, 0, 0, 0), (5, 0, 0, 0)), 1.0)
    world_T_body, known = path.at(np.array([0, 10 * SECOND]) + off_ns)
    assert known.all()
    assert world_T_body[:, 0, 3].tolist() == [0, 5]


def test_gaps_are_never_bridged() -> None:
    # Rows at 0, 1, 2 (NaN), 3, 5.5 s; a gap is more than 1 s, so 0.5 s lies in none.
    table = poses(*[(x, 0, 0, 0) for x in (0, 1, 2, 3, 5.5)])
    table[2, 0, 3] = np.nan
    path = Trajectory(np.array([0, 1, 2, 3, 5.5]) * SECOND, table, 1.0)
    asked = np.array([0, 0.5, 1, 1.5, 2, 2.5, 3, 4, 5.5])
    world_T_body, known = path.at((asked * SECOND).astype(np.int64))
    assert known.tolist() == [True, True, True, False, False, False, True, False, True]
    np.testing.assert_allclose(world_T_body[known, 0, 3], asked[known])


def test_a_trajectory_without_rows_knows_nothing() -> None:
    assert (
        not Trajectory(np.empty(0, np.int64), np.empty((0, 4, 4)), 1.0)
        .at(np.array([0, 1]))[1]
        .any()
    )


@pytest.mark.parametrize("stamps", [[0, 0], [1, 0], [0]])
def test_a_trajectory_needs_an_increasing_stamp_for_each_pose(stamps: list[int]) -> None:
    with pytest.raises(InputError):
        Trajectory(np.array(stamps), poses((0, 0, 0, 0), (1, 0, 0, 0)), 1.0)


def test_days_are_counted_on_the_calendar() -> None:
    # 2012-01-08 23:59:59 to 2012-01-15 00:00:01 UTC is 6 days and 2 seconds, and a week on the
    # calendar.
    start = 1326067199 * SECOND
    end = 1326585601 * SECOND
    spans = ((start, end), (end, start), (start, start))
    assert [days_between(*span) for span in spans] == [7, -7, 0]


def test_a_turn_from_a_missing_pose_is_nan_of_one_sign() -> None:
    missing = np.full((1, 4, 4), np.nan)
    _, turns_deg = distance_and_turn(missing, np.eye(4)[None])
    assert np.isnan(turns_deg).all()
    assert not np.signbit(turns_deg).any()  # arccos(NaN) has the sign that a processor chooses
