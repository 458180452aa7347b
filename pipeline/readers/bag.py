"""Reads ROS bags of any kind, without ROS (METHODS 7.4).

Points come from PointCloud2 or LaserScan messages, poses from a topic or from tf. A sequence is a
bag below the root, or a folder of bags that are read as one drive, in order of time. Frames follow
REP 103: x forward, y left, z up.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import ROUNDED_NS, Poses
from pipeline.core.settings import Positive, check
from pipeline.formats import bag_file
from pipeline.formats.bag import CLOUD, IMU, SWEEP
from pipeline.formats.bag_file import BagFile
from pipeline.readers import log, vehicle
from pipeline.readers.bag_clouds import Clouds
from pipeline.readers.bag_heading import heading
from pipeline.readers.bag_poses import KINDS, Track, Tree, track
from pipeline.readers.log import Log


@dataclass(frozen=True)
class Bag:
    """A folder of bags, or of folders of bags."""

    points: str = "/points"
    """Topic of the clouds (PointCloud2), or of the sweeps of a 2-D LiDAR (LaserScan)."""
    truth: str | None = "/odom"
    """Topic of the true poses (Odometry, PoseStamped, PoseWithCovarianceStamped), or
    tf:PARENT>CHILD. None: all messages are taken without."""
    odometry: str | None = None
    """Topic or tf:PARENT>CHILD of poses that drift but never jump; after a gap the odometry starts
    anew."""
    body_T_lidar: Sequence[float] | None = None
    """The LiDAR in the body of the poses: x, y, z in metres, roll, pitch, yaw in degrees; None:
    from the fixed transforms."""
    lift_m: float = 0.0
    """Added to z, so that the ground is at 0."""
    max_gap_s: Positive = 0.5
    """Poses further apart than this are a gap."""
    imu: str | None = None
    """Topic of an IMU (Imu), whose rates of turn are a first guess where poses are estimated and
    there is no odometry."""

    def __post_init__(self) -> None:
        check(self, "reader")
        for key, name in (("truth", self.truth), ("odometry", self.odometry)):
            if name is None:
                continue
            parent, sign, child = name.removeprefix("tf:").partition(">")
            if name.startswith("tf:") and not (parent and sign and child):
                raise ConfigError(
                    f"reader.{key}={name}: expected tf:PARENT>CHILD, such as tf:map>base_link"
                )
        if self.body_T_lidar is not None:
            log.extrinsic("reader.body_T_lidar", self.body_T_lidar)

    def open(self, root: Path, sequence: str) -> Log:
        where = root / sequence
        places = [where, *(where.with_name(where.name + suffix) for suffix in bag_file.SUFFIXES)]
        paths = next((bag_paths for bag_paths in map(bag_file.find, places) if bag_paths), None)
        if paths is None:
            raise LogError(
                f"{where}: no bag there: neither a folder with bags nor one of "
                f"{', '.join(bag_file.SUFFIXES)}"
            )
        files = [BagFile(path) for path in paths]
        self._check_topics(where, files)
        skipped: Counter[str] = Counter()
        clouds = Clouds.read(files, self.points, skipped)
        truth = track(files, self.truth, self.max_gap_s) if self.truth else None
        odometry = _parted(track(files, self.odometry, self.max_gap_s)) if self.odometry else None
        body_T_lidar = self._extrinsic(where, files, clouds.frames, truth or odometry)
        if truth is None:
            rows, world_T_body, odom_T_body, notes = log.rows_with_poses(
                where,
                clouds.stamps_ns,
                None,
                odometry.trajectory if odometry else None,
                skipped,
                "",
            )
        else:
            rows, world_T_body, odom_T_body, notes = _rows_with_poses(
                clouds, truth, odometry, skipped
            )
        if truth and not len(rows):
            question = f"do {self.points} and {self.truth} share a clock?"
            log.refuse_unposed(
                where, "messages", clouds.stamps_ns, truth.trajectory, skipped, question
            )
        if odometry and odometry.child and truth and truth.child and odometry.child != truth.child:
            odom_T_body = odom_T_body @ _fixed_transform(where, files, odometry.child, truth.child)
        vehicle_T_lidar = log.raised(self.lift_m) @ body_T_lidar

        def points(row: int) -> NDArray[np.float64]:
            # By einsum, since the threads of BLAS block each other when several readers work in
            # parallel.
            rotated = np.einsum("ij,nj->ni", vehicle_T_lidar[:3, :3], clouds.points(int(rows[row])))
            return np.asarray(rotated + vehicle_T_lidar[:3, 3])

        turned = (
            heading(files, self.imu, clouds.frames, vehicle_T_lidar[:3, :3], self.max_gap_s)
            if self.imu
            else None
        )
        poses = (log.lifted(world_T_body, self.lift_m), log.lifted(odom_T_body, self.lift_m))
        doubts = vehicle.doubts(truth.name, truth.trajectory) if truth else ()
        notes = (
            *clouds.notes,
            *(truth.notes if truth else ()),
            *(odometry.notes if odometry else ()),
            *(turned.notes if turned else ()),
            *doubts,
            *notes,
        )
        uncertainty = odometry.uncertainty if odometry else None
        return Log(
            clouds.stamps_ns[rows],
            *poses,
            points,
            +skipped,
            notes,
            odom_variance=uncertainty.at(clouds.stamps_ns[rows]) if uncertainty else None,
            heading_rad=turned.at(clouds.stamps_ns[rows]) if turned else None,
            times_s=lambda row: clouds.times_s(int(rows[row])),
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        children = sorted(root.iterdir()) if root.is_dir() else []
        paths_by_name = {
            child.name if child.is_dir() else child.stem: child
            for child in children[::-1]
            if bag_file.find(child)
        }
        return {
            name: self._missing(bag_file.find(paths_by_name[name]))
            for name in sorted(paths_by_name)
        }

    def _missing(self, paths: list[Path]) -> list[str]:
        try:
            self._check_topics(paths[0], [BagFile(path) for path in paths])
        except LogError as error:
            return [str(error)]
        return []

    def _check_topics(self, where: Path, files: Sequence[BagFile]) -> None:
        """Raise LogError for a topic that no bag has, or whose type cannot be used.

        The error lists the topics of the bags.
        """
        topics = {name: topic for file in files for name, topic in file.topics.items()}
        settings = [
            ("points", self.points, (CLOUD, SWEEP)),
            ("truth", self.truth, KINDS),
            ("odometry", self.odometry, KINDS),
            ("imu", self.imu, (IMU,)),
        ]
        for key, name, kinds in settings:
            if name is None or name.startswith("tf:"):
                continue
            if name not in topics or topics[name].kind not in kinds:
                is_other = (
                    f"is a {bag_file.plain(topics[name].kind, 60)}"
                    if name in topics
                    else "is not in it"
                )
                usable = ", ".join(kind.rpartition("/")[2] for kind in kinds)
                topic_list = bag_file.plain(
                    ", ".join(f"{name} ({topic})" for name, topic in topics.items()) or "nothing",
                    800,
                )
                raise LogError(
                    f"{where}: reader.{key}={name} {is_other}; expected {usable}. It holds "
                    f"{topic_list}"
                )

    def _extrinsic(
        self, where: Path, files: Sequence[BagFile], frames: set[str], truth: Track | None
    ) -> NDArray[np.float64]:
        """The LiDAR in the body of the poses; without any poses the LiDAR is the body."""
        if self.body_T_lidar is not None:
            return log.extrinsic("reader.body_T_lidar", self.body_T_lidar)
        if truth is None:
            return np.eye(4)
        if truth.parent and frames == {truth.parent} and truth.child != truth.parent:
            raise LogError(
                f"{where}: {self.points} lies in {truth.parent} already, the world of "
                f"{truth.name}: its points were moved there; name a topic in the frame of the "
                "LiDAR or the body as reader.points"
            )
        if truth.child is None:
            raise LogError(
                f"{where}: {truth.name} does not name the frame that it poses; give "
                "reader.body_T_lidar"
            )
        if len(frames) != 1:
            names = ", ".join(sorted(frames))
            raise LogError(
                f"{where}: {self.points} comes in several frames, {names:.80}; give "
                "reader.body_T_lidar"
            )
        return _fixed_transform(where, files, truth.child, *frames)


def _fixed_transform(where: Path, files: Sequence[BagFile], a: str, b: str) -> NDArray[np.float64]:
    """a_T_b (4, 4) by the fixed transforms of the bags; raises LogError if there is none.

    They are on tf_static, or else repeated on tf.
    """
    for moving in (False, True):
        a_T_b = np.eye(4) if a == b else Tree.read(files, moving).fixed(a, b)
        if a_T_b is not None:
            return a_T_b
    raise LogError(
        f"{where}: no fixed transforms lead from {a} to {b}; give reader.body_T_lidar, or a pose "
        "of that frame"
    )


def _parted(odometry: Track) -> Track:
    """The odometry with a gap at each jump, where it was set back and starts anew."""
    trajectory, notes = vehicle.parted(odometry.name, odometry.trajectory)
    return replace(odometry, trajectory=trajectory, notes=odometry.notes + notes)


def _rows_with_poses(
    clouds: Clouds, truth: Track, odometry: Track | None, skipped: Counter[str]
) -> tuple[NDArray[np.int64], Poses, Poses, tuple[str, ...]]:
    """Rows with a true pose, their true poses, their odometry, and notes for the user.

    Sweeps may have odometry alone. Counts the other rows in `skipped`.
    """
    stamps_ns = clouds.stamps_ns
    world_T_body, has_truth = truth.trajectory.at(stamps_ns)
    odom_T_body, has_odometry = (
        odometry.trajectory.at(stamps_ns)
        if odometry
        else (np.full_like(world_T_body, np.nan), ~has_truth)
    )
    is_kept = has_truth | (has_odometry & (odometry is not None) & (clouds.kind == SWEEP))
    log.count_unknown(stamps_ns[~is_kept], truth.trajectory, skipped)
    chain = np.zeros(len(stamps_ns), int)
    if odometry:
        breaks_ns = vehicle.breaks_ns(odometry.trajectory)
        chain = np.searchsorted(breaks_ns - ROUNDED_NS, stamps_ns, side="right")
    for link in np.unique(chain[is_kept])[1:]:
        rows = np.flatnonzero(is_kept & (chain == link))
        lead = int(has_truth[rows].argmax()) if has_truth[rows].any() else len(rows)
        is_kept[rows[:lead]] = False
        odom_T_body[rows[lead : lead + 1]] = np.nan
        skipped["between a break of the odometry and the next place"] += lead
    rows = np.flatnonzero(is_kept)
    unplaced = int((~has_truth[rows]).sum())
    notes = (
        (f"{unplaced:,} of {len(rows):,} sweeps have no place (no pose on {truth.name})",)
        if unplaced
        else ()
    )
    return rows, world_T_body[rows], odom_T_body[rows], notes
