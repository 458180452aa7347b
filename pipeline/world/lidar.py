"""A 32-beam spinning lidar (HDL-32E) on a pole: what it sees from one pose, and what of that comes back."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.world.hits import hash_u
from pipeline.world.raycast import cast
from pipeline.world.scene import Scene
from pipeline.world.shapes import Records

BEAMS = 32
ELEVATIONS_DEG = (-30.67, 10.67)
HEIGHT_M = 1.3
MIN_RANGE_M, MAX_RANGE_M = 0.9, 90.0
RANGE_SD_M = 0.02
DROP_OUT = 0.03
RANGE_AT_TENTH_M = 100.0
"""How far a surface of reflectance × cosine 0.1 is still likely to return; it makes ground rings end near 30 m."""
_DROP, _FADE, _NOISE_RADIUS, _NOISE_ANGLE = 900_001, 900_002, 900_003, 900_004
"""Draws beyond every shape's number, so that they share no random number with foliage."""


@dataclass(frozen=True)
class Returns:
    """One scan."""

    points_m: NDArray[np.float32]
    """(n, 3) in the body frame: x forward, y left, z up, origin on the ground under the robot."""
    intensity: NDArray[np.uint8]
    laser: NDArray[np.uint8]
    """(n,) 0 is the lowest beam."""
    kind: NDArray[np.uint8]
    """(n,) what each point lies on, a `shapes.Kind`."""


@dataclass(frozen=True)
class Lidar:
    """Rays in the order that the sensor fires them: azimuth by azimuth, all beams of one at once."""

    azimuths: int

    def directions(self) -> NDArray[np.float64]:
        """Unit vectors (azimuths × BEAMS, 3) in the body frame."""
        elevation = np.deg2rad(np.linspace(*ELEVATIONS_DEG, BEAMS))[None, :]
        azimuth = np.linspace(0, 2 * np.pi, self.azimuths, endpoint=False)[:, None]
        level = np.cos(elevation)
        rays = np.stack(np.broadcast_arrays(level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)), -1)
        return np.ascontiguousarray(rays.reshape(-1, 3))

    def scan(self, scene: Scene, movers: Records, world_T_body: NDArray[np.float64], seed: np.uint64) -> Returns:
        """What the lidar records, in one instant, HEIGHT_M above the body's origin along its own z axis."""
        directions = self.directions()
        origin = world_T_body[:3, 3] + HEIGHT_M * world_T_body[:3, 2]
        rotation = np.ascontiguousarray(world_T_body[:3, :3])
        true_m, kinds, brightness = cast(scene, movers, origin, rotation, directions, MAX_RANGE_M, seed)
        ranges_m = measure(true_m, brightness, seed)
        back = np.flatnonzero(ranges_m > MIN_RANGE_M)
        points_m = directions[back] * ranges_m[back, None] + (0.0, 0.0, HEIGHT_M)
        intensity = np.rint(255 * brightness[back]).clip(0, 255).astype(np.uint8)
        return Returns(points_m.astype(np.float32), intensity, (back % BEAMS).astype(np.uint8), kinds[back])


def return_probability(range_m: NDArray[np.float64], brightness: NDArray[np.float64]) -> NDArray[np.float64]:
    """exp(−(r / rm)⁴), rm = RANGE_AT_TENTH_M √(brightness / 0.1): the law that `measure` draws from."""
    reach_m = RANGE_AT_TENTH_M * np.sqrt(np.maximum(brightness, 1e-5) / 0.1)
    return np.asarray(np.exp(-((range_m / reach_m) ** 4)))


@njit(cache=True, nogil=True, error_model="numpy")
def measure(true_m: NDArray[np.float64], brightness: NDArray[np.float64], seed: np.uint64) -> NDArray[np.float64]:
    """Measured ranges (n,) for true ones (0: nothing there); 0 where nothing comes back."""
    measured_m = np.zeros(true_m.shape[0])
    for ray in range(true_m.shape[0]):
        if true_m[ray] <= 0:
            continue
        share = true_m[ray] / (RANGE_AT_TENTH_M * np.sqrt(max(brightness[ray], 1e-5) / 0.1))
        if hash_u(seed, ray, _DROP) < DROP_OUT or hash_u(seed, ray, _FADE) > np.exp(-(share**4)):
            continue
        radius = np.sqrt(-2 * np.log(hash_u(seed, ray, _NOISE_RADIUS)))
        noise = radius * np.cos(2 * np.pi * hash_u(seed, ray, _NOISE_ANGLE))
        measured_m[ray] = true_m[ray] + RANGE_SD_M * noise
    return measured_m
