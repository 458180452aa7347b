"""What wheels and gyroscope make of a drive: the true motion with a scale error, a turning bias and white noise, summed up."""

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.frames import Poses

SCALE_SD = 0.01
SLIP_SD_M_PER_SQRT_M = 0.01
YAW_BIAS_SD_DEG_PER_M = 0.02
YAW_SD_DEG_PER_SQRT_M = 0.1


def integrate(rng: np.random.Generator, world_T_body: Poses) -> Poses:
    """Poses (n, 4, 4) in a frame of their own, the body's at the first row.

    Roll and pitch come from gravity and do not drift; position and heading do.
    """
    motion = np.linalg.inv(world_T_body[:-1]) @ world_T_body[1:]
    metres = np.linalg.norm(motion[:, :3, 3], axis=1)
    scale, bias_deg = 1 + rng.normal(0, SCALE_SD), rng.normal(0, YAW_BIAS_SD_DEG_PER_M)
    drift_deg = bias_deg * metres + rng.normal(0, YAW_SD_DEG_PER_SQRT_M, len(metres)) * np.sqrt(metres)
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
