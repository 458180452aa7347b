"""Tells what is no map with z upwards: points in other axes, and single scans (METHODS 15)."""

import numpy as np
from numpy.typing import NDArray

from pipeline.mapping.local_ground import columns_with_ground
from pipeline.mapping.tiled_map import TiledMap

LIFTS_M = (-0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
"""Heights of a scan's sensor above the origin that are tried."""
NEAREST_M = 3.0
"""Points nearer to the sensor than this are of its vehicle."""
DIRECTION_DEG = 1.0
"""A direction is so wide and so high."""
BEHIND_SHARE = 0.2
BEHIND_M = 2.0
"""A point is hidden if it is farther than another in its direction by this share and this
distance."""

MORE_GROUND = 2
"""Another axis than z is up if so many times more columns show a ground along it."""
TURNS: dict[str, tuple[str, NDArray[np.float64]]] = {
    "y": ("(x, −z, y)", np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])),
    "−y": ("(x, z, −y)", np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])),
    "x": ("(y, z, x)", np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])),
    "−x": ("(z, y, −x)", np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])),
    "−z": ("(x, −y, −z)", np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])),
}
"""For each direction that may be up, other than z: the coordinates that put it right, in words and
as the matrix that turns the points."""
BLOCK_M = 100.0
"""The vertical axis is looked for in the points nearer than this to the middle, along each axis."""


def upward(tiled: TiledMap) -> tuple[str, str] | None:
    """The direction that seems to be up and the coordinates that put it right; None if it is z.

    A direction is up if more ground lies along it than along z. A long wall is such a plane too,
    so the points must reach less far along that direction than along z.
    """
    middle_m = np.median([tiled.tile_m(tile).mean(axis=0) for tile in range(len(tiled))], axis=0)
    points_m = tiled.around(middle_m[:2], BLOCK_M)
    points_m = points_m[np.abs(points_m[:, 2] - middle_m[2]) < BLOCK_M] - middle_m
    if not len(points_m):
        return None
    low_m, high_m = np.quantile(points_m, (0.01, 0.99), axis=0)
    sides_m = high_m - low_m
    fewest = MORE_GROUND * max(columns_with_ground(points_m), 1)
    for up, (coordinates, turn) in TURNS.items():
        is_lower = up == "−z" or np.abs(turn[2]) @ sides_m < sides_m[2] / 2
        if is_lower and columns_with_ground(points_m @ turn.T) > fewest:
            return up, coordinates
    return None


def hidden_share(points_m: NDArray[np.float64]) -> float:
    """The share of points (n, 3) that a sensor above the origin could not see behind others.

    It is small for a single scan: from wherever a map is seen, much of it is hidden.
    """
    shares = []
    for lift_m in LIFTS_M:
        beam_m = points_m - np.array([0.0, 0.0, lift_m])
        away_m = np.linalg.norm(beam_m, axis=1)
        beam_m = beam_m[away_m > NEAREST_M]
        away_m = away_m[away_m > NEAREST_M]
        if not len(away_m):
            return 1.0
        azimuth_deg = np.rad2deg(np.arctan2(beam_m[:, 1], beam_m[:, 0])) + 180
        height_deg = np.rad2deg(np.arcsin(beam_m[:, 2] / away_m)) + 90
        columns = int(360 / DIRECTION_DEG) + 1
        direction = (height_deg // DIRECTION_DEG).astype(np.int64) * columns
        direction += (azimuth_deg // DIRECTION_DEG).astype(np.int64)
        nearest_m = np.full(direction.max() + 1, np.inf)
        np.minimum.at(nearest_m, direction, away_m)
        is_hidden = away_m > nearest_m[direction] * (1 + BEHIND_SHARE) + BEHIND_M
        shares.append(float(is_hidden.mean()))
    return min(shares)
