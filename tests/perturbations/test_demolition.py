"""Demolition: the points of a wedge of directions are missing."""

import math

import numpy as np
import pytest

from pipeline.perturbations.demolition import Demolition
from tests.perturbations.made import perturbed

AZIMUTHS_DEG = np.arange(0.05, 360, 0.1)
"""3600 azimuths, a tenth of a degree apart."""
POINTS_M = np.stack(
    [
        9 * np.cos(np.radians(AZIMUTHS_DEG)),
        9 * np.sin(np.radians(AZIMUTHS_DEG)),
        np.full(3600, 0.4),
    ],
    axis=1,
)


def remaining(
    perturbation: Demolition, stamp_ns: int = 3, points: np.ndarray = POINTS_M
) -> list[np.ndarray]:
    """The points that are left in each case."""
    return [left for left, _ in perturbed(perturbation, points, stamp_ns)]


@pytest.mark.parametrize("stamp_ns", range(8))
def test_a_wedge_takes_exactly_the_points_within(stamp_ns: int) -> None:
    """A wedge begins at a random azimuth, and removes ten points for each degree of its width."""
    start_deg = math.degrees(np.random.default_rng((0, stamp_ns)).uniform(0, 2 * math.pi))
    for width_deg, left in zip(
        (30, 60, 90, 270), remaining(Demolition([30, 60, 90, 270]), stamp_ns)[1:], strict=True
    ):
        assert len(left) == 3600 - 10 * width_deg
        np.testing.assert_array_equal(left, POINTS_M[(AZIMUTHS_DEG - start_deg) % 360 > width_deg])


def test_distance_and_height_make_no_difference() -> None:
    near = POINTS_M * (0.01, 0.01, 1)
    far = POINTS_M * (9, 9, -20)
    for left, other in ((near, (0.01, 0.01, 1)), (far, (9, 9, -20))):
        np.testing.assert_allclose(
            remaining(Demolition(), points=left)[2], remaining(Demolition())[2] * other
        )


def test_what_a_wedge_lacks_a_wider_one_lacks_too() -> None:
    driven, *left = ({tuple(point) for point in points} for points in remaining(Demolition()))
    assert driven > left[0] > left[1] > left[2]


def test_a_point_on_the_sensors_axis_has_no_direction_and_stays() -> None:
    assert all(
        len(points) == 1 for points in remaining(Demolition(), points=np.array([[0.0, 0.0, 2.0]]))
    )
