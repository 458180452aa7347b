"""Where rays meet single shapes, with ranges worked out by hand."""

import numpy as np
import pytest

from worlds.driving.hits import MISS, hash_u, hit_box, hit_crown, hit_cylinder
from worlds.layout.shapes import BOX, CROWN, CYLINDER, records

SIZE = {
    "x_m": 10.0,
    "y_m": 0.0,
    "half_length_m": 2.0,
    "half_width_m": 3.0,
    "bottom_m": 0.0,
    "top_m": 4.0,
}
WALL = records(BOX, cos_yaw=1.0, sin_yaw=0.0, **SIZE)[0]
TURNED = records(BOX, cos_yaw=0.0, sin_yaw=1.0, **SIZE)[0]
HEDGE = records(BOX, cos_yaw=1.0, sin_yaw=0.0, extinction_per_m=1.5, **SIZE)[0]
POLE = records(CYLINDER, x_m=0.0, y_m=5.0, radius_m=0.5, bottom_m=0.0, top_m=2.0)[0]
TREE = records(
    CROWN, x_m=10.0, y_m=0.0, z_m=5.0, radius_m=3.0, half_height_m=2.0, extinction_per_m=0.5
)[0]
EAST = (1.0, 0.0, 0.0)
NORTH = (0.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("box", "origin", "u", "range_m"),
    [
        (WALL, (0.0, 0.0, 1.0), 1.0, 8.0),  # the box spans x 8 to 12
        # a quarter turn: its length lies along y, so that it spans x 7 to 13
        (TURNED, (0.0, 0.0, 1.0), 1.0, 7.0),
        (WALL, (0.0, 0.0, 4.1), 1.0, MISS),  # above it
        (WALL, (10.0, 0.0, 1.0), 1.0, MISS),  # from inside it
        # −log(u) / 1.5: u = exp(−3) goes 2 m into the 4 m of leaves, u = exp(−9) would need 6 m.
        (HEDGE, (0.0, 0.0, 1.0), np.exp(-3.0), 10.0),
        (HEDGE, (0.0, 0.0, 1.0), np.exp(-9.0), MISS),
    ],
)
def test_a_level_ray_meets_the_near_side_of_a_box(
    box: np.void, origin: tuple[float, ...], u: float, range_m: float
):
    found, cosine = hit_box(box, origin, EAST, u)
    assert found == pytest.approx(range_m)
    assert cosine == pytest.approx(0.0 if range_m == MISS else 0.8 if box is HEDGE else 1.0)


@pytest.mark.parametrize(
    ("origin", "found"),
    [
        # 5 m to the axis less 0.5 m of radius, head on; 0.3 m aside the side recedes: 5 − √(0.25 −
        # 0.09) = 4.6, cosine 0.4 / 0.5.
        ((0.0, 0.0, 1.0), (4.5, 1.0)),
        ((0.3, 0.0, 1.0), (4.6, 0.8)),
        ((0.0, 0.0, 2.1), (MISS, 0.0)),  # over it
    ],
)
def test_a_ray_meets_a_cylinder_at_its_radius(
    origin: tuple[float, ...], found: tuple[float, float]
):
    assert hit_cylinder(POLE, origin, NORTH) == pytest.approx(found)


# Through the middle the crown spans x 7 to 13; −log(exp(−1)) / 0.5 = 2 m into it. exp(−4) would
# need 8 m of its 6.
@pytest.mark.parametrize(("u", "range_m"), [(np.exp(-1.0), 9.0), (np.exp(-4.0), MISS)])
def test_a_crown_stops_a_ray_after_its_free_path(u: float, range_m: float):
    assert hit_crown(TREE, (0.0, 0.0, 5.0), EAST, u)[0] == pytest.approx(range_m)


def test_the_hash_is_uniform_and_follows_from_its_arguments():
    draws = np.array([hash_u(np.uint64(7), ray, 3) for ray in range(4000)])
    # A uniform draw's mean over 4,000 is 0.5 with sd 0.0046; its sd is 0.2887.
    assert abs(draws.mean() - 0.5) < 0.02
    assert abs(draws.std() - 0.2887) < 0.01
    assert hash_u(np.uint64(7), 11, 3) == draws[11]
    assert hash_u(np.uint64(8), 11, 3) != draws[11]
