"""A ROS 2 node: PointCloud2 in, PoseWithCovarianceStamped out where a fix is accepted.

    python localizer.py campus.site --ros-args -r points:=/velodyne_points

Parameters: promise (.99), lift_m (0: raises the points so that the ground is at 0), frame (map). Of the clouds that arrive
while one is localised the newest is next, the others are dropped.
"""

import sys
from typing import Any

import numpy as np

from pipeline.errors import YearlocError
from pipeline.formats.pointcloud2 import decode
from pipeline.online.outputs import in_world
from pipeline.online.site import Site
from pipeline.online.tracking import Tracker
from pipeline.running.memory import keep_freed_memory


class Localizer:
    """What the node does, without ROS: a cloud becomes the numbers of a pose message, or nothing."""

    def __init__(self, site: Site, promise: float = 0.99, lift_m: float = 0.0) -> None:
        self._tracker, self._lift_m = Tracker(site, promise), lift_m

    def pose(self, cloud: Any) -> tuple[np.ndarray, np.ndarray] | None:
        """Pose (4, 4) and covariance (36,) as ROS has it, of a PointCloud2; None where no fix is accepted."""
        fix = self._tracker.localize(np.asarray(decode(cloud), np.float64) + np.array([0.0, 0.0, self._lift_m]))
        return (fix.world_T_sensor, in_world(fix).ravel()) if fix.verdict == "accepted" else None


def main() -> None:
    import rclpy
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from rclpy.node import Node
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from rclpy.utilities import remove_ros_args
    from scipy.spatial.transform import Rotation
    from sensor_msgs.msg import PointCloud2

    keep_freed_memory()
    rclpy.init()
    node = Node("yearloc")
    usual = {"promise": 0.99, "lift_m": 0.0, "frame": "map"}
    promise, lift_m, frame = (node.declare_parameter(name, value).value for name, value in usual.items())
    localizer = Localizer(Site.open(remove_ros_args(sys.argv)[1]), promise, lift_m)
    publisher = node.create_publisher(PoseWithCovarianceStamped, "fix", 10)

    def arrived(cloud: Any) -> None:
        try:
            found = localizer.pose(cloud)
        except YearlocError as error:
            node.get_logger().warning(str(error))
            return
        if found is None:
            return
        message, (world_T_sensor, covariance) = PoseWithCovarianceStamped(), found
        message.header.stamp, message.header.frame_id = cloud.header.stamp, frame
        position, turn = message.pose.pose.position, message.pose.pose.orientation
        position.x, position.y, position.z = map(float, world_T_sensor[:3, 3])
        turn.x, turn.y, turn.z, turn.w = map(float, Rotation.from_matrix(world_T_sensor[:3, :3]).as_quat())
        message.pose.covariance = covariance.tolist()
        publisher.publish(message)

    newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    node.create_subscription(PointCloud2, "points", arrived, newest)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
