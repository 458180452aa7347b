"""The scanners: their rays, their place on a robot, and a model of range noise and lost returns."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.frames import NED_FLIP, Poses, pose
from pipeline.formats.robotcar import EXTRINSICS
from pipeline.world import Floats
from pipeline.world.driving.hits import hash_u
from pipeline.world.driving.raycast import cast
from pipeline.world.driving.scene import Scene
from pipeline.world.layout.shapes import Records

HDL32_DEG = np.linspace(-30.67, 10.67, 32)
HDL32_HEIGHT_M = 1.3
HDL32_INVERTED_HEIGHT_M = 0.96
"""NCLT's Segway carries it upside down (METHODS 7.1): most of its beams look up."""
HDL64_DEG = np.concatenate([np.linspace(-24.8, -8.87, 32), np.linspace(-8.33, 2.0, 32)])
HDL64_HEIGHT_M = 1.73
"""The lower half of the beams of an HDL-64E is spaced by half a degree, the upper half by a
third."""
LMS_DEG = (-135.0, 135.0)
LMS_HEIGHT_M = 0.9
CAMERA_HEIGHT_M = LMS_HEIGHT_M + EXTRINSICS["lms_front"][2]
"""Height of the stereo camera, the origin of RobotCar's vehicle frame, above the ground."""
_DROP = 900_001
_FADE = 900_002
_NOISE_RADIUS = 900_003
_NOISE_ANGLE = 900_004
"""Draws larger than the number of any shape, so that they share no random number with foliage."""


@dataclass(frozen=True)
class Returns:
    """One scan, or one sweep."""

    points_m: Floats
    """(n, 3) in metres in the sensor's frame."""
    intensity: NDArray[np.uint8]
    laser: NDArray[np.uint8]
    """(n,) 0 is the lowest beam."""
    kind: NDArray[np.uint8]
    """(n,) the `shapes.Kind` of the surface of each point."""
    times_s: Floats | None = None
    """(n,) after the stamp at which each point was measured, in the sensor's frame of that moment;
    None: all at the stamp."""


