"""Decodes ROS messages into arrays: stamps and frames, poses, transforms, sweeps (METHODS 7.4).

`pointcloud2` decodes clouds. Frames are those of REP 103: x forward, y left, z up.
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

MAX_ANGLE_RAD = 1e3
"""A larger angle of a scanner is damage."""


def header(data: bytes, ros: int) -> tuple[int, str]:
    """Stamp in nanoseconds and frame_id of a message that begins with a std_msgs/Header.

    `ros` is 1 or 2. The stamp begins at byte 4. Before it stands in ROS 1 a counter, in the CDR of
    ROS 2 an encoding whose second byte is the byte order. After the stamp come the length of the
    frame_id and its letters. Raises LogError for a message that does not begin so.
    """
    byte_order = "<" if ros == 1 or data[1:2] == b"\1" else ">"
    numbers = "III" if ros == 1 else "iII"
    try:
        stamp_and_length = struct.Struct(byte_order + numbers)
        seconds, nanoseconds, length = stamp_and_length.unpack_from(data, 4)
        length = min(length, len(data) + 1)  # struct would try to allocate any length
        (letters,) = struct.unpack_from(f"{length}s", data, 4 + stamp_and_length.size)
        frame = letters.rstrip(b"\0").decode()
    except (struct.error, UnicodeDecodeError):
        raise LogError("a message without a whole header") from None
    if seconds < 0 or nanoseconds >= 10**9:
        raise LogError(f"a message stamped {seconds} s and {nanoseconds} ns, which is no time")
    return seconds * 10**9 + nanoseconds, frame_name(frame)


def from_cdr(data: bytes, kind: str) -> Any:
    """A standard message from its bytes as ROS 2 sends them; raises LogError for a broken one."""
    try:
        return typestore(2).deserialize_cdr(data, kind)
    except Exception as error:  # rosbags raises errors of any type at damaged bytes
        raise LogError(f"a broken {kind.rpartition('/')[2]} ({type(error).__name__})") from None


def frame_name(name: str) -> str:
    """A frame_id without the leading slash of old ROS 1 bags, as tf2 names it.

    Unprintable letters become blanks.
    """
    return plain(name, 120).lstrip("/")


def pose_numbers(message: Any, kind: str) -> tuple[float, ...]:
    """Position in metres and quaternion (x, y, z, w) of a message with a pose.

    Its type `kind` is an Odometry, PoseStamped or PoseWithCovarianceStamped.
    """
    pose = message.pose.pose if kind in (ODOMETRY, POSE_COVARIANCE) else message.pose
    return _numbers(pose.position, pose.orientation)


def gathered_variance(message: Any, kind: str) -> tuple[float, float]:
    """Variance of the position in m² (mean of x and y) and of the heading in rad².

    They are those of the pose in an Odometry or PoseWithCovarianceStamped, in which odometry sums
    up its errors since the start; NaN for any other message.
    """
    if kind not in (ODOMETRY, POSE_COVARIANCE):
        return np.nan, np.nan
    covariance = message.pose.covariance.reshape(6, 6)
    # Rows and columns are x, y, z, and the rotations about these axes.
    position_m2 = float(covariance[0, 0] + covariance[1, 1]) / 2
    heading_rad2 = float(covariance[5, 5])
    return position_m2, heading_rad2


def transform_numbers(stamped: Any) -> tuple[float, ...]:
    """Translation in metres and quaternion (x, y, z, w) of a TransformStamped."""
    return _numbers(stamped.transform.translation, stamped.transform.rotation)


def poses(numbers: Sequence[tuple[float, ...]]) -> Poses:
    """Poses (n, 4, 4) from n rows of a position in metres and a quaternion (x, y, z, w).

    NaN where the position is not on Earth or the quaternion's length is not 1.
    """
    rows = np.array(numbers, np.float64).reshape(-1, 7)
    with np.errstate(all="ignore"):  # of NaN and of overflows, which are no poses either
        is_on_earth = (np.abs(rows[:, :3]) <= FARTHEST_M).all(axis=1)
        is_pose = is_on_earth & (np.abs(np.linalg.norm(rows[:, 3:], axis=1) - 1) < 0.01)
    matrices = np.full((len(rows), 4, 4), np.nan)
    matrices[is_pose] = np.eye(4)
    matrices[is_pose, :3, 3] = rows[is_pose, :3]
    if is_pose.any():
        matrices[is_pose, :3, :3] = Rotation.from_quat(rows[is_pose, 3:]).as_matrix()
    return matrices


def sweep_points(message: Any) -> NDArray[np.float64]:
    """Points (n, 3) in metres of a LaserScan in its frame, at z = 0.

    There is one for each finite range from range_min to range_max. A limit that is not finite is
    ignored, and so is a range_max of 0, which some drivers write. Angles run counter-clockwise from
    +x in steps of angle_increment, which is negative for a scanner mounted upside down. Raises
    LogError for angles that no scanner has.
    """
    start_rad = message.angle_min
    step_rad = message.angle_increment
    is_finite = np.isfinite([start_rad, step_rad]).all()
    if not is_finite or max(abs(start_rad), abs(step_rad)) > MAX_ANGLE_RAD:
        raise LogError(
            f"a LaserScan from {start_rad} rad in steps of {step_rad} rad: no such scanner"
        )
    has_far_limit = np.isfinite(message.range_max) and message.range_max > 0
    nearest_m = message.range_min if np.isfinite(message.range_min) else 0.0
    farthest_m = message.range_max if has_far_limit else np.inf
    with np.errstate(invalid="ignore"):
        ranges_m = np.asarray(message.ranges, np.float64)
        is_hit = np.isfinite(ranges_m) & (nearest_m <= ranges_m) & (ranges_m <= farthest_m)
    beams = np.flatnonzero(is_hit)
    angles_rad = start_rad + step_rad * beams
    directions = np.stack([np.cos(angles_rad), np.sin(angles_rad), np.zeros(len(beams))], axis=1)
    return np.asarray(directions * ranges_m[beams, None])


def _numbers(position: Any, quaternion: Any) -> tuple[float, ...]:
    """x, y, z of a position or translation, then x, y, z, w of a quaternion."""
    return (
        position.x,
        position.y,
        position.z,
        quaternion.x,
        quaternion.y,
        quaternion.z,
        quaternion.w,
    )
