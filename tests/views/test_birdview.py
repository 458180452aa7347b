"""Bird-views: where things appear in them, at which headings, and what is left out."""

import hashlib
import math
from typing import Any

import numpy as np
import pytest

from pipeline.core import frames
from pipeline.core.errors import InputError
from pipeline.mapping.octree import Octree
from pipeline.views.birdview import BirdView

VIEW = BirdView(Octree(edge_m=32.0, depth=6, motion="none"), side_px=32, jitter_m=0.0)
"""Pixels of a metre over leaves of half a metre: at heading 0 a pixel is four columns."""


def pose(x: float, y: float, yaw: float = 0.0, z: float = 0.0, pitch: float = 0.0) -> np.ndarray:
    """One pose (4, 4), from metres and radians."""
    return frames.pose(np.array([[x, y, z]]), np.array([[0.0, pitch, yaw]]))[0]


def post(x: float, y: float) -> np.ndarray:
    """The points (n, 3) of a post with a square of 1 m as its base, 2 m high."""
    grid = np.arange(-0.375, 0.5, 0.25)
    return np.stack(np.meshgrid(grid + x, grid + y, np.arange(0.1, 2, 0.2)), axis=-1).reshape(-1, 3)


def scene() -> np.ndarray:
    """The points (n, 3) of about 25 posts at random places."""
    rng = np.random.default_rng(0)
    return np.concatenate([post(*xy) for xy in rng.uniform(-14, 14, (25, 2)) if max(abs(xy)) > 2])


def brightest(image: np.ndarray) -> tuple[float, float]:
    """Row and column of the centre of brightness."""
    row, col = np.nonzero(image)
    weight = image[row, col].astype(float)
    return float((row * weight).sum() / weight.sum()), float((col * weight).sum() / weight.sum())


@pytest.mark.parametrize(
    ("x", "y", "row", "col"), [(10.5, 3.5, 5, 12), (-10.5, 3.5, 26, 12), (3.5, -12.5, 12, 28)]
)
def test_front_is_up_and_left_is_left(x: float, y: float, row: int, col: int) -> None:
    # The robot is between rows 15 and 16: 10.5 m ahead is row 16 − 11, 3.5 m left column 16 − 4,
    # 12.5 m right 16 + 12.
    image = VIEW(post(x, y))[0]
    expected = np.zeros((32, 32), np.uint8)
    expected[row, col] = 255
    np.testing.assert_array_equal(image, expected)


@pytest.mark.parametrize("heading", range(16))
def test_a_robot_turned_to_the_left_sees_things_further_to_the_right(heading: int) -> None:
    # The post stands 10 m ahead; turned by a to the left the robot has it at 10 cos a ahead and 10
    # sin a to the right.
    angle = heading * math.pi / 8
    row, col = brightest(VIEW(post(10.0, 0.0))[heading])
    assert (15.5 - row, col - 15.5) == pytest.approx(
        (10 * math.cos(angle), 10 * math.sin(angle)), abs=0.3
    )


def test_a_quarter_turn_is_exactly_a_turned_image() -> None:
    for jitter_m in (0.0, 0.5):
        view = BirdView(jitter_m=jitter_m)
        grown = view.octree.grow()
        grown.insert(scene(), pose(3.3, -2.1, 0.37))
        images = view.draw(grown, pose(3.3, -2.1, 0.37), 5)
        assert images.shape == (16, 64, 64)
        assert images.dtype == np.uint8
        for h in range(16):
            np.testing.assert_array_equal(images[(h + 4) % 16], np.rot90(images[h], -1))


def test_heading_h_is_what_a_robot_so_turned_draws_as_its_heading_0() -> None:
    grown = VIEW.octree.grow()
    here = pose(3.3, -2.1, 0.37)
    grown.insert(scene(), here)
    images = VIEW.draw(grown, here)
    for h in range(16):
        turned = VIEW.draw(grown, pose(3.3, -2.1, 0.37 + h * math.pi / 8))[0]
        assert (turned != images[h]).mean() < 0.005  # rounding at a sample or two
    assert (images[0] != images[1]).mean() > 0.05


