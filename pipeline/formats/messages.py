"""Decodes ROS messages into arrays (METHODS 7.4), with the frames of REP 103.

Stamps and frames, poses and transforms, laser scans.
"""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses
from pipeline.formats.bag import ODOMETRY, POSE_COVARIANCE, typestore
from pipeline.formats.bag_file import plain

FARTHEST_M = 1e8
"""A position further than this from its origin is damage: the centre of the Earth is 6.4e6 m
away."""


def header(data: bytes, ros: int) -> tuple[int, str]:
    """Stamp in nanoseconds and frame_id of a message that begins with a std_msgs/Header.

    Raises LogError for any other. A ROS 1 message begins with a counter, a CDR one with four bytes,
    of which the second is the byte order; the rest is alike.
    """
    order = "<" if ros == 1 or data[1:2] == b"\1" else ">"
    try:
        seconds, nanoseconds, length = struct.unpack_from(
            order + ("III" if ros == 1 else "iII"), data, 4
        )
        frame = (
            struct.unpack_from(f"{min(length, len(data) + 1)}s", data, 16)[0].rstrip(b"\0").decode()
        )
    except (struct.error, UnicodeDecodeError):
        raise LogError("a message without a whole header") from None
    if seconds < 0 or nanoseconds >= 10**9:
        raise LogError(f"a message stamped {seconds} s and {nanoseconds} ns, which is no time")
    return seconds * 10**9 + nanoseconds, frame_name(frame)


def from_cdr(data: bytes, kind: str) -> Any:
    """A standard message from its bytes as ROS 2 sends them; raises LogError for a broken one."""
    try:
        return typestore(2).deserialize_cdr(data, kind)
    except Exception as error:  # rosbags raises whatever it likes at damaged bytes
        raise LogError(f"a broken {kind.rpartition('/')[2]} ({type(error).__name__})") from None


def frame_name(name: str) -> str:
    """A frame_id as tf2 has it, without the leading slash of old ROS 1 bags.

    Unprintable letters are left out.
    """
    return plain(name, 120).lstrip("/")


def pose_numbers(message: Any, kind: str) -> tuple[float, ...]:
    """Position in metres and quaternion (x, y, z, w) of a message with a pose.

    It is an Odometry, PoseStamped or PoseWithCovarianceStamped.
    """
    pose = message.pose.pose if kind in (ODOMETRY, POSE_COVARIANCE) else message.pose
    return _numbers(pose.position, pose.orientation)


def gathered_variance(message: Any, kind: str) -> tuple[float, float]:
    """Variance of the position in m² (mean of x and y) and of the heading in rad².

    It is that of the pose in an Odometry or PoseWithCovarianceStamped; NaN of any other message.
    """
    if kind not in (ODOMETRY, POSE_COVARIANCE):
        return np.nan, np.nan
    covariance = message.pose.covariance.reshape(6, 6)
    return float(covariance[0, 0] + covariance[1, 1]) / 2, float(covariance[5, 5])


def transform_numbers(stamped: Any) -> tuple[float, ...]:
    """Translation in metres and quaternion (x, y, z, w) of a TransformStamped."""
    return _numbers(stamped.transform.translation, stamped.transform.rotation)


def _numbers(position: Any, turn: Any) -> tuple[float, ...]:
    return position.x, position.y, position.z, turn.x, turn.y, turn.z, turn.w


def poses(numbers: Sequence[tuple[float, ...]]) -> Poses:
    """Poses (n, 4, 4) from positions and quaternions.

    NaN where they are not a place on Earth or not a rotation.
    """
    rows = np.array(numbers, np.float64).reshape(-1, 7)
    with np.errstate(all="ignore"):
        is_pose = (np.abs(rows[:, :3]) <= FARTHEST_M).all(axis=1) & (
            np.abs(np.linalg.norm(rows[:, 3:], axis=1) - 1) < 0.01
        )
    matrices = np.full((len(rows), 4, 4), np.nan)
    matrices[is_pose] = np.eye(4)
    matrices[is_pose, :3, 3] = rows[is_pose, :3]
    if is_pose.any():
        matrices[is_pose, :3, :3] = Rotation.from_quat(rows[is_pose, 3:]).as_matrix()
    return matrices


def sweep_points(message: Any) -> NDArray[np.float64]:
    """Points (n, 3) in metres of a LaserScan in its frame, at z = 0.

    They are those of the finite ranges from range_min to range_max. A limit that is not finite is
    none, and neither is a range_max of 0, as where a driver left it out. Angles run
    counter-clockwise from +x in steps of angle_increment, which is negative for a scanner mounted
    upside down. Raises LogError for angles that no scanner has.
    """
    start = message.angle_min
    step = message.angle_increment
    near = message.range_min
    far = message.range_max
    if not np.isfinite([start, step]).all() or max(abs(start), abs(step)) > 1e3:
        raise LogError(f"a LaserScan from {start} rad in steps of {step} rad: no such scanner")
    near = near if np.isfinite(near) else 0.0
    far = far if np.isfinite(far) and far > 0 else np.inf
    with np.errstate(invalid="ignore"):
        ranges_m = np.asarray(message.ranges, np.float64)
        beams = np.flatnonzero(np.isfinite(ranges_m) & (near <= ranges_m) & (ranges_m <= far))
    angles = start + step * beams
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(beams))], axis=1)
    return np.asarray(directions * ranges_m[beams, None])
