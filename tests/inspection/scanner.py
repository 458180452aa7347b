"""A spinning LiDAR in a walled yard of 60 × 36 m on flat ground: clouds that the tests know
everything about."""

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.inspection import Inspection


def assert_says(found: Inspection, *words: str) -> None:
    text = found.text()
    for word in words:
        assert word in text


def scan(
    beams: int = 32,
    sensor_m: float = 1.8,
    ground_m: float = 0.0,
    azimuth_deg: float = 360.0,
    wall_m: float = 9.0,
) -> NDArray[np.float64]:
    """Points (n, 3), z up: `beams` from −24° to 8°, `azimuth_deg` of the round, one firing every
    0.25°."""
    elevation, azimuth = np.meshgrid(
        np.radians(np.linspace(-24.0, 8.0, beams)),
        np.radians(np.arange(0.0, azimuth_deg, 0.25)),
        indexing="ij",
    )
    to_wall = np.minimum(
        30 / np.abs(np.cos(azimuth)).clip(1e-9), 18 / np.abs(np.sin(azimuth)).clip(1e-9)
    )
    with np.errstate(divide="ignore"):
        to_ground = np.where(elevation < 0, sensor_m / np.tan(-elevation).clip(1e-9), np.inf)
    flat = np.minimum(to_wall, to_ground)
    z = sensor_m + flat * np.tan(elevation)
    points = np.stack(
        [flat * np.cos(azimuth), flat * np.sin(azimuth), z + ground_m], axis=-1
    ).reshape(-1, 3)
    return points[points[:, 2] - ground_m < wall_m]