@dataclass(frozen=True)
class Lidar:
    """A scanner on a robot."""

    directions: Floats
    """(ray, 3) unit vectors in the sensor's frame, in the order that they are fired: all beams of
    one azimuth at once."""
    beams: int
    body_T_sensor: Poses
    """(4, 4); the origin of the body lies on the ground under the robot."""
    min_range_m: float = 0.9
    max_range_m: float = 90.0
    range_sd_m: float = 0.02
    drop_out: float = 0.03
    reach_m: float = 100.0
    """Range at which a surface of reflectance × cosine 0.1 returns with probability 1/e; 100 m ends
    ground rings near 30 m."""
    turn_s: float = 0.0
    """How long a turn takes, in which the robot moves on; 0: all rays are fired at once."""

    @property
    def fired_s(self) -> Floats:
        """Moments (p,) after the stamp at which the beams are fired: one for each azimuth, or one
        for all."""
        if not self.turn_s:
            return np.zeros(1)
        azimuths = len(self.directions) // self.beams
        return np.asarray(np.arange(azimuths) * (self.turn_s / azimuths), np.float64)

    def scan(self, scene: Scene, movers: Records, world_T_body: Poses, seed: np.uint64) -> Returns:
        """One scan of a robot at `world_T_body` (p, 4, 4), its poses at the moments `fired_s`.

        People and cars stand still meanwhile.
        """
        poses = list(world_T_body)
        origins = np.stack(
            [pose[:3, 3] + pose[:3, :3] @ self.body_T_sensor[:3, 3] for pose in poses]
        )
        rotations = np.stack([pose[:3, :3] @ self.body_T_sensor[:3, :3] for pose in poses])
        true_m, kinds, brightness = cast(
            scene, movers, origins, rotations, self.directions, self.max_range_m, seed
        )
        ranges_m = measure(true_m, brightness, self.range_sd_m, self.drop_out, self.reach_m, seed)
        back = np.flatnonzero(ranges_m > self.min_range_m)
        intensity = np.rint(255 * brightness[back]).clip(0, 255).astype(np.uint8)
        points_m = self.directions[back] * ranges_m[back, None]
        laser = (back % self.beams).astype(np.uint8)
        times_s = self.fired_s[back // self.beams] if self.turn_s else None
        return Returns(points_m, intensity, laser, kinds[back], times_s)


def hdl32(azimuths: int) -> Lidar:
    """A 32-beam spinning lidar on a pole."""
    return Lidar(_turning(HDL32_DEG, azimuths), 32, raised(HDL32_HEIGHT_M))


def hdl32_inverted(azimuths: int) -> Lidar:
    """The same upside down and lower, as NCLT's Segway carries it."""
    return Lidar(_turning(-HDL32_DEG[::-1], azimuths), 32, raised(HDL32_INVERTED_HEIGHT_M))


def hdl64(azimuths: int) -> Lidar:
    """A 64-beam spinning lidar on a car's roof."""
    return Lidar(
        _turning(HDL64_DEG, azimuths), 64, raised(HDL64_HEIGHT_M), min_range_m=2.5, reach_m=150.0
    )


def lms151(rays: int) -> Lidar:
    """A push-broom at the front of a car, mounted as lms_front of RobotCar: `rays` in its plane z =
    0; its x axis points down."""
    angles = np.deg2rad(np.linspace(*LMS_DEG, rays))
    fan = np.stack([np.cos(angles), np.sin(angles), np.zeros(rays)], 1)
    xyzrpy = np.array([EXTRINSICS["lms_front"]])
    body_T_sensor = raised(CAMERA_HEIGHT_M) @ NED_FLIP @ pose(xyzrpy[:, :3], xyzrpy[:, 3:])[0]
    return Lidar(
        fan,
        1,
        body_T_sensor,
        min_range_m=0.5,
        max_range_m=50.0,
        range_sd_m=0.03,
        drop_out=0.02,
        reach_m=60.0,
    )


def _turning(elevations_deg: Floats, azimuths: int) -> Floats:
    """Rays (azimuths × beams, 3) of a sensor that turns about its z axis."""
    elevation = np.deg2rad(elevations_deg)[None, :]
    azimuth = np.linspace(0, 2 * np.pi, azimuths, endpoint=False)[:, None]
    level = np.cos(elevation)
    rays = np.stack(
        np.broadcast_arrays(level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)), -1
    )
    return np.ascontiguousarray(rays.reshape(-1, 3))


def raised(height_m: float) -> Poses:
    """The pose (4, 4) of a frame so far above another."""
    return np.asarray(pose(np.array([[0.0, 0.0, height_m]]), np.zeros((1, 3)))[0])


@njit(cache=True, nogil=True, error_model="numpy")
def measure(
    true_m: Floats,
    brightness: Floats,
    range_sd_m: float,
    drop_out: float,
    reach_m: float,
    seed: np.uint64,
) -> Floats:
    """Measured ranges (n,) for true ones (0: no surface); 0 where no light returns.

    A return at range r has probability exp(−(r / rm)⁴), rm = reach_m √(brightness / 0.1), less the
    share `drop_out`.
    """
    measured_m = np.zeros(true_m.shape[0])
    for ray in range(true_m.shape[0]):
        if true_m[ray] <= 0:
            continue
        share = true_m[ray] / (reach_m * np.sqrt(max(brightness[ray], 1e-5) / 0.1))
        if hash_u(seed, ray, _DROP) < drop_out or hash_u(seed, ray, _FADE) > np.exp(-(share**4)):
            continue
        radius = np.sqrt(-2 * np.log(hash_u(seed, ray, _NOISE_RADIUS)))
        noise = radius * np.cos(2 * np.pi * hash_u(seed, ray, _NOISE_ANGLE))
        measured_m[ray] = true_m[ray] + range_sd_m * noise
    return measured_m
