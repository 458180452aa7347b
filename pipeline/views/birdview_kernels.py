"""The hot loops of bird-views: occupied columns of an octree's leaves, and the image of them at a heading. Lengths in leaves."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True, error_model="numpy")
def columns_above(
    log_odds: NDArray[np.float32],
    ground: NDArray[np.float64],
    up: NDArray[np.float64],
    low: float,
    high: float,
    threshold: float,
) -> NDArray[np.uint8]:
    """Whether any leaf of a column whose middle is from `low` to below `high` leaves above the ground exceeds a threshold.

    The ground is the plane through `ground` (3,) with the upward normal `up` (3,).
    """
    side = log_odds.shape[0]
    found = np.zeros((side, side), np.uint8)
    for x in range(side):
        for y in range(side):
            level = ground[2] - 0.5 - ((x + 0.5 - ground[0]) * up[0] + (y + 0.5 - ground[1]) * up[1]) / up[2]
            start = min(max(math.ceil(level + low / up[2]), 0), side)
            stop = min(max(math.ceil(level + high / up[2]), 0), side)
            any_above = False
            for z in range(start, stop):
                any_above |= log_odds[x, y, z] > threshold
            found[x, y] = np.uint8(any_above)
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def sampled(
    columns: NDArray[np.uint8], middle: NDArray[np.float64], yaw_rad: float, width: float, side_px: int, samples: int
) -> NDArray[np.uint8]:
    """Each pixel's share of set columns, 0…255, in a heading-up image (side_px, side_px): row 0 front, column 0 left.

    It shows the square of `width` columns around `middle` (2,), its front along `yaw_rad`; a pixel is the mean of
    samples × samples points.
    """
    image = np.empty((side_px, side_px), np.uint8)
    side, step = columns.shape[0], width / (side_px * samples)
    front_x, front_y = math.cos(yaw_rad) * step, math.sin(yaw_rad) * step
    most = samples * samples
    last = 0.5 * (side_px * samples - 1)
    for row in range(side_px):
        for col in range(side_px):
            count = 0
            for i in range(samples):
                front = last - (row * samples + i)
                for j in range(samples):
                    left = last - (col * samples + j)
                    x = math.floor(middle[0] + front * front_x - left * front_y)
                    y = math.floor(middle[1] + front * front_y + left * front_x)
                    if 0 <= x < side and 0 <= y < side:
                        count += columns[x, y]
            image[row, col] = (510 * count + most) // (2 * most)
    return image
