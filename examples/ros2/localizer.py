"""A ROS 2 node that localises each PointCloud2 and publishes accepted fixes.

It publishes PoseWithCovarianceStamped on `fix`, with the stamp of the cloud.

    python localizer.py campus.site --ros-args -r points:=/velodyne_points \\
        -p odometry:=/odom -p tf:=true
    python localizer.py hall.site --ros-args -r scan:=/scan -p odometry:=/odom

It takes /initialpose, such as of RViz: the next scan is sought near that pose first, and the track
starts again.

With a level site it takes LaserScan instead. It also publishes /initialpose, from which AMCL
starts: when the robot is first found, and each time that it is found again after it was lost.

Parameters, with their defaults:

- target_precision (0.99): accept only poses that are right with at least this probability; if the
  site cannot keep it, the node says so and keeps the largest below it that it can;
- strict (false): whether to stop instead;
- lift_m (0): raises the points by metres, so that the ground is at z = 0;
- body_T_lidar (none): instead of lift_m, the pose of the lidar in the frame that odometry moves, as
  x,y,z,roll,pitch,yaw in metres and degrees;
- frame (map): the frame of the poses;
- odometry (none): a topic of Odometry. Without it, constant motion is assumed, and the sweeps of a
  level laser are localised one by one;
- tf (false): whether to broadcast the transform from `frame` to the odometry's frame.

While a cloud is localised, only the newest cloud waits; older clouds are dropped.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.core.errors import InputError
from pipeline.core.frames import transformed
from pipeline.formats.bag import ODOMETRY, POSE_COVARIANCE
from pipeline.formats.messages import pose_numbers, poses, sweep_points
from pipeline.formats.pointcloud2 import decode
from pipeline.kernel_cache import cold
from pipeline.online.inputs import NO_POSE, placement
from pipeline.online.odometry import Newest
from pipeline.online.outputs import in_world
from pipeline.readers.log import raised
from pipeline.running.process import keep_freed_memory
from pipeline.views.kernels import bin_heights
from yearloc import Prior, Site, Tracker, YearlocError

X_Y_YAW = (0, 1, 5)
"""The rows of x, y and yaw in a covariance of ROS."""


def stamp_ns(header: Any) -> int:
    return int(header.stamp.sec * 10**9 + header.stamp.nanosec)


@dataclass(frozen=True)
class Accepted:
    """The numbers of a pose message."""

    map_T_body: np.ndarray
    """(4, 4) the pose."""
    covariance: np.ndarray
    """(36,) in ROS's order."""
    map_T_odom: np.ndarray
    """(4, 4) the pose of the odometry's frame; NaN without odometry."""
    is_initial: bool
    """Whether the robot was not predicted to be there: it was lost, or it was carried."""


class Localizer:
    """The node without ROS: turns a cloud or sweep into the numbers of a pose message."""

    def __init__(
        self,
        site: Site,
        target_precision: float = 0.99,
        lift_m: float = 0.0,
        body_T_lidar: str = "",
        strict: bool = False,
    ) -> None:
        self._tracker = Tracker(site, target_precision, strict=strict)
        self._points = sweep_points if site.is_level else decode
        self._odometry = Newest()
        self._body_T_lidar = (
            placement("body_T_lidar", body_T_lidar) if body_T_lidar else raised(lift_m)
        )
        self._odom_T_previous = NO_POSE
        self._initial_ns = -1  # the stamp of the last pose that /initialpose is told

    def believed(self, message: Any, frame: str = "map") -> None:
        """Start again: the next scan is localised by this PoseWithCovarianceStamped as a prior.

        A message that this node itself published is left alone. A covariance of zeros counts as
        unknown. Raises InputError for any other covariance that is none, and for another frame.
        """
        if stamp_ns(message.header) == self._initial_ns:
            return
        if message.header.frame_id not in ("", frame):
            raise InputError(f"a pose in {message.header.frame_id!r:.60}: expected {frame!r}")
        world_T_robot = poses([pose_numbers(message, POSE_COVARIANCE)])[0]
        covariance = np.reshape(message.pose.covariance, (6, 6))[np.ix_(X_Y_YAW, X_Y_YAW)]
        if not covariance.any():
            covariance = Prior.at(0.0, 0.0, 0.0).covariance
        self._tracker.restart(Prior(world_T_robot, covariance))

    def moved(self, odometry: Any) -> None:
        """Add an Odometry message."""
        self._odometry.add(stamp_ns(odometry.header), poses([pose_numbers(odometry, ODOMETRY)])[0])

    def pose(self, cloud: Any) -> Accepted | None:
        """The pose of a PointCloud2, in a level site of a LaserScan; None if it is not accepted."""
        time_ns = stamp_ns(cloud.header)
        odom_T_body = self._odometry.at(time_ns)
        step = (
            np.linalg.inv(self._odom_T_previous) @ odom_T_body
            if np.isfinite(self._odom_T_previous + odom_T_body).all()
            else None
        )
        points_m = transformed(self._body_T_lidar, self._points(cloud))
        fix = self._tracker.localize(points_m, step, time_ns or None)
        self._odom_T_previous = odom_T_body
        if fix.verdict != "accepted":
            return None
        starts_track = self._tracker.starts_track
        if starts_track:
            self._initial_ns = time_ns
        map_T_odom = (
            fix.world_T_sensor @ np.linalg.inv(odom_T_body)
            if np.isfinite(odom_T_body).all()
            else NO_POSE
        )
        return Accepted(fix.world_T_sensor, in_world(fix).ravel(), map_T_odom, starts_track)


