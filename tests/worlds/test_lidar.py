"""The scanners: their beams and places on robots, noise and lost returns, and turns on the move."""

from dataclasses import replace

import numpy as np
import pytest

from worlds.driving.lidar import (
    Lidar,
    Returns,
    hdl32,
    hdl32_inverted,
    hdl64,
    lms151,
    measure,
)
from worlds.driving.scene import build_scene
from worlds.layout.ground import Ground
from worlds.layout.shapes import BOX, CROWN, CYLINDER, Kind, records

SEED = np.uint64(9)
RAYS = 20_000
NOTHING = np.zeros(0, BOX)
FLAT = Ground(np.zeros((30, 30)), -120.0, -120.0)


def scan(
    lidar: Lidar, boxes: np.ndarray = NOTHING, world_T_body: np.ndarray | None = None
) -> Returns:
    """One scan of `boxes` on level ground, of a robot at the origin unless its poses are given."""
    scene = build_scene(boxes, np.zeros(0, CYLINDER), np.zeros(0, CROWN), FLAT)
    poses = np.eye(4)[None] if world_T_body is None else world_T_body.reshape(-1, 4, 4)
    return lidar.scan(scene, np.zeros(0, CYLINDER), poses, SEED)


@pytest.mark.parametrize(("range_m", "share"), [(50.0, 0.9394), (100.0, 0.3679), (120.0, 0.1257)])
def test_returns_fade_with_the_fourth_power_of_the_range(range_m: float, share: float):
    # Brightness 0.1 gives rm = 100 m: exp(−0.5⁴) = 0.9394, exp(−1) = 0.3679, exp(−1.2⁴) = 0.1257; 3
    # % drop out besides.
    back = measure(np.full(RAYS, range_m), np.full(RAYS, 0.1), 0.02, 0.03, 100.0, SEED) > 0
    assert back.mean() == pytest.approx(0.97 * share, abs=0.01)


def test_ranges_are_two_centimetres_noisy():
    noise_m = measure(np.full(RAYS, 10.0), np.full(RAYS, 0.4), 0.02, 0.03, 100.0, SEED)
    noise_m = noise_m[noise_m > 0] - 10.0
    assert abs(noise_m.mean()) < 0.001
    assert noise_m.std() == pytest.approx(0.02, rel=0.05)


def test_ground_rings_end_near_thirty_metres():
    returns = scan(hdl32(720))
    reach_m = np.hypot(*returns.points_m[:, :2].T)
    assert 20 < np.percentile(reach_m, 99.5) < 40
    assert abs(np.median(returns.points_m[:, 2]) + 1.3) < 0.02


def test_a_turning_scanner_measures_each_azimuth_from_where_the_robot_is_by_then():
    """At 10 m/s a turn of 0.1 s begins 20 m before a wall, and ends 19 m before it."""
    size = {"half_length_m": 1.0, "half_width_m": 30.0, "top_m": 9.0, "cos_yaw": 1.0}
    wall = records(BOX, x_m=21.0, reflectance=0.4, kind=Kind.BUILDING, **size)
    lidar = replace(hdl32(360), range_sd_m=0.0, drop_out=0.0, turn_s=0.1)
    poses = np.tile(np.eye(4), (360, 1, 1))
    poses[:, 0, 3] = 10.0 * lidar.fired_s
    returns = scan(lidar, wall, poses)
    on_wall = (returns.kind == Kind.BUILDING) & (np.abs(returns.points_m[:, 1]) < 5)
    assert returns.times_s is not None
    times_s = returns.times_s[on_wall]
    assert (times_s.min(), times_s.max()) == pytest.approx((0.0, 0.1 * 359 / 360))
    np.testing.assert_allclose(returns.points_m[on_wall, 0], 20.0 - 10.0 * times_s, atol=1e-6)
    azimuth = np.arctan2(returns.points_m[:, 1], returns.points_m[:, 0]) % (2 * np.pi)
    late = returns.times_s * 2 * np.pi / 0.1
    assert np.abs((azimuth - late + np.pi) % (2 * np.pi) - np.pi).max() < 1e-6


def test_a_tilted_body_sees_level_ground_tilted():
    # Nose down by 10°: the ground 5 m ahead of the body's origin lies 5 tan 10° = 0.88 m above its
    # x axis.
    pitch = np.deg2rad(10.0)
    c = np.cos(pitch)
    s = np.sin(pitch)
    world_T_body = np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1.0]])
    points_m = scan(hdl32(720), world_T_body=world_T_body).points_m
    ahead = points_m[(np.abs(points_m[:, 1]) < 0.5) & (np.abs(points_m[:, 0] - 5) < 0.4)]
    assert len(ahead) > 5
    assert np.median((ahead[:, 2] + 1.3) / ahead[:, 0]) == pytest.approx(np.tan(pitch), abs=0.01)