def test_only_what_stands_between_the_two_heights_above_the_ground_is_drawn() -> None:
    def drawn(z: float, ground: float) -> bool:
        grown = VIEW.octree.grow()
        points = np.array([[8.2, 3.2, z]])
        grown.insert(points, pose(0.0, 0.0, z=ground))
        return bool(VIEW.draw(grown, pose(0.0, 0.0, z=ground))[0].any())

    # Leaves of 0.5 m: their middles are at 0.25, below 0.3, then 0.75 … 4.75, and at 5.25, above 5.
    for ground in (0.0, 12.0):
        assert [z for z in (-0.1, 0.1, 0.4, 0.6, 4.9, 5.1) if drawn(z, ground)] == [0.6, 4.9]


@pytest.mark.parametrize(
    ("upright", "drawn"), [("ground", False), ("vehicle", False), ("odometry", True)]
)
def test_the_ground_of_a_slope_is_ground_to_the_robot_on_it(upright: str, drawn: bool) -> None:
    # 5° up: 14 m ahead the ground is 1.2 m above the robot's, in odometry's eyes. A wall on it is
    # seen either way.
    view = BirdView(**vars(VIEW) | {"upright": upright})
    climb = pose(0.0, 0.0, pitch=-math.radians(5))
    ground = np.stack(np.meshgrid(np.arange(2, 14, 0.3), np.arange(-5, 5, 0.3), [0.0]), -1).reshape(
        -1, 3
    )
    grown = view.octree.grow()
    grown.insert(ground, climb)
    standing = view.standing(ground, climb)
    assert view.draw(grown, standing)[0].any() == drawn
    grown.insert(post(10.0, 3.0), climb)
    assert view.draw(grown, standing)[0, 4:8, 11:15].max() > 100


@pytest.mark.parametrize(
    ("upright", "drawn"), [("ground", False), ("vehicle", True), ("odometry", True)]
)
def test_the_ground_stays_ground_to_a_robot_that_pitches_over_it(upright: str, drawn: bool) -> None:
    """The robot leans back by 5° on a slope of 3° and its scans count heights from 0.4 m too high;
    a post shows no ground."""
    view = BirdView(**vars(VIEW) | {"upright": upright})
    lean = math.radians(5)
    slope = math.tan(math.radians(3))
    ground = np.stack(np.meshgrid(np.arange(2, 14, 0.3), np.arange(-5, 5, 0.3), [0.0]), -1).reshape(
        -1, 3
    )
    ground[:, 2] = slope * ground[:, 0] + 0.4
    leaning = pose(0.0, 0.0, pitch=-lean)
    seen = ground @ leaning[:3, :3]
    grown = view.octree.grow()
    grown.insert(seen, leaning)
    standing = view.standing(seen, leaning)
    assert view.draw(grown, standing)[0].any() == drawn
    if upright == "ground":
        up = np.array([-slope, 0.0, 1.0])
        np.testing.assert_allclose(standing[:3, 2], up / np.linalg.norm(up), atol=1e-3)
        # along the robot's own axis, at which the plane is met above its origin
        height_m = 0.4 / (math.cos(lean) - math.sin(lean) * slope)
        np.testing.assert_allclose(standing[:3, 3], leaning[:3, 2] * height_m, atol=0.01)
        np.testing.assert_array_equal(view.standing(post(10.0, 3.0)[:2], leaning), leaning)


def test_a_column_is_occupied_above_the_threshold() -> None:
    # Seen once P = .7; seen and then twice looked through L = .8473 − 2 · .4055 = .0364, P = .509.
    grown = VIEW.octree.grow()
    grown.insert(np.array([[8.2, 3.2, 1.7]]), np.eye(4))
    low, high = (BirdView(**vars(VIEW) | {"occupied": p}) for p in (0.69, 0.71))
    assert low.draw(grown, np.eye(4))[0].max() == 64  # a column of the four of a pixel: 63.75
    assert not high.draw(grown, np.eye(4)).any()
    for _ in range(2):
        grown.insert(np.array([[16.4, 6.4, 1.67]]), np.eye(4))
    assert grown.log_odds.max() == pytest.approx(0.0364, abs=1e-3)
    assert not VIEW.draw(grown, np.eye(4)).any()


