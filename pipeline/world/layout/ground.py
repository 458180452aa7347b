"""The ground: a bilinear height map of a few long waves."""

from dataclasses import dataclass

import numpy as np
from numba import njit

from pipeline.world import Floats

CELL_M = 8.0
MARGIN_M = 60.0
WAVES = 4
WAVE_HEIGHT_M = 2.5
WAVE_LENGTHS_M = (250.0, 700.0)


@njit(cache=True, nogil=True, error_model="numpy")
def height_at(
    heights: Floats, x0_m: float, y0_m: float, cell_m: float, x_m: float, y_m: float
) -> float:
    """Bilinear height in metres between the knots `heights` (i, j), of which (0, 0) lies at (x0_m,
    y0_m)."""
    u = (x_m - x0_m) / cell_m
    v = (y_m - y0_m) / cell_m
    i = min(max(int(u), 0), heights.shape[0] - 2)
    j = min(max(int(v), 0), heights.shape[1] - 2)
    a = u - i
    b = v - j
    near = heights[i, j] * (1 - a) + heights[i + 1, j] * a
    far = heights[i, j + 1] * (1 - a) + heights[i + 1, j + 1] * a
    return near * (1 - b) + far * b  # type: ignore[no-any-return]


@njit(cache=True, nogil=True, error_model="numpy")
def _heights_at(
    heights: Floats, x0_m: float, y0_m: float, cell_m: float, x_m: Floats, y_m: Floats
) -> Floats:
    z_m = np.empty(len(x_m))
    for row in range(len(x_m)):
        z_m[row] = height_at(heights, x0_m, y0_m, cell_m, x_m[row], y_m[row])
    return z_m


@dataclass(frozen=True)
class Ground:
    """Heights at the knots of a square raster in the world frame.

    The ray caster uses the same cells.
    """

    heights_m: Floats
    """(i, j): knot (i, j) lies at (x0_m + i cell_m, y0_m + j cell_m)."""
    x0_m: float
    y0_m: float
    cell_m: float = CELL_M

    def at(self, x_m: Floats, y_m: Floats) -> Floats:
        """Heights (n,) of the ground in metres at places `x_m`, `y_m` (n,)."""
        x_m = np.ascontiguousarray(x_m)
        y_m = np.ascontiguousarray(y_m)
        return np.asarray(_heights_at(self.heights_m, self.x0_m, self.y0_m, self.cell_m, x_m, y_m))


def rolling_ground(rng: np.random.Generator, low_m: Floats, high_m: Floats) -> Ground:
    """Ground below the rectangle from `low_m` to `high_m` (x, y) and a margin around it."""
    x0_m, y0_m = low_m - MARGIN_M
    cells = ((high_m - low_m + 2 * MARGIN_M) / CELL_M).astype(int) + 1
    x_m = x0_m + np.arange(cells[0] + 1)[:, None] * CELL_M
    y_m = y0_m + np.arange(cells[1] + 1)[None, :] * CELL_M
    heights_m = np.zeros((cells[0] + 1, cells[1] + 1))
    for _ in range(WAVES):
        heading, phase = rng.uniform(0, 2 * np.pi, 2)
        along_m = x_m * np.cos(heading) + y_m * np.sin(heading)
        heights_m += WAVE_HEIGHT_M * np.sin(
            2 * np.pi * along_m / rng.uniform(*WAVE_LENGTHS_M) + phase
        )
    return Ground(heights_m, float(x0_m), float(y0_m))
