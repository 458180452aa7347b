"""Writes ROS bags without ROS: clouds, sweeps, poses, IMU readings and transforms (METHODS 7.4).

The simulated world and the results for Foxglove are written so; `bag_file` reads bags. A bag is a
ROS 1 .bag, or a ROS 2 folder with sqlite3 or MCAP inside. Frames follow REP 103: x forward, y left,
z up. The bytes of a bag depend only on its messages and on the versions of `rosbags` and SQLite,
which it names.
"""

from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore
from scipy.spatial.transform import Rotation

from pipeline.core.errors import LogError

CLOUD = "sensor_msgs/msg/PointCloud2"
SWEEP = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
POSE_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
IMU = "sensor_msgs/msg/Imu"
NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
POINT = np.dtype([("xyz", "<f4", 3), ("intensity", "<f4"), ("ring", "<u2"), ("pad", "V2")])
"""A point as written: 20 bytes."""
TIMED_POINT = np.dtype([*POINT.descr, ("t", "<u4")])
"""A point with its time: 24 bytes."""
UINT16 = 4
UINT32 = 6
FLOAT32 = 7
"""Numbers of sensor_msgs/PointField for types."""


@cache
def typestore(ros: int) -> Typestore:
    """The definitions of the standard messages of ROS 1 or 2.

    They are the same in all distributions of it. The definitions inside a bag are not used: one odd
    topic would make the whole bag unreadable, and one flipped bit in a definition would change
    every message.
    """
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    if TRANSFORMS not in store.fielddefs:
        store.register(
            get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TRANSFORMS)
        )
    return store


