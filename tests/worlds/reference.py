"""The ray caster again, by brute force in numpy: every ray is tested against every shape, and walks
over the ground in small steps.

Tests compare the compiled ray caster with it.
"""

import numpy as np

from worlds.driving.hits import hash_u
from worlds.driving.scene import Scene
from worlds.layout.shapes import Kind

GROUND_STEP_M = 0.05


def cast(scene: Scene, movers, origin, directions, max_range_m, seed):
    """Ranges (n,) and kinds (n,) of what rays from `origin` (3,) along `directions` (n, 3) hit.

    Both are in the world. A range is 0 where nothing is hit.
    """
    ranges = np.full(len(directions), max_range_m)
    kinds = np.zeros(len(directions), int)
    numbers = range(len(scene.boxes) + len(scene.cylinders) + len(scene.crowns))
    for ray, direction in enumerate(directions):
        u = np.array([hash_u(seed, ray, number) for number in numbers])
        boxes, _, crowns = np.split(u, np.cumsum([len(scene.boxes), len(scene.cylinders)]))
        hits = [
            (_boxes(scene.boxes, origin, direction, boxes), scene.boxes["kind"]),
            (_cylinders(scene.cylinders, origin, direction), scene.cylinders["kind"]),
            (_cylinders(movers, origin, direction), movers["kind"]),
            (_crowns(scene.crowns, origin, direction, crowns), scene.crowns["kind"]),
            (_ground(scene, origin, direction, max_range_m), np.array([Kind.GROUND])),
        ]
        at = np.concatenate([hit[0] for hit in hits])
        kind = np.concatenate([hit[1] for hit in hits])
        first = at.argmin()
        if at[first] < max_range_m:
            ranges[ray] = at[first]
            kinds[ray] = kind[first]
    return np.where(kinds > 0, ranges, 0.0), kinds


def _boxes(boxes, origin, direction, u):
    """Ranges (box,) to boxes, infinite where they are missed, by the slabs of each box."""
    turn = (
        np.stack([boxes["cos_yaw"], boxes["sin_yaw"]]),
        np.stack([-boxes["sin_yaw"], boxes["cos_yaw"]]),
    )
    start = np.stack([origin[0] - boxes["x_m"], origin[1] - boxes["y_m"]])
    half_m = np.stack([boxes["half_length_m"], boxes["half_width_m"]])
    local = np.stack([(axis * start).sum(0) for axis in turn])
    step = np.stack([(axis * direction[:2, None]).sum(0) for axis in turn])
    low = np.concatenate(
        [(-half_m - local) / step, [(boxes["bottom_m"] - origin[2]) / direction[2]]]
    )
    high = np.concatenate([(half_m - local) / step, [(boxes["top_m"] - origin[2]) / direction[2]]])
    enter = np.minimum(low, high).max(0)
    leave = np.maximum(low, high).min(0)
    meets = (enter <= leave) & (enter > 0)
    porous = boxes["extinction_per_m"] > 0
    stop = enter - np.where(porous, np.log(u) / np.where(porous, boxes["extinction_per_m"], 1), 0)
    return np.where(meets & (stop <= leave), stop, np.inf)


def _cylinders(cylinders, origin, direction):
    """Ranges (cylinder,) to cylinders: the roots of |o + t d − c|² = r² in the plane."""
    off = np.stack([origin[0] - cylinders["x_m"], origin[1] - cylinders["y_m"]])
    a = (direction[:2] ** 2).sum()
    b = (off * direction[:2, None]).sum(0)
    inside = b**2 - a * ((off**2).sum(0) - cylinders["radius_m"] ** 2)
    enter = (-b - np.sqrt(np.maximum(inside, 0))) / a
    z_m = origin[2] + enter * direction[2]
    meets = (
        (inside > 0) & (enter > 0) & (z_m >= cylinders["bottom_m"]) & (z_m <= cylinders["top_m"])
    )
    return np.where(meets, enter, np.inf)


def _crowns(crowns, origin, direction, u):
    """Ranges (crown,) at which crowns stop the ray, infinite where they do not."""
    size = np.stack([crowns["radius_m"], crowns["radius_m"], crowns["half_height_m"]])
    off = (origin[:, None] - np.stack([crowns["x_m"], crowns["y_m"], crowns["z_m"]])) / size
    way = direction[:, None] / size
    a = (way**2).sum(0)
    b = (off * way).sum(0)
    inside = b**2 - a * ((off**2).sum(0) - 1)
    half = np.sqrt(np.maximum(inside, 0))
    stop = np.maximum((-b - half) / a, 0) - np.log(u) / crowns["extinction_per_m"]
    return np.where((inside > 0) & (stop <= (half - b) / a), stop, np.inf)


def _ground(scene, origin, direction, max_range_m):
    """The range (1,) to the ground, interpolated between two steps."""
    t = np.arange(0, max_range_m, GROUND_STEP_M)
    x, y, z = origin[:, None] + t * direction[:, None]
    u = (x - scene.x0_m) / scene.cell_m
    v = (y - scene.y0_m) / scene.cell_m
    knots = scene.heights_m
    inside = (u >= 0) & (v >= 0) & (u < knots.shape[0] - 1) & (v < knots.shape[1] - 1)
    u = u[inside]
    v = v[inside]
    z = z[inside]
    t = t[inside]
    i = u.astype(int)
    j = v.astype(int)
    a = u - i
    b = v - j
    height = (knots[i, j] * (1 - a) + knots[i + 1, j] * a) * (1 - b) + (
        knots[i, j + 1] * (1 - a) + knots[i + 1, j + 1] * a
    ) * b
    above = z - height
    below = np.flatnonzero(above < 0)
    if not len(below):
        return np.array([np.inf])
    k = below[0]
    return np.array([t[k] - GROUND_STEP_M * above[k] / (above[k] - above[k - 1])])
