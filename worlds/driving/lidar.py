"""The scanners of the robots: a scene and the robot's poses in, the points of one scan out.

A `Lidar` has rays, a place on the robot, and a model of range noise and lost returns. The ray
caster finds the true ranges, and `measure` what the scanner makes of them.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.frames import NED_FLIP, Poses, pose
from pipeline.formats.robotcar import EXTRINSICS
from worlds import Floats
from worlds.driving.hits import hash_u
from worlds.driving.raycast import cast
from worlds.driving.scene import Scene
from worlds.layout.shapes import Records

HDL32_DEG = np.linspace(-30.67, 10.67, 32)
"""Elevations of the beams of a Velodyne HDL-32E."""
HDL32_HEIGHT_M = 1.3
HDL32_INVERTED_HEIGHT_M = 0.96
"""Height on NCLT's Segway, which carries it upside down (METHODS 7.1): most of its beams look
up."""
HDL64_DEG = np.concatenate([np.linspace(-24.8, -8.87, 32), np.linspace(-8.33, 2.0, 32)])
"""Elevations of the beams of a Velodyne HDL-64E: the lower half is spaced by half a degree, the
upper half by a third."""
HDL64_HEIGHT_M = 1.73
LMS_DEG = (-135.0, 135.0)
"""First and last angle of the sweep of a SICK LMS-151."""
LMS_HEIGHT_M = 0.9
CAMERA_HEIGHT_M = LMS_HEIGHT_M + EXTRINSICS["lms_front"][2]
"""Height of the stereo camera, the origin of RobotCar's vehicle frame, above the ground."""
_DROP = 900_001
_FADE = 900_002
_NOISE_RADIUS = 900_003
_NOISE_ANGLE = 900_004
"""Numbers of the random draws of `measure`. They are larger than the number of any shape, so that
no draw is shared with foliage (`raycast`)."""


@dataclass(frozen=True)
class Returns:
    """The n returns of one scan, or of one sweep."""

    points_m: Floats
    """(n, 3) in metres in the sensor's frame."""
    intensity: NDArray[np.uint8]
    """(n,) reflectance × cosine of incidence, as 0…255."""
    laser: NDArray[np.uint8]
    """(n,) the number of the beam; 0 is the lowest."""
    kind: NDArray[np.uint8]
    """(n,) the `shapes.Kind` of the surface that each point lies on."""
    times_s: Floats | None = None
    """(n,) how long after the stamp each point was measured; it is given in the sensor's frame of
    that moment. None if all are measured at the stamp."""


