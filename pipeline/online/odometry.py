"""Odometry: the step from scan to scan, from a log on disk or from poses received while driving."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Trajectory, interpolate
from pipeline.online.inputs import NO_POSE, ODOMETRY_GAP_S, Scan

AHEAD_S = 0.2
"""A cloud may be so much newer than the newest pose of the odometry: the robot is taken to move on
as between the last two."""
KEPT = 5000
"""Poses."""


def step(previous: Scan | None, scan: Scan) -> NDArray[np.float64] | None:
    """The pose (4, 4) of a scan in the frame of the previous one, by odometry; None if unknown.

    Each recording has its own odometry, except where it continues the recording before it.
    """
    if previous is None:
        return None
    if previous.recording != scan.recording:
        stamped = previous.stamp_ns is not None and scan.stamp_ns is not None
        if (
            not stamped
            or abs((scan.stamp_ns or 0) - (previous.stamp_ns or 0)) > ODOMETRY_GAP_S * 1e9
        ):
            return None
    previous_T_scan = np.linalg.inv(previous.odom_T_scan) @ scan.odom_T_scan
    return np.asarray(previous_T_scan) if np.isfinite(previous_T_scan).all() else None


@dataclass
class Newest:
    """The newest poses of a robot by its odometry."""

    count: int = field(default=0, init=False)
    """Poses that came."""
    _poses: deque[tuple[int, NDArray[np.float64]]] = field(
        default_factory=lambda: deque(maxlen=KEPT), init=False
    )

    @property
    def stamp_ns(self) -> int:
        """The stamp of the newest pose; −1 before any came."""
        return self._poses[-1][0] if self._poses else -1

    def add(self, stamp_ns: int, odom_T_robot: NDArray[np.float64]) -> None:
        """Add a pose (4, 4); one that is not newer than the last, or not finite, is passed over."""
        if stamp_ns > self.stamp_ns and np.isfinite(odom_T_robot).all():
            self._poses.append((stamp_ns, odom_T_robot))
            self.count += 1

    def at(self, stamp_ns: int) -> NDArray[np.float64]:
        """odom_T_robot (4, 4) at a stamp; NaN where it is unknown."""
        near = [
            (time_ns, pose)
            for time_ns, pose in self._poses
            if abs(time_ns - stamp_ns) <= ODOMETRY_GAP_S * 1e9
        ]
        if not near:
            return NO_POSE
        stamps_ns = np.array([time_ns for time_ns, _ in near], np.int64)
        poses = np.stack([pose for _, pose in near])
        if stamps_ns[-1] < stamp_ns <= stamps_ns[-1] + AHEAD_S * 1e9 and len(near) > 1:
            share = (stamp_ns - stamps_ns[-2]) / (stamps_ns[-1] - stamps_ns[-2])
            return np.asarray(interpolate(poses[-2:-1], poses[-1:], np.array([share]))[0])
        return np.asarray(
            Trajectory(stamps_ns, poses, ODOMETRY_GAP_S).at(np.array([stamp_ns], np.int64))[0][0]
        )
