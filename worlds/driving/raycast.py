"""Casts rays into the scene of a day: rays in, their ranges, and the kind and brightness of what
they hit out.

Each ray is tested against all moving shapes. Then it steps through the cells of the ground (DDA),
and in each cell it is tested against the shapes there and the ground, until it hits something.

A scan is cast by one thread; blocks of scans run in parallel.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from worlds import Floats
from worlds.driving.hits import Vector, hash_u, hit_box, hit_crown, hit_cylinder
from worlds.driving.scene import Scene
from worlds.layout.ground import height_at
from worlds.layout.shapes import Kind, Records

GROUND_REFLECTANCE = 0.2
RELIEF_CELL_M = 0.7
"""Side of the cubes within which a wall lies equally far before or behind its plane."""
_GROUND = int(Kind.GROUND)
_BUILDING = int(Kind.BUILDING)
_REFINEMENTS = 3
"""Number of steps in which the range to the ground is refined."""
_NEVER = 1e30
"""A range beyond every border of a cell."""


@njit(cache=True, nogil=True, error_model="numpy")
def cast(
    scene: Scene,
    movers: Records,
    origins: Floats,
    world_R_bodies: Floats,
    directions: Floats,
    max_range_m: float,
    seed: np.uint64,
) -> tuple[Floats, NDArray[np.uint8], Floats]:
    """Cast n rays along `directions` (n, 3), unit vectors in the body's frame.

    The body moves while it casts, through p poses: the rays come in p runs of equal length, and run
    i starts at `origins[i]` (p, 3) in the world with the body's rotation `world_R_bodies[i]` (p, 3,
    3). `movers` are moving cylinders, which are not sorted into cells. Random numbers follow from
    `seed`.

    Returns the ranges (n,) in metres, 0 where nothing is hit; the `shapes.Kind` (n,) of what is
    hit; and its brightness (n,), which is reflectance × cosine of incidence.
    """
    n = directions.shape[0]
    ranges_m = np.zeros(n)
    kinds = np.zeros(n, np.uint8)
    brightnesses = np.zeros(n)
    rays_each = n // origins.shape[0]
    for ray in range(n):
        origin = origins[ray // rays_each]
        start = origin[0], origin[1], origin[2]
        world_R_body = world_R_bodies[ray // rays_each]
        body = directions[ray]
        dx = (
            world_R_body[0, 0] * body[0]
            + world_R_body[0, 1] * body[1]
            + world_R_body[0, 2] * body[2]
        )
        dy = (
            world_R_body[1, 0] * body[0]
            + world_R_body[1, 1] * body[1]
            + world_R_body[1, 2] * body[2]
        )
        dz = (
            world_R_body[2, 0] * body[0]
            + world_R_body[2, 1] * body[1]
            + world_R_body[2, 2] * body[2]
        )
        direction = dx, dy, dz
        # Find the nearest mover first, then whatever stands nearer.
        range_m = max_range_m
        kind = 0
        brightness = 0.0
        for mover in movers:
            hit_m, cosine = hit_cylinder(mover, start, direction)
            if 0 < hit_m < range_m:
                range_m = hit_m
                kind = mover.kind
                brightness = cosine * mover.reflectance
        range_m, kind, brightness = _first_hit(
            scene, start, direction, range_m, kind, brightness, ray, seed
        )
        if kind == _BUILDING and scene.relief_m > 0:
            range_m += scene.relief_m * _relief(
                start[0] + range_m * dx, start[1] + range_m * dy, start[2] + range_m * dz
            )
        if kind > 0:
            ranges_m[ray] = range_m
            kinds[ray] = kind
            brightnesses[ray] = brightness
    return ranges_m, kinds, brightnesses


@njit(cache=True, nogil=True, error_model="numpy")
def _relief(x_m: float, y_m: float, z_m: float) -> float:
    """How far a wall lies behind its plane at a point, from −1 to 1."""
    i = int(np.floor(x_m / RELIEF_CELL_M))
    j = int(np.floor(y_m / RELIEF_CELL_M))
    k = int(np.floor(z_m / RELIEF_CELL_M))
    # The cube's three indices are hashed, the one of height as the seed, to a number in (0, 1).
    return 2.0 * hash_u(np.uint64(k), i, j) - 1.0  # type: ignore[no-any-return]


@njit(cache=True, nogil=True, error_model="numpy")
def _first_hit(
    scene: Scene,
    origin: Vector,
    direction: Vector,
    range_m: float,
    kind: int,
    brightness: float,
    ray: int,
    seed: np.uint64,
) -> tuple[float, int, float]:
    """Range, kind and brightness of the first hit of a ray."""
    (ox, oy, oz) = origin
    (dx, dy, dz) = direction
    # 1. Find the ray's first cell, the ranges to its next borders in x and y, and those between
    # one border and the next.
    rows = scene.heights_m.shape[0] - 1
    columns = scene.heights_m.shape[1] - 1
    i = int(np.floor((ox - scene.x0_m) / scene.cell_m))
    j = int(np.floor((oy - scene.y0_m) / scene.cell_m))
    step_i = 1 if dx > 0 else -1
    step_j = 1 if dy > 0 else -1
    gap_x = scene.cell_m / abs(dx) if dx != 0 else _NEVER
    gap_y = scene.cell_m / abs(dy) if dy != 0 else _NEVER
    next_x = (scene.x0_m + (i + (dx > 0)) * scene.cell_m - ox) / dx if dx != 0 else _NEVER
    next_y = (scene.y0_m + (j + (dy > 0)) * scene.cell_m - oy) / dy if dy != 0 else _NEVER
    enter = 0.0
    above_in = _above_ground(scene, ox, oy, oz)
    # 2. Go from cell to cell.
    while 0 <= i < rows and 0 <= j < columns:
        leave = min(next_x, next_y)
        cell = i * columns + j
        lowest_z = oz + min(enter * dz, min(leave, range_m) * dz)  # of the ray within this cell
        if lowest_z <= scene.tops_m[cell]:
            for item in range(scene.starts[cell], scene.starts[cell + 1]):
                hit_m, hit_brightness, shape_kind = _hit(
                    scene, scene.items[item], origin, direction, ray, seed
                )
                if 0 < hit_m < range_m:
                    range_m = hit_m
                    kind = shape_kind
                    brightness = hit_brightness
        end = min(leave, range_m)
        above_out = _above_ground(scene, ox + end * dx, oy + end * dy, oz + end * dz)
        if above_out < 0:
            hit_m = _ground_hit(scene, origin, direction, enter, above_in, end, above_out)
            # How fast the ray nears the ground is about the cosine of incidence; 1e-6 m, since the
            # part of the ray in this cell may have no length.
            cosine = (above_in - above_out) / max(end - enter, 1e-6)
            return hit_m, _GROUND, GROUND_REFLECTANCE * min(cosine, 1.0)
        if range_m <= leave:
            break
        enter = leave
        above_in = above_out
        if next_x < next_y:
            i += step_i
            next_x += gap_x
        else:
            j += step_j
            next_y += gap_y
    return range_m, kind, brightness


@njit(cache=True, nogil=True, error_model="numpy")
def _hit(
    scene: Scene, shape: int, origin: Vector, direction: Vector, ray: int, seed: np.uint64
) -> tuple[float, float, int]:
    """Range, brightness and kind of the hit of a ray on one shape; a negative range is a miss."""
    if shape < scene.boxes.shape[0]:
        box = scene.boxes[shape]
        u = hash_u(seed, ray, shape) if box.extinction_per_m > 0 else 1.0
        hit_m, cosine = hit_box(box, origin, direction, u)
        return hit_m, cosine * box.reflectance, box.kind
    number = shape - scene.boxes.shape[0]
    if number < scene.cylinders.shape[0]:
        cylinder = scene.cylinders[number]
        hit_m, cosine = hit_cylinder(cylinder, origin, direction)
        return hit_m, cosine * cylinder.reflectance, cylinder.kind
    crown = scene.crowns[number - scene.cylinders.shape[0]]
    hit_m, cosine = hit_crown(crown, origin, direction, hash_u(seed, ray, shape))
    return hit_m, cosine * crown.reflectance, crown.kind


@njit(cache=True, nogil=True, error_model="numpy")
def _above_ground(scene: Scene, x_m: float, y_m: float, z_m: float) -> float:
    """Height of a point above the ground in metres."""
    ground_m = height_at(scene.heights_m, scene.x0_m, scene.y0_m, scene.cell_m, x_m, y_m)
    return z_m - ground_m  # type: ignore[no-any-return]


@njit(cache=True, nogil=True, error_model="numpy")
def _ground_hit(
    scene: Scene,
    origin: Vector,
    direction: Vector,
    enter: float,
    above_in: float,
    end: float,
    above_out: float,
) -> float:
    """Range at which a ray meets the ground, found by false position."""
    (ox, oy, oz) = origin
    (dx, dy, dz) = direction
    hit_m = enter
    for _ in range(_REFINEMENTS):
        hit_m = enter + (end - enter) * above_in / (above_in - above_out) if above_in > 0 else enter
        above = _above_ground(scene, ox + hit_m * dx, oy + hit_m * dy, oz + hit_m * dz)
        if above > 0:
            enter = hit_m
            above_in = above
        else:
            end = hit_m
            above_out = above
    return hit_m
