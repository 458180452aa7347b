"""Sensor models for poses: the true poses of a drive in, what odometry or an INS reports out.

Odometry has a scale error, a turning bias and white noise, so that it drifts. An INS has outages,
in which its position drifts to one side.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.frames import Poses
from worlds.layout.streets import driven_m

# Standard deviations of the errors. Scale and bias are drawn once a drive; the others are white
# noise, whose deviation grows with the root of the path.
SCALE_SD = 0.01
"""Relative error of distances."""
SLIP_SD_M_PER_SQRT_M = 0.01
"""Error of x and of y."""
YAW_BIAS_SD_DEG_PER_M = 0.02
YAW_SD_DEG_PER_SQRT_M = 0.1

VISUAL_SLIP_SD_M_PER_SQRT_M = (0.01, 0.005, 0.005)
"""Errors of x, y and z."""
VISUAL_YAW_BIAS_SD_DEG_PER_M = 0.008
VISUAL_TURN_SD_DEG_PER_SQRT_M = (0.02, 0.02, 0.03)
"""Errors of roll, pitch and yaw."""

# Bounds of random numbers of the INS.
OUTAGE_GAP_BOUNDS_M = (100.0, 500.0)
"""Path between two outages."""
OUTAGE_LENGTH_BOUNDS_M = (20.0, 60.0)
"""Path of an outage."""
DRIFT_BOUNDS_M_PER_M = (0.1, 0.3)
"""Drift of the position per metre of path."""


def wheel_odometry(rng: np.random.Generator, world_T_body: Poses) -> Poses:
    """The poses (n, 4, 4) that wheels and gyroscope report, relative to the first one.

    Position and heading drift; roll and pitch do not, since gravity is measured.
    """
    # 1. Draw the errors of each motion.
    motion = np.linalg.inv(world_T_body[:-1]) @ world_T_body[1:]
    lengths_m = np.linalg.norm(motion[:, :3, 3], axis=1)
    scale = 1 + rng.normal(0, SCALE_SD)
    bias_deg = rng.normal(0, YAW_BIAS_SD_DEG_PER_M)
    yaw_noise_deg = rng.normal(0, YAW_SD_DEG_PER_SQRT_M, len(lengths_m)) * np.sqrt(lengths_m)
    drift_deg = bias_deg * lengths_m + yaw_noise_deg
    slip_m = rng.normal(0, SLIP_SD_M_PER_SQRT_M, (len(lengths_m), 2)) * np.sqrt(lengths_m)[:, None]

    # 2. Add them to headings and motions.
    angles = Rotation.from_matrix(world_T_body[:, :3, :3]).as_euler("ZYX")
    angles[:, 0] += np.deg2rad(np.concatenate([[0.0], np.cumsum(drift_deg)]))
    rotations = Rotation.from_euler("ZYX", angles)
    moved_m = scale * motion[:, :3, 3]
    moved_m[:, :2] += slip_m

    # 3. Sum the motions up.
    drifted = np.tile(np.eye(4), (len(world_T_body), 1, 1))
    drifted[:, :3, :3] = rotations.as_matrix()
    drifted[1:, :3, 3] = np.cumsum(rotations[:-1].apply(moved_m), axis=0)
    return np.asarray(np.linalg.inv(drifted[0]) @ drifted)


def wheel_covariances(world_T_body: Poses) -> NDArray[np.float64]:
    """Covariance (n, 6, 6) of each motion of `wheel_odometry` since the row before.

    It is that of x, y, z in metres and roll, pitch, heading in radians, zero in the first row, and
    follows from the standard deviations above. Since scale and bias are drawn once a drive, errors
    grow faster over a drive than these covariances would if motions were independent.
    """
    motion = np.linalg.inv(world_T_body[:-1]) @ world_T_body[1:]
    moved_m = motion[:, :3, 3]
    lengths_m = np.linalg.norm(moved_m, axis=1)
    variances = np.zeros((len(world_T_body), 6))
    variances[1:, :3] = (SCALE_SD * moved_m) ** 2
    variances[1:, :2] += SLIP_SD_M_PER_SQRT_M**2 * lengths_m[:, None]
    yaw_deg2 = (YAW_BIAS_SD_DEG_PER_M * lengths_m) ** 2 + YAW_SD_DEG_PER_SQRT_M**2 * lengths_m
    variances[1:, 5] = np.deg2rad(1) ** 2 * yaw_deg2
    # a diagonal matrix for each row
    return variances[:, :, None] * np.eye(6)


def visual_odometry(rng: np.random.Generator, world_T_camera: Poses) -> Poses:
    """The motions (n − 1, 4, 4) that stereo visual odometry reports, each in the previous frame.

    All three angles drift.
    """
    motion = np.linalg.inv(world_T_camera[:-1]) @ world_T_camera[1:]
    lengths_m = np.linalg.norm(motion[:, :3, 3], axis=1)[:, None]
    scale = 1 + rng.normal(0, SCALE_SD)
    bias_deg = rng.normal(0, VISUAL_YAW_BIAS_SD_DEG_PER_M)
    shape = (len(lengths_m), 3)
    turn_deg = rng.normal(0, VISUAL_TURN_SD_DEG_PER_SQRT_M, shape) * np.sqrt(lengths_m)
    turn_deg[:, 2] += bias_deg * lengths_m[:, 0]
    slip_m = rng.normal(0, VISUAL_SLIP_SD_M_PER_SQRT_M, shape) * np.sqrt(lengths_m)
    motion[:, :3, :3] @= Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    motion[:, :3, 3] = scale * motion[:, :3, 3] + slip_m
    return motion


def simulate_ins(rng: np.random.Generator, world_T_body: Poses) -> tuple[Poses, NDArray[np.bool_]]:
    """The poses (n, 4, 4) that an INS reports, and which of them (n,) lie in no outage.

    There are about three outages per kilometre, each tens of metres long, in which the position
    drifts to one side.
    """
    passed_m = driven_m(world_T_body[:, :2, 3])
    reported = world_T_body.copy()
    is_good = np.ones(len(world_T_body), bool)
    start_m = rng.uniform(*OUTAGE_GAP_BOUNDS_M)
    while start_m < passed_m[-1]:
        end_m = start_m + rng.uniform(*OUTAGE_LENGTH_BOUNDS_M)
        drift_per_m = rng.uniform(*DRIFT_BOUNDS_M_PER_M)
        towards = rng.uniform(0, 2 * np.pi)
        is_outage = (start_m <= passed_m) & (passed_m < end_m)
        drift_m = drift_per_m * (passed_m[is_outage] - start_m)
        reported[is_outage, :2, 3] += drift_m[:, None] * (np.cos(towards), np.sin(towards))
        is_good[is_outage] = False
        start_m = end_m + rng.uniform(*OUTAGE_GAP_BOUNDS_M)
    return reported, is_good
