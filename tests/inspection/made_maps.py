"""Point-cloud maps that are made: a walled yard, storeys, and how they are written."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
STEP_M = 0.25
"""Distance of the points on a surface."""
SIDE_M = 60.0
WALL_M = 6.0


def floor(height_m: float = 0.0, side_m: float = SIDE_M) -> Points:
    """A level square with its corner at the origin."""
    along_m = np.arange(STEP_M / 2, side_m, STEP_M)
    x_m, y_m = np.meshgrid(along_m, along_m)
    return np.column_stack([x_m.ravel(), y_m.ravel(), np.full(x_m.size, height_m)])


def walls(low_m: float = 0.0, high_m: float = WALL_M, side_m: float = SIDE_M) -> Points:
    """Upright walls every 10 m along x, and two along y at the ends."""
    along_m = np.arange(STEP_M / 2, side_m, STEP_M)
    along_m, z_m = map(np.ravel, np.meshgrid(along_m, np.arange(low_m, high_m, STEP_M)))
    rows = [
        np.column_stack([along_m, np.full(len(along_m), y_m), z_m])
        for y_m in np.arange(5.0, side_m, 10.0)
    ]
    ends = [
        np.column_stack([np.full(len(along_m), x_m), along_m, z_m]) for x_m in (0.5, side_m - 0.5)
    ]
    return np.concatenate([*rows, *ends])


def yard() -> Points:
    """A level ground of 60 × 60 m with walls of 6 m: 14,400 points of ground."""
    return np.concatenate([floor(), walls()])


def house(storeys: int, storey_m: float = 3.2) -> Points:
    """A house of 60 × 60 m: a floor and walls in each storey, and a ceiling over the last."""
    floors = [floor(storey_m * storey) for storey in range(storeys + 1)]
    return np.concatenate([*floors, walls(0.0, storey_m * storeys)])


def write_pcd(path: Path, points: Points, dtype: str = "<f4", fields: str = "") -> Path:
    """Write points as a binary PCD of 32- or 64-bit floats, with further fields that are 0."""
    names = ["x", "y", "z", *fields.split()]
    table = np.zeros((len(points), len(names)), dtype)
    table[:, :3] = points
    size = np.dtype(dtype).itemsize
    count = len(names)
    path.write_bytes(
        (
            f"VERSION 0.7\nFIELDS {' '.join(names)}\nSIZE{f' {size}' * count}\nTYPE{' F' * count}\n"
            f"COUNT{' 1' * count}\nWIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
            f"POINTS {len(points)}\nDATA binary\n"
        ).encode()
        + table.tobytes()
    )
    return path
