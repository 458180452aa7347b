"""The ground of a world: a height map of a few long waves, bilinear between the knots of a raster.

In a dense world it also has pavements and banks along the streets.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from worlds import Floats
from worlds.layout.streets import Streets

CELL_M = 8.0
"""Distance between knots."""
FINE_CELL_M = 2.0
"""Distance between the knots of a dense world, which has more shapes in a cell, and banks."""
MARGIN_M = 60.0
"""How far the ground reaches beyond the streets."""
WAVES = 4
"""Number of waves."""
WAVE_HEIGHT_M = 2.5
"""Amplitude of each wave."""
WAVE_LENGTH_BOUNDS_M = (250.0, 700.0)
"""Bounds of the length of a wave."""
PAVEMENT_M = 0.12
"""How far pavements lie above the road."""
BANK_M = 0.6
"""How far gardens lie above the pavement, at most."""
BANK_WIDTH_M = 4.0
"""Width of the slope between the pavement and the gardens."""
BANK_WAVES = 3
"""Number of waves along which the height of gardens varies."""
BANK_WAVE_LENGTH_BOUNDS_M = (30.0, 90.0)
"""Bounds of their lengths."""


@njit(cache=True, nogil=True, error_model="numpy")
def height_at(
    heights: Floats, x0_m: float, y0_m: float, cell_m: float, x_m: float, y_m: float
) -> float:
    """Height in metres at (x_m, y_m), bilinear between the knots `heights` (i, j).

    Knot (0, 0) lies at (x0_m, y0_m).
    """
    u = (x_m - x0_m) / cell_m
    v = (y_m - y0_m) / cell_m
    i = min(max(int(u), 0), heights.shape[0] - 2)
    j = min(max(int(v), 0), heights.shape[1] - 2)
    share_i = u - i
    share_j = v - j
    near = heights[i, j] * (1 - share_i) + heights[i + 1, j] * share_i
    far = heights[i, j + 1] * (1 - share_i) + heights[i + 1, j + 1] * share_i
    return near * (1 - share_j) + far * share_j  # type: ignore[no-any-return]


@njit(cache=True, nogil=True, error_model="numpy")
def _heights_at(
    heights: Floats, x0_m: float, y0_m: float, cell_m: float, x_m: Floats, y_m: Floats
) -> Floats:
    """`height_at` for many places (n,)."""
    z_m = np.empty(len(x_m))
    for row in range(len(x_m)):
        z_m[row] = height_at(heights, x0_m, y0_m, cell_m, x_m[row], y_m[row])
    return z_m


@dataclass(frozen=True)
class Ground:
    """Heights at the knots of a raster in the world; the ray caster uses the same cells."""

    heights_m: Floats
    """(i, j) height of the knot at (x0_m + i cell_m, y0_m + j cell_m)."""
    x0_m: float
    y0_m: float
    cell_m: float = CELL_M

    def at(self, x_m: Floats, y_m: Floats) -> Floats:
        """Heights (n,) of the ground in metres at the places `x_m`, `y_m` (n,)."""
        x_m = np.ascontiguousarray(x_m)
        y_m = np.ascontiguousarray(y_m)
        return np.asarray(_heights_at(self.heights_m, self.x0_m, self.y0_m, self.cell_m, x_m, y_m))


def rolling_ground(
    rng: np.random.Generator, low_m: Floats, high_m: Floats, cell_m: float = CELL_M
) -> Ground:
    """Ground of random waves below the rectangle from `low_m` to `high_m` (2,), with a margin."""
    x0_m, y0_m = low_m - MARGIN_M
    n_cells = ((high_m - low_m + 2 * MARGIN_M) / cell_m).astype(int) + 1
    x_m = x0_m + np.arange(n_cells[0] + 1)[:, None] * cell_m
    y_m = y0_m + np.arange(n_cells[1] + 1)[None, :] * cell_m
    heights_m = np.zeros((n_cells[0] + 1, n_cells[1] + 1))
    for _ in range(WAVES):
        heading, phase = rng.uniform(0, 2 * np.pi, 2)
        along_m = x_m * np.cos(heading) + y_m * np.sin(heading)
        heights_m += WAVE_HEIGHT_M * np.sin(
            2 * np.pi * along_m / rng.uniform(*WAVE_LENGTH_BOUNDS_M) + phase
        )
    return Ground(heights_m, float(x0_m), float(y0_m), cell_m)


def banked(rng: np.random.Generator, ground: Ground, streets: Streets) -> Ground:
    """The ground with a pavement along all streets, and gardens that lie up to BANK_M higher.

    By how much varies from place to place along random waves.
    """
    rows, columns = ground.heights_m.shape
    x_m = ground.x0_m + np.arange(rows) * ground.cell_m
    y_m = ground.y0_m + np.arange(columns) * ground.cell_m
    bank_share = np.full((rows, columns), 0.5)
    for _ in range(BANK_WAVES):
        heading, phase = rng.uniform(0, 2 * np.pi, 2)
        along_m = x_m[:, None] * np.cos(heading) + y_m * np.sin(heading)
        wave = np.sin(2 * np.pi * along_m / rng.uniform(*BANK_WAVE_LENGTH_BOUNDS_M) + phase)
        bank_share += 0.5 / BANK_WAVES * wave
    # One cell off the border of a street the pavement is reached; there the slope begins.
    off_street_m = np.stack(
        [streets.clearance_m(np.column_stack([np.full(columns, x), y_m])) for x in x_m]
    )
    pavement = (off_street_m / ground.cell_m).clip(0, 1)
    slope = ((off_street_m - ground.cell_m) / BANK_WIDTH_M).clip(0, 1)
    raised_m = PAVEMENT_M * pavement + BANK_M * bank_share * slope
    return replace(ground, heights_m=ground.heights_m + raised_m)
