"""Reads a drive from ROS bags of any kind, without ROS, as a Log (METHODS 7.4).

Points come from PointCloud2 or LaserScan messages (`bag_clouds`), poses from a topic or from tf
(`bag_poses`), the heading from an IMU (`bag_heading`). A sequence is a bag below the root, or a
folder of bags that are read as one drive, in order of time. Frames follow REP 103: x forward, y
left, z up.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import Poses
from pipeline.core.settings import Positive, checked
from pipeline.formats import bag_file
from pipeline.formats.bag import CLOUD, IMU, SWEEP
from pipeline.formats.bag_file import BagFile
from pipeline.readers import log
from pipeline.readers.bag_clouds import Clouds
from pipeline.readers.bag_heading import integrate_heading
from pipeline.readers.bag_poses import KINDS, Track, read_track
from pipeline.readers.log import Log
from pipeline.readers.mounting import Transforms


@dataclass(frozen=True)
@checked("reader")
class Bag:
    """A folder of bags, or of folders of bags."""

    points: str = "/points"
    """Topic of the clouds (PointCloud2), or of the sweeps of a 2-D LiDAR (LaserScan)."""
    ground_truth: str | None = "/odom"
    """Topic of the true poses (Odometry, PoseStamped, PoseWithCovarianceStamped), or
    tf:PARENT>CHILD. None: all messages are taken, without true poses."""
    odometry: str | None = None
    """Topic or tf:PARENT>CHILD of poses that drift but never jump; after a gap the odometry starts
    again."""
    body_T_lidar: Sequence[float] | None = None
    """Pose of the LiDAR in the body's frame: x, y, z in metres, roll, pitch, yaw in degrees. None:
    it is taken from the fixed transforms in the bags."""
    lift_m: float = 0.0
    """Added to z, so that the ground is at 0."""
    max_gap_s: Positive = 0.5
    """Poses further apart than this are a gap."""
    imu: str | None = None
    """Topic of an IMU (Imu). Its rates of turn are a first guess for the estimation of poses where
    there is no odometry."""

    def __post_init__(self) -> None:
        for key, name in (("ground_truth", self.ground_truth), ("odometry", self.odometry)):
            if name is None:
                continue
            parent, sign, child = name.removeprefix("tf:").partition(">")
            if name.startswith("tf:") and not (parent and sign and child):
                raise ConfigError(
                    f"reader.{key}={name}: expected tf:PARENT>CHILD, such as tf:map>base_link"
                )
        if self.body_T_lidar is not None:
            log.parse_extrinsic("reader.body_T_lidar", self.body_T_lidar)

    def open(self, root: Path, sequence: str) -> Log:
        """Open a sequence below `root`; raises LogError if it cannot be read."""
        where = root / sequence
        files = [BagFile(path) for path in _bag_paths(where)]
        self._check_topics(where, files)

        # clouds, poses and the LiDAR's place in the body
        skipped: Counter[str] = Counter()
        clouds = Clouds.read(files, self.points, skipped)
        ground_truth = (
            read_track(files, self.ground_truth, self.max_gap_s) if self.ground_truth else None
        )
        odometry = read_track(files, self.odometry, self.max_gap_s) if self.odometry else None
        body_T_lidar = self._extrinsic(where, files, clouds.frames, ground_truth or odometry)
        vehicle_T_lidar = log.raised(self.lift_m) @ body_T_lidar

        # the clouds that have a pose, with odometry of the frame that the ground truth is of
        posed = log.rows_with_poses(
            where,
            clouds.stamps_ns,
            ground_truth=ground_truth.trajectory if ground_truth else None,
            odometry=odometry.trajectory if odometry else None,
            skipped=skipped,
            question=f"do {self.points} and {self.ground_truth} share a clock?",
            scans="messages",
            ground_truth_name=ground_truth.name if ground_truth else "",
            odometry_name=odometry.name if odometry else "",
            keeps_unplaced=clouds.kind == SWEEP,  # submaps gather them
        )
        stamps_ns = clouds.stamps_ns[posed.rows]
        odom_T_body = posed.odom_T_scan
        if (
            odometry
            and odometry.child
            and ground_truth
            and ground_truth.child
            and odometry.child != ground_truth.child
        ):
            odom_T_body = odom_T_body @ _fixed_transform(
                where, files, odometry.child, ground_truth.child
            )

        imu_heading = None
        if self.imu:
            vehicle_R_lidar = vehicle_T_lidar[:3, :3]
            imu_heading = integrate_heading(
                files, self.imu, clouds.frames, vehicle_R_lidar, self.max_gap_s
            )
        uncertainty = odometry.uncertainty if odometry else None
        sources = (clouds, ground_truth, odometry, imu_heading)
        source_notes = [note for source in sources if source for note in source.notes]

        def points(row: int) -> NDArray[np.float64]:
            # By einsum, since the threads of BLAS block each other when several readers work in
            # parallel.
            points_m = clouds.points(int(posed.rows[row]))
            rotated = np.einsum("ij,nj->ni", vehicle_T_lidar[:3, :3], points_m)
            return np.asarray(rotated + vehicle_T_lidar[:3, 3])

        return Log(
            stamps_ns=stamps_ns,
            world_T_scan=log.lifted(posed.world_T_scan, self.lift_m),
            odom_T_scan=log.lifted(odom_T_body, self.lift_m),
            points=points,
            skipped=+skipped,  # without the reasons that were counted as 0
            notes=(*source_notes, *posed.notes),
            odom_variance=uncertainty.at(stamps_ns) if uncertainty else None,
            heading_rad=imu_heading.at(stamps_ns) if imu_heading else None,
            times_s=lambda row: clouds.times_s(int(posed.rows[row])),
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        """The sequences below `root`, each with an error line if the bags lack a topic."""
        children = sorted(root.iterdir()) if root.is_dir() else []
        bags_by_name: dict[str, list[Path]] = {}
        for child in children:
            name = child.name if child.is_dir() else child.stem
            paths = bag_file.find(child)
            if paths:
                bags_by_name.setdefault(name, paths)
        return {name: self._missing(bags_by_name[name]) for name in sorted(bags_by_name)}

    def _missing(self, paths: list[Path]) -> list[str]:
        """The error line on a topic that these bags lack, in a list; empty if they lack none."""
        try:
            self._check_topics(paths[0], [BagFile(path) for path in paths])
        except LogError as error:
            return [str(error)]
        return []

    def _check_topics(self, where: Path, files: Sequence[BagFile]) -> None:
        """Raise LogError, with the bags' topics, for one that none has or that cannot be used."""
        topics: dict[str, bag_file.Topic] = {}
        for file in files:
            topics |= file.topics
        settings = [
            ("points", self.points, (CLOUD, SWEEP)),
            ("ground_truth", self.ground_truth, KINDS),
            ("odometry", self.odometry, KINDS),
            ("imu", self.imu, (IMU,)),
        ]
        for key, name, kinds in settings:
            if name is None or name.startswith("tf:"):
                continue
            if name in topics and topics[name].kind in kinds:
                continue
            fault = "is not in it"
            if name in topics:
                fault = f"is a {bag_file.plain(topics[name].kind, 60)}"
            usable = ", ".join(kind.rpartition("/")[2] for kind in kinds)
            topic_list = ", ".join(f"{name} ({topic})" for name, topic in topics.items())
            raise LogError(
                f"{where}: reader.{key}={name} {fault}; expected {usable}. It holds "
                f"{bag_file.plain(topic_list or 'nothing', 800)}"
            )

    def _extrinsic(
        self, where: Path, files: Sequence[BagFile], frames: set[str], poses: Track | None
    ) -> NDArray[np.float64]:
        """body_T_lidar (4, 4), for points in `frames` and the body of `poses`."""
        if self.body_T_lidar is not None:
            return log.parse_extrinsic("reader.body_T_lidar", self.body_T_lidar)
        if poses is None:
            return np.eye(4)
        if poses.parent and frames == {poses.parent} and poses.child != poses.parent:
            raise LogError(
                f"{where}: {self.points} lies in {poses.parent} already, the world of "
                f"{poses.name}: its points were moved there; name a topic in the frame of the "
                "LiDAR or the body as reader.points"
            )
        if poses.child is None:
            raise LogError(
                f"{where}: {poses.name} does not name the frame that it poses; give "
                "reader.body_T_lidar"
            )
        if len(frames) != 1:
            names = ", ".join(sorted(frames))
            raise LogError(
                f"{where}: {self.points} comes in several frames, {names:.80}; give "
                "reader.body_T_lidar"
            )
        return _fixed_transform(where, files, poses.child, *frames)


def _bag_paths(where: Path) -> list[Path]:
    """The bags of a sequence: those in the folder `where`, or the file `where` with a suffix."""
    places = [where, *(where.with_name(where.name + suffix) for suffix in bag_file.SUFFIXES)]
    for place in places:
        paths = bag_file.find(place)
        if paths:
            return paths
    raise LogError(
        f"{where}: no bag there: neither a folder with bags nor one of "
        f"{', '.join(bag_file.SUFFIXES)}"
    )


def _fixed_transform(where: Path, files: Sequence[BagFile], a: str, b: str) -> Poses:
    """a_T_b (4, 4) by the fixed transforms of the bags; raises LogError if there is none."""
    a_T_b = Transforms.read(files).fixed((a, b))
    if a_T_b is None:
        raise LogError(
            f"{where}: no fixed transforms lead from {a} to {b}; give reader.body_T_lidar, or a "
            "pose of that frame"
        )
    return a_T_b
