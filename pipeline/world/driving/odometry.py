"""Sensor models for poses: odometry, and an INS with outages.

Odometry has a scale error, a turning bias and white noise.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.frames import Poses
from pipeline.world.layout.streets import driven_m

SCALE_SD = 0.01
SLIP_SD_M_PER_SQRT_M = 0.01
YAW_BIAS_SD_DEG_PER_M = 0.02
YAW_SD_DEG_PER_SQRT_M = 0.1

VISUAL_SLIP_SD_M_PER_SQRT_M = (0.01, 0.005, 0.005)
VISUAL_YAW_BIAS_SD_DEG_PER_M = 0.008
VISUAL_TURN_SD_DEG_PER_SQRT_M = (0.02, 0.02, 0.03)
"""For roll, pitch and yaw."""

OUTAGE_GAPS_M = (100.0, 500.0)
OUTAGE_LENGTHS_M = (20.0, 60.0)
DRIFTS_M_PER_M = (0.1, 0.3)


def wheel_odometry(rng: np.random.Generator, world_T_body: Poses) -> Poses:
    """Poses (n, 4, 4) integrated from wheels and gyroscope, in the frame of the body at the first
    row.

    Position and heading drift; roll and pitch do not, since gravity is measured.
    """
    motion = np.linalg.inv(world_T_body[:-1]) @ world_T_body[1:]
    metres = np.linalg.norm(motion[:, :3, 3], axis=1)
    scale = 1 + rng.normal(0, SCALE_SD)
    bias_deg = rng.normal(0, YAW_BIAS_SD_DEG_PER_M)
    drift_deg = bias_deg * metres + rng.normal(0, YAW_SD_DEG_PER_SQRT_M, len(metres)) * np.sqrt(
        metres
    )
    slip_m = rng.normal(0, SLIP_SD_M_PER_SQRT_M, (len(metres), 2)) * np.sqrt(metres)[:, None]

    angles = Rotation.from_matrix(world_T_body[:, :3, :3]).as_euler("ZYX")
    angles[:, 0] += np.deg2rad(np.concatenate([[0.0], np.cumsum(drift_deg)]))
    rotations = Rotation.from_euler("ZYX", angles)
    moved_m = scale * motion[:, :3, 3]
    moved_m[:, :2] += slip_m

    level = np.tile(np.eye(4), (len(world_T_body), 1, 1))
    level[:, :3, :3] = rotations.as_matrix()
    level[1:, :3, 3] = np.cumsum(rotations[:-1].apply(moved_m), axis=0)
    return np.asarray(np.linalg.inv(level[0]) @ level)


def wheel_covariances(world_T_body: Poses) -> NDArray[np.float64]:
    """Covariance (n, 6, 6) of each motion that `wheel_odometry` reports, since the row before.

    Of x, y, z in metres and roll, pitch, heading in radians; zero in the first row. It follows from
    the model's own deviations. A drive's scale and bias are one draw, so over a drive errors exceed
    what independent motions would gather.
    """
    motion = np.linalg.inv(world_T_body[:-1]) @ world_T_body[1:]
    moved_m = motion[:, :3, 3]
    metres = np.linalg.norm(moved_m, axis=1)
    variances = np.zeros((len(world_T_body), 6))
    variances[1:, :3] = (SCALE_SD * moved_m) ** 2
    variances[1:, :2] += SLIP_SD_M_PER_SQRT_M**2 * metres[:, None]
    yaw_deg2 = (YAW_BIAS_SD_DEG_PER_M * metres) ** 2 + YAW_SD_DEG_PER_SQRT_M**2 * metres
    variances[1:, 5] = np.deg2rad(1) ** 2 * yaw_deg2
    return variances[:, :, None] * np.eye(6)


def visual_odometry(rng: np.random.Generator, world_T_camera: Poses) -> Poses:
    """Poses (n − 1, 4, 4) of stereo visual odometry, each in the frame of the previous one.

    All angles drift.
    """
    motion = np.linalg.inv(world_T_camera[:-1]) @ world_T_camera[1:]
    metres = np.linalg.norm(motion[:, :3, 3], axis=1)[:, None]
    scale = 1 + rng.normal(0, SCALE_SD)
    bias_deg = rng.normal(0, VISUAL_YAW_BIAS_SD_DEG_PER_M)
    turn_deg = rng.normal(0, VISUAL_TURN_SD_DEG_PER_SQRT_M, (len(metres), 3)) * np.sqrt(metres)
    turn_deg[:, 2] += bias_deg * metres[:, 0]
    slip_m = rng.normal(0, VISUAL_SLIP_SD_M_PER_SQRT_M, (len(metres), 3)) * np.sqrt(metres)
    motion[:, :3, :3] @= Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    motion[:, :3, 3] = scale * motion[:, :3, 3] + slip_m
    return motion


def simulate_ins(rng: np.random.Generator, world_T_body: Poses) -> tuple[Poses, NDArray[np.bool_]]:
    """The poses (n, 4, 4) that an INS reports for the true ones, and which of them are good (n,).

    There are about three outages a kilometre, tens of metres each, in which the position drifts to
    one side.
    """
    passed_m = driven_m(world_T_body[:, :2, 3])
    reported = world_T_body.copy()
    good = np.ones(len(world_T_body), bool)
    start_m = rng.uniform(*OUTAGE_GAPS_M)
    while start_m < passed_m[-1]:
        end_m = start_m + rng.uniform(*OUTAGE_LENGTHS_M)
        drift = rng.uniform(*DRIFTS_M_PER_M)
        towards = rng.uniform(0, 2 * np.pi)
        blind = (start_m <= passed_m) & (passed_m < end_m)
        reported[blind, :2, 3] += (
            drift * (passed_m[blind] - start_m)[:, None] * (np.cos(towards), np.sin(towards))
        )
        good[blind] = False
        start_m = end_m + rng.uniform(*OUTAGE_GAPS_M)
    return reported, good