WALL = {
    "half_length_m": 30.0,
    "half_width_m": 1.0,
    "x_m": 0.0,
    "cos_yaw": 1.0,
    "reflectance": 0.4,
    "kind": Kind.BUILDING,
}


def test_lasers_are_numbered_from_the_lowest_beam():
    returns = scan(hdl32(360), records(BOX, y_m=9.0, top_m=9.0, **WALL))
    assert set(returns.laser.tolist()) == set(range(32))
    assert set(returns.kind.tolist()) == {Kind.GROUND, Kind.BUILDING}
    elevation = np.arctan2(returns.points_m[:, 2], np.hypot(*returns.points_m[:, :2].T))
    # −30.67° + laser × 41.34° / 31
    assert np.rad2deg(elevation) == pytest.approx(-30.67 + returns.laser * 41.34 / 31, abs=1e-3)


def test_upside_down_most_beams_look_up():
    returns = scan(hdl32_inverted(360), records(BOX, y_m=9.0, top_m=9.0, **WALL))
    elevation_deg = np.rad2deg(
        np.arctan2(returns.points_m[:, 2], np.hypot(*returns.points_m[:, :2].T))
    )
    # −10.67° + laser × 41.34° / 31
    assert elevation_deg == pytest.approx(-10.67 + returns.laser * 41.34 / 31, abs=1e-3)
    # Of the wall's 9 m, 8 m away from a sensor 0.96 m up, 0.96 + 8 tan 30.67° = 5.7 m are seen.
    heights_m = returns.points_m[returns.kind == Kind.BUILDING, 2] + 0.96
    assert heights_m[
        np.abs(returns.points_m[returns.kind == Kind.BUILDING, 0]) < 0.5
    ].max() == pytest.approx(5.7, abs=0.1)


def test_a_push_broom_hangs_as_robotcar_publishes_it():
    # METHODS 7.2: lms_front's (1, 0, 0) and (0, 1, 0) lie at (1.872180, 0.230834, 2.034655) and
    # (1.766719, 1.226757, 1.036148) of the z-down vehicle, whose origin is 0.9 + 1.0411 m above the
    # ground; the body is z up, with its origin on the ground.
    placed = lms151(541).body_T_sensor @ np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0, 1.0]])
    assert placed[:3, 0] == pytest.approx([1.872180, -0.230834, 1.9411 - 2.034655], abs=1e-6)
    assert placed[:3, 1] == pytest.approx([1.766719, -1.226757, 1.9411 - 1.036148], abs=1e-6)


def test_a_sweep_sees_the_ground_below_and_walls_on_both_sides():
    lidar = lms151(541)
    returns = scan(lidar, records(BOX, y_m=[11.0, -6.0], top_m=[9.0, 9.0], **WALL))
    assert (returns.points_m[:, 2] == 0).all()
    points_m = returns.points_m @ lidar.body_T_sensor[:3, :3].T + lidar.body_T_sensor[:3, 3]
    ground = returns.kind == Kind.GROUND
    wall = returns.kind == Kind.BUILDING
    assert abs(points_m[ground, 2].mean()) < 0.01
    assert points_m[ground, 2].std() < 0.05
    # Walls 10 m to the left and 5 m to the right, of which the fan sees all 9 m of height.
    assert np.abs(points_m[wall & (points_m[:, 1] > 0), 1] - 10).max() < 0.15
    assert np.abs(points_m[wall & (points_m[:, 1] < 0), 1] + 5).max() < 0.15
    assert points_m[wall, 2].max() > 8.0
    # y of the sensor is the vehicle's right, so the near wall lies at positive y.
    assert returns.points_m[wall, 1].max() < 6.0
    assert returns.points_m[wall, 1].min() < -9.0


def test_sixty_four_beams_lie_closer_above():
    lidar = hdl64(180)
    assert lidar.directions.shape == (180 * 64, 3)
    elevation = np.rad2deg(np.arcsin(lidar.directions[:64, 2]))
    assert elevation[[0, 31, 32, 63]] == pytest.approx([-24.8, -8.87, -8.33, 2.0])
    # 15.93° / 31 below, 10.33° / 31 above
    assert np.diff(elevation)[[0, 40]] == pytest.approx([0.5139, 0.3332], abs=1e-4)
    assert lidar.body_T_sensor[:3, 3] == pytest.approx([0, 0, 1.73])