@dataclass(frozen=True)
class Lidar:
    """A scanner on a robot."""

    directions: Floats
    """(ray, 3) unit vectors in the sensor's frame, in the order in which they are fired. All beams
    of one azimuth are fired at once."""
    beams: int
    """Number of beams."""
    body_T_sensor: Poses
    """(4, 4) its pose on the robot; the body's origin is on the ground under the robot."""
    min_range_m: float = 0.9
    max_range_m: float = 90.0
    range_sd_m: float = 0.02
    """Standard deviation of a measured range."""
    drop_out: float = 0.03
    """Share of the returns that are lost whatever their range."""
    reach_m: float = 100.0
    """Range at which a surface with reflectance × cosine 0.1 returns with probability 1/e. With 100
    m the rings on the ground end near 30 m."""
    turn_s: float = 0.0
    """How long a turn takes, during which the robot moves on; 0 if all rays are fired at once."""

    @property
    def fired_s(self) -> Floats:
        """When rays are fired after the stamp (p,): a moment for each azimuth, or one for all."""
        if not self.turn_s:
            return np.zeros(1)
        azimuths = len(self.directions) // self.beams
        return np.asarray(np.arange(azimuths) * (self.turn_s / azimuths), np.float64)

    def scan(self, scene: Scene, movers: Records, world_T_body: Poses, seed: np.uint64) -> Returns:
        """Take one scan.

        `world_T_body` (p, 4, 4) are the robot's poses at the moments `fired_s`. The `movers`,
        people and cars, stand still meanwhile.
        """
        body_R_sensor = self.body_T_sensor[:3, :3]
        sensor_m = self.body_T_sensor[:3, 3]
        origins = np.stack([pose[:3, 3] + pose[:3, :3] @ sensor_m for pose in world_T_body])
        rotations = np.stack([pose[:3, :3] @ body_R_sensor for pose in world_T_body])
        true_m, kinds, brightness = cast(
            scene,
            movers,
            origins,
            rotations,
            directions=self.directions,
            max_range_m=self.max_range_m,
            seed=seed,
        )
        ranges_m = measure(
            true_m,
            brightness,
            range_sd_m=self.range_sd_m,
            drop_out=self.drop_out,
            reach_m=self.reach_m,
            seed=seed,
        )
        # Rays are fired azimuth by azimuth: ray i is of beam i % beams.
        rays = np.flatnonzero(ranges_m > self.min_range_m)
        points_m = self.directions[rays] * ranges_m[rays, None]
        intensity = np.rint(255 * brightness[rays]).clip(0, 255).astype(np.uint8)
        laser = (rays % self.beams).astype(np.uint8)
        times_s = self.fired_s[rays // self.beams] if self.turn_s else None
        return Returns(points_m, intensity, laser, kinds[rays], times_s)


def hdl32(azimuths: int) -> Lidar:
    """A Velodyne HDL-32E on a pole, with so many azimuths per turn."""
    return Lidar(_turning(HDL32_DEG, azimuths), 32, raised(HDL32_HEIGHT_M))


def hdl32_inverted(azimuths: int) -> Lidar:
    """A Velodyne HDL-32E upside down, as NCLT's Segway carries it."""
    return Lidar(_turning(-HDL32_DEG[::-1], azimuths), 32, raised(HDL32_INVERTED_HEIGHT_M))


def hdl64(azimuths: int) -> Lidar:
    """A Velodyne HDL-64E on a car's roof, with so many azimuths per turn."""
    return Lidar(
        _turning(HDL64_DEG, azimuths), 64, raised(HDL64_HEIGHT_M), min_range_m=2.5, reach_m=150.0
    )


def lms151(rays: int) -> Lidar:
    """A SICK LMS-151 at the front of a car, mounted as RobotCar's lms_front.

    Its `rays` lie in its plane z = 0, and its x axis points down: a push-broom, which sweeps the
    ground as the car moves on.
    """
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
    """Rays (azimuths · beams, 3) of a sensor that turns about its z axis."""
    elevation = np.deg2rad(elevations_deg)[None, :]
    azimuth = np.linspace(0, 2 * np.pi, azimuths, endpoint=False)[:, None]
    x = np.cos(elevation) * np.cos(azimuth)
    y = np.cos(elevation) * np.sin(azimuth)
    rays = np.stack(np.broadcast_arrays(x, y, np.sin(elevation)), -1)
    return np.ascontiguousarray(rays.reshape(-1, 3))


def raised(height_m: float) -> Poses:
    """The pose (4, 4) of a frame that is `height_m` above another."""
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
    """Measured ranges (n,) for true ranges (n,), 0 where nothing returns.

    A true range of 0 stands for no surface. `brightness` (n,) is reflectance × cosine of incidence.
    A surface at range r returns with probability exp(−(r / rm)⁴), rm = reach_m √(brightness / 0.1);
    of these returns the share `drop_out` is lost. The rest get Gaussian noise (Box–Muller).
    """
    measured_m = np.zeros(true_m.shape[0])
    for ray in range(true_m.shape[0]):
        if true_m[ray] <= 0:
            continue
        # r / rm; the least brightness keeps rm above 0.
        share = true_m[ray] / (reach_m * np.sqrt(max(brightness[ray], 1e-5) / 0.1))
        if hash_u(seed, ray, _DROP) < drop_out or hash_u(seed, ray, _FADE) > np.exp(-(share**4)):
            continue
        radius = np.sqrt(-2 * np.log(hash_u(seed, ray, _NOISE_RADIUS)))
        noise = radius * np.cos(2 * np.pi * hash_u(seed, ray, _NOISE_ANGLE))
        measured_m[ray] = true_m[ray] + range_sd_m * noise
    return measured_m
