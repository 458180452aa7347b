"""Odometry for trackers: the step from one scan to the next.

`step` computes it from two scans of a log. `Newest` keeps the poses that a robot sends while it
drives, and interpolates them at the stamp of a scan.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Trajectory, interpolate
from pipeline.online.inputs import NO_POSE, ODOMETRY_GAP_S, Scan

AHEAD_S = 0.2
"""How much newer a cloud may be than the newest pose; the robot's pose is then extrapolated from
the last two poses."""
MOST_POSES = 5000
"""How many poses are kept: those of 50 s at 100 a second."""


def step(previous: Scan | None, scan: Scan) -> NDArray[np.float64] | None:
    """The pose (4, 4) of a scan in the frame of the previous one, by odometry; None if unknown.

    It is unknown between scans of two recordings, since each recording has its own odometry frame.
    But a recording that starts within ODOMETRY_GAP_S after another counts as its next file.
    """
    if previous is None:
        return None
    if previous.recording != scan.recording:
        if previous.stamp_ns is None or scan.stamp_ns is None:
            return None
        if abs(scan.stamp_ns - previous.stamp_ns) > ODOMETRY_GAP_S * 1e9:
            return None
    previous_T_scan = np.linalg.inv(previous.odom_T_scan) @ scan.odom_T_scan
    return np.asarray(previous_T_scan) if np.isfinite(previous_T_scan).all() else None


@dataclass
class Newest:
    """The newest poses of a robot by its odometry, as they come."""

    count: int = field(default=0, init=False)
    """How many poses have been added."""
    _poses: deque[tuple[int, NDArray[np.float64]]] = field(
        default_factory=lambda: deque(maxlen=MOST_POSES), init=False
    )

    @property
    def stamp_ns(self) -> int:
        """The stamp of the newest pose; −1 if there is none."""
        return self._poses[-1][0] if self._poses else -1

    def add(self, stamp_ns: int, odom_T_robot: NDArray[np.float64]) -> None:
        """Add a pose (4, 4), unless it is not finite or not newer than the last one."""
        if stamp_ns > self.stamp_ns and np.isfinite(odom_T_robot).all():
            self._poses.append((stamp_ns, odom_T_robot))
            self.count += 1

    def at(self, stamp_ns: int) -> NDArray[np.float64]:
        """The pose odom_T_robot (4, 4) at a stamp; NaN if it is unknown."""
        near = [
            (pose_ns, pose)
            for pose_ns, pose in self._poses
            if abs(pose_ns - stamp_ns) <= ODOMETRY_GAP_S * 1e9
        ]
        if not near:
            return NO_POSE
        stamps_ns = np.array([pose_ns for pose_ns, _ in near], np.int64)
        poses = np.stack([pose for _, pose in near])
        newest_ns = stamps_ns[-1]
        if newest_ns < stamp_ns <= newest_ns + AHEAD_S * 1e9 and len(near) > 1:
            share = (stamp_ns - stamps_ns[-2]) / (newest_ns - stamps_ns[-2])
            return np.asarray(interpolate(poses[-2:-1], poses[-1:], np.array([share]))[0])
        trajectory = Trajectory(stamps_ns, poses, ODOMETRY_GAP_S)
        interpolated, _ = trajectory.at(np.array([stamp_ns], np.int64))
        return np.asarray(interpolated[0])
