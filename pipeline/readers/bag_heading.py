"""Reads how far a vehicle turned by the gyroscope of an IMU in bags (REP 145)."""

from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Stamps
from pipeline.formats.bag import IMU
from pipeline.formats.bag_file import BagFile
from pipeline.formats.messages import header
from pipeline.readers.bag_poses import Tree, longest_increasing, message_stamps

UNMEASURED = -1.0
"""The first covariance of what an IMU does not measure."""


@dataclass(frozen=True)
class Heading:
    """How far a vehicle turned to its left since the first reading."""

    stamps_ns: Stamps
    """(n,) increasing."""
    heading_rad: NDArray[np.float64]
    """(n,)."""
    max_gap_s: float
    notes: tuple[str, ...]

    def at(self, stamps_ns: Stamps) -> NDArray[np.float64]:
        """The heading (m,) in radians at stamps (m,).

        NaN where no readings are around, and in the first row after a gap.
        """
        first_ns = self.stamps_ns[0]  # float64 has 256 ns of what is counted since 1970
        known_ns = self.stamps_ns - first_ns
        since_ns = stamps_ns - first_ns
        heading_rad = np.interp(since_ns, known_ns, self.heading_rad, left=np.nan, right=np.nan)
        is_gap = np.diff(self.stamps_ns) > self.max_gap_s * 1e9
        after_ns = self.stamps_ns[1:][is_gap]
        before_ns = self.stamps_ns[:-1][is_gap]
        chain = np.searchsorted(after_ns, stamps_ns, side="right")
        heading_rad[np.searchsorted(before_ns, stamps_ns, side="left") > chain] = np.nan
        heading_rad[1:][np.diff(chain) > 0] = np.nan
        return np.asarray(heading_rad)


def heading(
    files: Sequence[BagFile],
    topic: str,
    lidar_frames: set[str],
    vehicle_R_lidar: NDArray[np.float64],
    max_gap_s: float,
) -> Heading:
    """The heading of a vehicle by an IMU's rates of turn.

    `vehicle_R_lidar` (3, 3) and the fixed transforms between LiDAR and IMU say which axis is up;
    without these transforms it is the IMU's z. Raises LogError where no message says a rate.
    """
    readings: list[tuple[int, int, tuple[float, float, float]]] = []
    frames: set[str] = set()
    for file in files:
        for key, data in file.messages(topic) if topic in file.topics else ():
            try:
                stamp_ns, frame = header(data, file.ros)
                message = file.decode(data, IMU)
            except LogError:
                continue
            rate = message.angular_velocity
            numbers = (float(rate.x), float(rate.y), float(rate.z))
            is_measured = message.angular_velocity_covariance[0] != UNMEASURED
            if is_measured and np.isfinite(numbers).all():
                readings.append((key.received_ns, stamp_ns, numbers))
                frames.add(frame)
    if not readings:
        raise LogError(f"{files[0].path}: {topic} holds no rate of turn that can be read")
    readings.sort(key=itemgetter(0))
    times, notes = message_stamps(
        topic, [(stamp_ns, received_ns) for received_ns, stamp_ns, _ in readings]
    )
    rows = longest_increasing(times)
    rates_rad_s = np.array([numbers for *_, numbers in readings])[rows]
    stamps_ns = times[rows]
    up, up_notes = _up(files, topic, lidar_frames, frames, vehicle_R_lidar)
    yaw_rad_s = rates_rad_s @ up
    turns_rad = (yaw_rad_s[1:] + yaw_rad_s[:-1]) / 2 * np.diff(stamps_ns) / 1e9
    heading_rad = np.concatenate([[0.0], np.cumsum(turns_rad)])
    notes += up_notes
    return Heading(stamps_ns, heading_rad, max_gap_s, notes)


def _up(
    files: Sequence[BagFile],
    topic: str,
    lidar_frames: set[str],
    imu_frames: set[str],
    vehicle_R_lidar: NDArray[np.float64],
) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """The vehicle's z axis (3,) in the frame of the IMU, and a note where that is not known."""
    if len(lidar_frames) == len(imu_frames) == 1:
        (lidar,) = lidar_frames
        (imu,) = imu_frames
        if lidar == imu:
            return vehicle_R_lidar[2], ()
        for moving in (False, True):
            lidar_T_imu = Tree.read(files, moving).fixed(lidar, imu)
            if lidar_T_imu is not None:
                return vehicle_R_lidar[2] @ lidar_T_imu[:3, :3], ()
    return np.array([0.0, 0.0, 1.0]), (
        f"{topic}: no fixed transforms place its IMU; its z axis is taken for up",
    )
