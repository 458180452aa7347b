"""Simulates a spinning LiDAR in a walled yard of 60 × 36 m on flat ground, for known clouds."""

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.inspection import Inspection


def assert_says(found: Inspection, *words: str) -> None:
    """Check that the text of an inspection holds all these words."""
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
    """Points (n, 3) in metres of one scan, z up.

    The sensor is `sensor_m` over the ground, which lies at z = `ground_m`. Its `beams` are spread
    from −24° to 8°, and fire every 0.25° over `azimuth_deg`. The walls are `wall_m` high.
    """
    elevation, azimuth = np.meshgrid(
        np.radians(np.linspace(-24.0, 8.0, beams)),
        np.radians(np.arange(0.0, azimuth_deg, 0.25)),
        indexing="ij",
    )
    # distances in the xy plane
    to_wall_m = np.minimum(
        30 / np.abs(np.cos(azimuth)).clip(1e-9), 18 / np.abs(np.sin(azimuth)).clip(1e-9)
    )
    with np.errstate(divide="ignore"):
        to_ground_m = np.where(elevation < 0, sensor_m / np.tan(-elevation).clip(1e-9), np.inf)
    range_m = np.minimum(to_wall_m, to_ground_m)
    height_m = sensor_m + range_m * np.tan(elevation)
    points = np.stack(
        [range_m * np.cos(azimuth), range_m * np.sin(azimuth), height_m + ground_m], axis=-1
    ).reshape(-1, 3)
    return points[points[:, 2] - ground_m < wall_m]
