"""The dynamic octree as one dense array, in plain numpy and Python.

It is slow, and gives the bits that the map in bricks must give.
"""

import math

import numpy as np

from pipeline.mapping.octree import KNOWN_FROM, Octree, log_odds

WHOLE = 2.0**40
ENDLESS = 2.0**60


class DenseOctree:
    """Does what an OctreeMap does.

    `log_odds` (side, side, side) are those of the cube that reaches `side` // 2 leaves around the
    robot.
    """

    def __init__(self, octree: Octree) -> None:
        self.octree = octree
        self.log_odds = np.zeros((octree.side,) * 3, np.float32)
        self.lowest = np.zeros(3, np.int64)
        self.pose = None

    def insert(self, points_m: np.ndarray, odom_T_vehicle: np.ndarray) -> None:
        """Add a scan (n, 3) in the vehicle's frame, as `OctreeMap.insert`."""
        leaf_m = self.octree.leaf_m
        side = self.octree.side
        octree = self.octree
        lowest = np.floor(odom_T_vehicle[:3, 3] / leaf_m).astype(np.int64) - side // 2
        leaves_T_vehicle = odom_T_vehicle / leaf_m
        leaves_T_vehicle[:3, 3] -= lowest
        origin = (
            leaves_T_vehicle[:3, :3] @ (0.0, 0.0, octree.sensor_height_m) + leaves_T_vehicle[:3, 3]
        )
        free = np.zeros((side,) * 3, bool)
        hit = np.zeros((side,) * 3, bool)
        for (x, y, z), length in ends(octree, points_m, leaves_T_vehicle, origin):
            end = np.array([x, y, z])
            reach = octree.reach_m / leaf_m
            if length > reach:
                end = origin + (end - origin) * (reach / length)
            elif inside(np.floor(end), side):
                hit[tuple(np.floor(end).astype(int))] = True
            for cell in crossed(origin, end):
                if not inside(cell, side):
                    break
                free[tuple(cell)] = True
        kept = self.kept(odom_T_vehicle)
        values = moved(self.log_odds, lowest - self.lowest) * np.float32(kept)
        values[np.abs(values) < (KNOWN_FROM if kept < 1 else 0)] = 0
        hit_L = np.float32(log_odds(octree.hit))
        miss_L = np.float32(log_odds(octree.miss))
        values += np.where(hit, hit_L, np.where(free, miss_L, np.float32(0)))
        lowest_L = np.float32(log_odds(octree.lowest))
        highest_L = np.float32(log_odds(octree.highest))
        self.log_odds = values.clip(lowest_L, highest_L)
        self.lowest = lowest
        self.pose = odom_T_vehicle

    def kept(self, odom_T_vehicle: np.ndarray) -> float:
        """The factor by which the motion since the last scan multiplies all log-odds."""
        if self.pose is None:
            return 1.0
        turn = self.pose[:3, :3].T @ odom_T_vehicle[:3, :3]
        moved_m = float(np.linalg.norm(odom_T_vehicle[:3, 3] - self.pose[:3, 3]))
        return self.octree.kept_share(moved_m, math.atan2(turn[1, 0], turn[0, 0]))


def ends(
    octree: Octree, points_m: np.ndarray, T: np.ndarray, origin: np.ndarray
) -> list[tuple[tuple[float, ...], float]]:
    """The end of each ray in leaves, and its length.

    Rays end at every point, or once in the middle of each cell that holds points. `T` (4, 4) maps
    points to leaves.
    """
    made = {}
    for p in points_m.tolist():
        at = tuple(
            float(T[i, 0] * p[0] + T[i, 1] * p[1] + T[i, 2] * p[2] + T[i, 3]) for i in range(3)
        )
        at = at if octree.rays == "all" else tuple(math.floor(v) + 0.5 for v in at)
        d = [a - float(o) for a, o in zip(at, origin, strict=True)]
        made[at] = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    return list(made.items())


def crossed(origin: np.ndarray, end: np.ndarray) -> list[np.ndarray]:
    """The cells that a ray crosses, from the origin's to the one before the end's.

    Of borders that it meets at once, that on z is crossed first, then that on y.
    """
    cell = np.floor(origin).astype(int)
    last = np.floor(end).astype(int)
    along = (end - origin).tolist()
    with np.errstate(divide="ignore"):
        every = [int(min(float(np.float64(WHOLE) / abs(d)), ENDLESS)) for d in along]
    ahead = [
        float(c + 1 - o if d > 0 else o - c) for c, o, d in zip(cell, origin, along, strict=True)
    ]
    following = [int(a * e) for a, e in zip(ahead, every, strict=True)]
    cells = []
    for _ in range(int(np.abs(last - cell).sum())):
        cells.append(cell.copy())
        axis = min((2, 1, 0), key=lambda i: following[i])
        cell[axis] += 1 if along[axis] > 0 else -1
        following[axis] += every[axis]
    return cells


def inside(cell: np.ndarray, side: int) -> bool:
    """Whether a cell (3,) lies in the cube."""
    return bool((cell >= 0).all() and (cell < side).all())


def moved(values: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The cube's values after it moved by `shift` (3,) leaves; those that enter are unknown."""
    side = len(values)
    found = np.zeros_like(values)
    old = tuple(slice(max(s, 0), max(min(side + s, side), 0)) for s in shift.tolist())
    new = tuple(slice(max(-s, 0), max(min(side - s, side), 0)) for s in shift.tolist())
    found[new] = values[old]
    return found