def fill(position: Any, turn: Any, pose: np.ndarray) -> None:
    """Write a pose (4, 4) into a message's position and quaternion."""
    from scipy.spatial.transform import Rotation

    position.x, position.y, position.z = map(float, pose[:3, 3])
    turn.x, turn.y, turn.z, turn.w = map(float, Rotation.from_matrix(pose[:3, :3]).as_quat())


def teller(
    localizer: Localizer, frame: str, warn: Callable[[str], object]
) -> Callable[[Any], None]:
    """What /initialpose calls: it tells the localizer, and warns of a message that is no prior."""

    def told(message: Any) -> None:
        try:
            localizer.believed(message, frame)
        except YearlocError as error:
            warn(f"/initialpose: {error}")

    return told


def warn_of_kept(node: Any, site: Site, target_precision: float) -> None:
    """Log which precision the site keeps instead of the wanted one, if it cannot keep that."""
    if words := site.kept_words(target_precision):
        node.get_logger().warning(words)


def main() -> None:
    import rclpy
    from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
    from nav_msgs.msg import Odometry
    from rclpy.node import Node
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from rclpy.utilities import remove_ros_args
    from sensor_msgs.msg import LaserScan, PointCloud2
    from tf2_ros import TransformBroadcaster

    keep_freed_memory()
    rclpy.init()
    node = Node("yearloc")
    odom_frame = ""
    defaults = {
        "target_precision": 0.99,
        "strict": False,
        "lift_m": 0.0,
        "body_T_lidar": "",
        "frame": "map",
        "odometry": "",
        "tf": False,
    }
    target_precision, strict, lift_m, body_T_lidar, frame, odometry, tf = (
        node.declare_parameter(name, defaults[name]).value for name in defaults
    )
    try:
        site = Site.open(remove_ros_args(sys.argv)[1])
        localizer = Localizer(site, target_precision, lift_m, body_T_lidar, strict)
    except YearlocError as error:
        sys.exit(f"yearloc: {error}")
    warn_of_kept(node, site, target_precision)
    publisher = node.create_publisher(PoseWithCovarianceStamped, "fix", 10)
    initial = (
        node.create_publisher(PoseWithCovarianceStamped, "/initialpose", 10)
        if site.is_level
        else None
    )
    broadcaster = TransformBroadcaster(node)

    def moved(message: Any) -> None:
        nonlocal odom_frame
        odom_frame = message.header.frame_id
        localizer.moved(message)

    def arrived(cloud: Any) -> None:
        try:
            accepted = localizer.pose(cloud)
        except YearlocError as error:
            node.get_logger().warning(str(error))
            return
        if accepted is None:
            return
        message = PoseWithCovarianceStamped()
        message.header.stamp = cloud.header.stamp
        message.header.frame_id = frame
        fill(message.pose.pose.position, message.pose.pose.orientation, accepted.map_T_body)
        message.pose.covariance = accepted.covariance.tolist()
        publisher.publish(message)
        if initial is not None and accepted.is_initial:
            initial.publish(message)
        if tf and np.isfinite(accepted.map_T_odom).all():
            map_T_odom = TransformStamped()
            map_T_odom.header.stamp = cloud.header.stamp
            map_T_odom.header.frame_id = frame
            map_T_odom.child_frame_id = odom_frame
            fill(
                map_T_odom.transform.translation,
                map_T_odom.transform.rotation,
                accepted.map_T_odom,
            )
            broadcaster.sendTransform(map_T_odom)

    if cold(bin_heights):
        node.get_logger().info("compiling kernels, once per machine: about a minute")
    newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    if site.is_level:
        node.create_subscription(LaserScan, "scan", arrived, newest)
    else:
        node.create_subscription(PointCloud2, "points", arrived, newest)
    if odometry:
        node.create_subscription(
            Odometry,
            odometry,
            moved,
            QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT),
        )
    told = teller(localizer, frame, node.get_logger().warning)
    node.create_subscription(PoseWithCovarianceStamped, "/initialpose", told, 1)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