def test_odd_headings_stand_off_by_a_seeded_offset_and_even_ones_do_not() -> None:
    jittered = BirdView(**vars(VIEW) | {"jitter_m": 1.0})
    grown = VIEW.octree.grow()
    grown.insert(scene(), np.eye(4))
    straight = VIEW.draw(grown, np.eye(4))
    for number in (0, 7):
        off = jittered.draw(grown, np.eye(4), number)
        forward_m, left_m = jittered.offset_m(number)
        np.testing.assert_array_equal(off[::2], straight[::2])
        np.testing.assert_array_equal(off[1::2], VIEW.draw(grown, pose(forward_m, left_m))[1::2])
        np.testing.assert_array_equal(off, jittered.draw(grown, np.eye(4), number))
    assert (jittered.draw(grown, np.eye(4), 0)[1] != off[1]).any()
    many = np.array([BirdView().offset_m(number) for number in range(2000)])
    assert many.std(axis=0) == pytest.approx([0.5, 0.5], rel=0.08)
    assert abs(many.mean(axis=0)).max() < 0.05


def test_a_car_that_drove_off_is_gone_while_the_wall_behind_it_stays() -> None:
    # A metre a scan. The car's leaves: L = .847, then .882 L + .847 = 1.595, 2.255, then .882 L −
    # .405 = 1.584, .993, .470, .010. P > .6 means L > .405: the car is drawn for three scans more,
    # and not in the fourth.
    view = BirdView(Octree(edge_m=32.0, depth=6), side_px=32)
    y, z = (
        axis.ravel() for axis in np.meshgrid(np.arange(-3, 3, 0.05), np.arange(0.55, 2.5, 0.05))
    )
    wall = np.stack([np.full(y.size, 12.2), y, z], axis=1)
    car = np.stack(
        np.meshgrid([6.2], np.arange(-0.4, 0.5, 0.1), np.arange(1.05, 1.9, 0.1)), axis=-1
    ).reshape(-1, 3)
    grown = view.octree.grow()
    reported = []
    for scan in range(7):
        at = pose(-0.5 + scan % 2, 0.0)  # a metre on, a metre back
        seen = np.concatenate([car, wall[np.abs(wall[:, 1]) > 2]]) if scan < 3 else wall
        grown.insert(seen - at[:3, 3], at)
        cells = np.floor(
            (np.array([[6.2, 0.2], [12.2, 2.7]]) - grown.corner_m[:2]) / grown.leaf_m
        ).astype(int)
        reported.append(view.columns(grown, at)[tuple(cells.T)].tolist())
    assert reported == 6 * [[1, 1]] + [[0, 1]]


@pytest.mark.parametrize(
    ("octree", "sha256"),
    [
        ({}, "d0a5b14056f4c29f7bba535cf132fb0129a42a9b01b6f255ff0eeeeaa509ac9a"),
        (
            {"rays": "all", "motion": "per_metre"},
            "ce6551c3a82d1b17b2d2f76fa794b0c58ff05cca4695a674b438b12f014ec112",
        ),
        (
            {"edge_m": 102.4, "depth": 8, "max_range_m": 30.0, "motion": "none"},
            "6885c1c28cc65d5433e4e3301bc95de85e314ee374d89cc9e7d9170b40567c57",
        ),
    ],
)
def test_bird_views_of_a_made_up_drive_have_the_bytes_that_a_dense_map_gave(
    octree: dict[str, Any], sha256: str
) -> None:
    """Recorded from the map that was one dense array, before its leaves were kept in bricks."""
    view = BirdView(Octree(**octree))
    rng = np.random.default_rng(6)
    digest = hashlib.sha256()
    grown = view.octree.grow()
    posts = rng.uniform(-60, 60, (300, 2))
    for number in range(20):
        here = pose(
            -20.0 + 1.3 * number,
            9.0 - 0.9 * number,
            0.15 * number,
            0.02 * number,
            0.03 * math.sin(number),
        )
        points = np.concatenate([post(*xy) for xy in posts + rng.normal(0, 0.05, posts.shape)])
        grown.insert((points - here[:3, 3]) @ here[:3, :3], here)
        digest.update(view.draw(grown, here, number).tobytes())
    assert digest.hexdigest() == sha256


def test_points_alone_make_a_view() -> None:
    images = VIEW(scene())
    assert images.shape == (16, 32, 32)
    assert images.any()
    assert not VIEW(np.empty((0, 3))).any()
    with pytest.raises(InputError, match="NaN"):
        VIEW(np.full((4, 3), np.nan))