class BagWriter:
    """Writes one bag, as a context manager; the stamp of a message is also its time of receipt."""

    def __init__(self, path: Path, kind: Literal["ros1", "sqlite3", "mcap"]) -> None:
        """Make a bag at `path`: a file NAME.bag for `ros1`, else a folder.

        Raises LogError if it is there already.
        """
        if path.exists():
            raise LogError(f"{path}: exists already; a bag is never overwritten: remove it first")
        path.parent.mkdir(parents=True, exist_ok=True)
        self._store = typestore(1 if kind == "ros1" else 2)
        self._writer: rosbag1.Writer | rosbag2.Writer
        if kind == "ros1":
            self._writer = rosbag1.Writer(path)
        else:
            plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
            # the version is that of metadata.yaml, the older one of the two that rosbags writes
            self._writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
        self._topics: dict[str, Connection] = {}

    def __enter__(self) -> Self:
        self._writer.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._writer.__exit__(kind, error, trace)

    def points(
        self,
        stamp_ns: int,
        frame: str,
        points_m: NDArray[np.float32],
        intensity: NDArray[np.floating],
        ring: NDArray[np.integer],
        topic: str = "/points",
        times_s: NDArray[np.float64] | None = None,
    ) -> None:
        """Write a cloud (n, 3) in metres.

        Each point has an `intensity` and a `ring` (n,), the number of its beam. `times_s` (n,) are
        the seconds after the stamp at which each was measured; they are written as nanoseconds, as
        by Ouster's driver.
        """
        data = np.zeros(len(points_m), POINT if times_s is None else TIMED_POINT)
        data["xyz"] = points_m
        data["intensity"] = intensity
        data["ring"] = ring
        fields = [
            self._field("x", 0, FLOAT32),
            self._field("y", 4, FLOAT32),
            self._field("z", 8, FLOAT32),
            self._field("intensity", 12, FLOAT32),
            self._field("ring", 16, UINT16),
        ]
        if times_s is not None:
            data["t"] = np.rint(1e9 * times_s)
            fields.append(self._field("t", POINT.itemsize, UINT32))
        self._write_stamped(
            topic,
            CLOUD,
            stamp_ns,
            frame,
            fields=fields,
            data=data.view(np.uint8).reshape(-1),
            height=1,
            width=len(data),
            point_step=data.itemsize,
            row_step=data.nbytes,
            is_bigendian=False,
            is_dense=True,
        )

    def laser_scan(
        self,
        stamp_ns: int,
        frame: str,
        ranges_m: NDArray[np.floating],
        angle_min_rad: float,
        angle_step_rad: float,
        range_min_m: float,
        range_max_m: float,
        topic: str = "/scan",
    ) -> None:
        """Write a sweep of ranges (n,), counter-clockwise from `angle_min_rad`."""
        self._write_stamped(
            topic,
            SWEEP,
            stamp_ns,
            frame,
            angle_min=angle_min_rad,
            angle_max=angle_min_rad + angle_step_rad * (len(ranges_m) - 1),
            angle_increment=angle_step_rad,
            range_min=range_min_m,
            range_max=range_max_m,
            time_increment=0.0,
            scan_time=0.0,
            ranges=np.asarray(ranges_m, np.float32),
            intensities=np.empty(0, np.float32),
        )

    def odometry(
        self,
        stamp_ns: int,
        world_frame: str,
        body_frame: str,
        world_T_body: NDArray[np.float64],
        topic: str = "/odom",
        covariance: NDArray[np.float64] | None = None,
    ) -> None:
        """Write the pose 4×4 of a body and its covariance (6, 6), zero by default.

        Velocities and their covariance are written as zero.
        """
        if covariance is None:
            covariance = np.zeros((6, 6))
        zero = self._xyz(np.zeros(3))
        twist = self._new("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        twist_with_covariance = self._new(
            "geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)
        )
        self._write_stamped(
            topic,
            ODOMETRY,
            stamp_ns,
            world_frame,
            child_frame_id=body_frame,
            pose=self._pose_with_covariance(world_T_body, covariance),
            twist=twist_with_covariance,
        )

    def pose_with_covariance(
        self,
        stamp_ns: int,
        frame: str,
        frame_T_body: NDArray[np.float64],
        covariance: NDArray[np.float64],
        topic: str,
    ) -> None:
        """Write a pose 4×4 and its covariance (6, 6).

        The covariance is of x, y, z and of turns about these axes of `frame`.
        """
        pose = self._pose_with_covariance(frame_T_body, covariance)
        self._write_stamped(topic, POSE_COVARIANCE, stamp_ns, frame, pose=pose)

    def imu(
        self,
        stamp_ns: int,
        frame: str,
        turn_rad_s: NDArray[np.float64],
        topic: str = "/imu",
    ) -> None:
        """Write how fast an IMU turns (3,) about its axes; all else is marked as not measured."""
        unmeasured = np.zeros(9)
        unmeasured[0] = -1.0  # by REP 145
        self._write_stamped(
            topic,
            IMU,
            stamp_ns,
            frame,
            orientation=self._quaternion(np.eye(4)),
            orientation_covariance=unmeasured,
            angular_velocity=self._xyz(turn_rad_s),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self._xyz(np.zeros(3)),
            linear_acceleration_covariance=unmeasured,
        )

    def nav_sat_fix(
        self,
        stamp_ns: int,
        frame: str,
        lla: tuple[float, float, float],
        covariance_m2: NDArray[np.float64] | None = None,
        status: int = 0,
        topic: str = "/fix",
    ) -> None:
        """Write a position: latitude and longitude in degrees, altitude in metres.

        Its covariance (3, 3) is of metres east, north and up; None if it is unknown. A `status`
        below 0 says that there is no fix.
        """
        latitude, longitude, altitude = lla
        self._write_stamped(
            topic,
            NAV_SAT_FIX,
            stamp_ns,
            frame,
            status=self._new("sensor_msgs/msg/NavSatStatus", status=status, service=1),
            latitude=latitude,
            longitude=longitude,
            altitude=altitude,
            position_covariance=np.zeros(9) if covariance_m2 is None else covariance_m2.reshape(9),
            position_covariance_type=0 if covariance_m2 is None else 3,
        )

    def static_transform(
        self, stamp_ns: int, parent: str, child: str, parent_T_child: NDArray[np.float64]
    ) -> None:
        """Write a transform 4×4 that holds for the whole bag, on `/tf_static`."""
        self.transform(stamp_ns, parent, child, parent_T_child, "/tf_static")

    def transform(
        self,
        stamp_ns: int,
        parent: str,
        child: str,
        parent_T_child: NDArray[np.float64],
        topic: str = "/tf",
    ) -> None:
        """Write a transform 4×4 at a moment."""
        translation = self._xyz(parent_T_child[:3, 3])
        rotation = self._quaternion(parent_T_child)
        transform = self._new(
            "geometry_msgs/msg/Transform", translation=translation, rotation=rotation
        )
        header = self._header(stamp_ns, parent)
        stamped = "geometry_msgs/msg/TransformStamped"
        transforms = [self._new(stamped, header=header, child_frame_id=child, transform=transform)]
        self._write(topic, TRANSFORMS, stamp_ns, transforms=transforms)

    def _write_stamped(
        self, topic: str, message_type: str, stamp_ns: int, frame: str, **fields: Any
    ) -> None:
        """Write a standard message that begins with a header."""
        self._write(topic, message_type, stamp_ns, header=self._header(stamp_ns, frame), **fields)

    def _write(self, topic: str, message_type: str, stamp_ns: int, **fields: Any) -> None:
        """Write a message of a standard type; the first of a topic makes the topic."""
        message = self._new(message_type, **fields)
        writer = self._writer
        if topic not in self._topics:
            self._topics[topic] = writer.add_connection(topic, message_type, typestore=self._store)
        is_ros1 = isinstance(writer, rosbag1.Writer)
        pack = self._store.serialize_ros1 if is_ros1 else self._store.serialize_cdr
        writer.write(self._topics[topic], stamp_ns, pack(message, message_type))

    def _new(self, message_type: str, **fields: Any) -> Any:
        """A message, or a part of one, of a standard type."""
        return self._store.types[message_type](**fields)

    def _header(self, stamp_ns: int, frame: str) -> Any:
        stamp = self._new(
            "builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9
        )
        seq = {"seq": 0} if isinstance(self._writer, rosbag1.Writer) else {}  # gone in ROS 2
        return self._new("std_msgs/msg/Header", **seq, stamp=stamp, frame_id=frame)

    def _field(self, name: str, offset: int, datatype: int) -> Any:
        """The description of a field of each point, at a byte offset in the point."""
        kind = "sensor_msgs/msg/PointField"
        return self._new(kind, name=name, offset=offset, datatype=datatype, count=1)

    def _pose_with_covariance(
        self, pose: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> Any:
        position = self._xyz(pose[:3, 3], "Point")
        orientation = self._quaternion(pose)
        message = self._new("geometry_msgs/msg/Pose", position=position, orientation=orientation)
        kind = "geometry_msgs/msg/PoseWithCovariance"
        return self._new(kind, pose=message, covariance=covariance.reshape(36))

    def _xyz(self, xyz: NDArray[np.float64], kind: str = "Vector3") -> Any:
        x, y, z = map(float, xyz)
        return self._new(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)

    def _quaternion(self, pose: NDArray[np.float64]) -> Any:
        x, y, z, w = map(float, Rotation.from_matrix(pose[:3, :3]).as_quat(canonical=True))
        return self._new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
