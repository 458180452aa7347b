"""Integrates the gyroscope of an IMU in bags (REP 145) into the heading of the vehicle.

Where a log has neither poses nor odometry, the heading is a first guess of how the vehicle turned
between two scans.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Stamps
from pipeline.formats.bag import IMU
from pipeline.formats.bag_file import BagFile
from pipeline.readers.bag_poses import longest_increasing, message_stamps, read_messages
from pipeline.readers.mounting import Transforms

UNMEASURED_COVARIANCE = -1.0
"""The first number of the covariance of what an IMU does not measure, by REP 145."""


@dataclass(frozen=True)
class Heading:
    """The angle by which a vehicle turned to its left since the first reading, over time."""

    stamps_ns: Stamps
    """(n,) increasing."""
    heading_rad: NDArray[np.float64]
    """(n,) in radians, not wrapped at a full turn."""
    max_gap_s: float
    """Readings further apart than this are a gap."""
    notes: tuple[str, ...]
    """Lines for the user."""

    def at(self, stamps_ns: Stamps) -> NDArray[np.float64]:
        """The heading (m,) in radians at increasing stamps (m,), interpolated linearly.

        NaN in gaps, beyond the ends, and in the first row after a gap.
        """
        # np.interp computes in float64, which resolves only 256 ns of a time since 1970
        first_ns = self.stamps_ns[0]
        known_ns = self.stamps_ns - first_ns
        query_ns = stamps_ns - first_ns
        heading_rad = np.interp(query_ns, known_ns, self.heading_rad, left=np.nan, right=np.nan)
        is_gap = np.diff(self.stamps_ns) > self.max_gap_s * 1e9
        begun_gap_count = np.searchsorted(self.stamps_ns[:-1][is_gap], stamps_ns, side="left")
        ended_gap_count = np.searchsorted(self.stamps_ns[1:][is_gap], stamps_ns, side="right")
        is_in_gap = begun_gap_count > ended_gap_count
        is_after_gap = np.diff(ended_gap_count) > 0
        heading_rad[is_in_gap] = np.nan
        heading_rad[1:][is_after_gap] = np.nan
        return np.asarray(heading_rad)


def integrate_heading(
    files: Sequence[BagFile],
    topic: str,
    lidar_frames: set[str],
    vehicle_R_lidar: NDArray[np.float64],
    max_gap_s: float,
) -> Heading:
    """Integrate the heading of a vehicle from the rates of turn in an IMU's topic.

    `vehicle_R_lidar` (3, 3) and the fixed transforms between the frames of LiDAR and IMU give the
    IMU's axis that points up; without such transforms its z axis is taken. Raises LogError if no
    message has a rate of turn.
    """
    messages, _ = read_messages(files, topic, (IMU,), _rate_rad_s)
    readings = [message for message in messages if message.content is not None]
    if not readings:
        raise LogError(f"{files[0].path}: {topic} holds no rate of turn that can be read")
    all_stamps_ns, notes = message_stamps(
        topic, [(reading.stamp_ns, reading.received_ns) for reading in readings]
    )
    rows = longest_increasing(all_stamps_ns)
    rates_rad_s = np.array([reading.content for reading in readings])[rows]
    stamps_ns = all_stamps_ns[rows]
    imu_frames = {reading.frame for reading in readings}
    up, up_notes = _up(files, topic, lidar_frames, imu_frames, vehicle_R_lidar)
    yaw_rad_s = rates_rad_s @ up
    turns_rad = (yaw_rad_s[1:] + yaw_rad_s[:-1]) / 2 * np.diff(stamps_ns) / 1e9
    heading_rad = np.concatenate([[0.0], np.cumsum(turns_rad)])
    return Heading(stamps_ns, heading_rad, max_gap_s=max_gap_s, notes=notes + up_notes)


def _rate_rad_s(message: Any, kind: str) -> tuple[float, float, float] | None:
    """Rates of turn of an IMU about its x, y and z axes, in rad/s; None if it measures none."""
    velocity = message.angular_velocity
    rate_rad_s = (float(velocity.x), float(velocity.y), float(velocity.z))
    is_measured = message.angular_velocity_covariance[0] != UNMEASURED_COVARIANCE
    return rate_rad_s if is_measured and np.isfinite(rate_rad_s).all() else None


def _up(
    files: Sequence[BagFile],
    topic: str,
    lidar_frames: set[str],
    imu_frames: set[str],
    vehicle_R_lidar: NDArray[np.float64],
) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """The vehicle's z axis (3,) in the frame of the IMU, and a note where it is only assumed."""
    if len(lidar_frames) == len(imu_frames) == 1:
        (lidar,) = lidar_frames
        (imu,) = imu_frames
        if lidar == imu:
            return vehicle_R_lidar[2], ()
        lidar_T_imu = Transforms.read(files).fixed((lidar, imu))
        if lidar_T_imu is not None:
            return vehicle_R_lidar[2] @ lidar_T_imu[:3, :3], ()
    return np.array([0.0, 0.0, 1.0]), (
        f"{topic}: no fixed transforms place its IMU; its z axis is taken for up",
    )
