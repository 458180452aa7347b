"""Reads the scans of an MCAP recording while it is still being written (`--follow`).

A thread reads the file as it grows, and keeps the newest clouds, the poses of odometry, and the
fixed transforms. `Following.scans` yields the clouds as scans, the oldest first. Clouds that come
faster than they are localised are dropped and counted.
"""

import time
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from threading import Condition, Thread
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError, needed
from pipeline.core.frames import Poses, Stamps, transformed
from pipeline.formats.bag import CLOUD, TRANSFORMS
from pipeline.formats.messages import from_cdr, header, poses
from pipeline.formats.pointcloud2 import decode, times_s
from pipeline.online.inputs import NO_POSE, Scan, ScanOptions, child_T_body
from pipeline.online.odometry import AHEAD_S, Newest
from pipeline.readers.bag_poses import KINDS, MAX_FIXED_CHANGE, Edge, Tree, pose_of, transform_of
from pipeline.readers.deskew import deskewed
from pipeline.readers.mounting import BODIES, Transforms

POLL_S = 0.02
"""Seconds between two attempts to read more of the file."""
MOST_WAITING = 8
"""How many clouds may wait, since a recorder writes several at once; then the oldest is dropped."""
STEP_S = 0.1
"""A cloud is deskewed by the robot's motion in this time before its stamp."""
TRANSFORMS_S = 1.0
"""How long the first cloud waits for the transforms of its lidar, which many nodes send once a
second."""
LARGEST_RECORD_BYTES = 2**28
"""A larger record counts as damage."""

Edges = dict[Edge, tuple[Stamps, Poses]]
"""For each pair of frames, parent and child, the stamps (n,) and parent_T_child (n, 4, 4)."""


class GrowingFile:
    """A file that another process is writing.

    A read waits for bytes that are not written yet, until no byte has come for `idle_s` seconds.
    """

    def __init__(self, file: BinaryIO, idle_s: float) -> None:
        self._file = file
        self._idle_s = idle_s

    def read(self, size: int) -> bytes:
        """Read `size` bytes, or fewer if the file grows no more."""
        parts = []
        missing = size
        last_update_s = time.monotonic()
        while missing > 0 and time.monotonic() - last_update_s < self._idle_s:
            if part := self._file.read(missing):
                parts.append(part)
                missing = missing - len(part)
                last_update_s = time.monotonic()
            else:
                time.sleep(POLL_S)
        return b"".join(parts)


@dataclass
class Following:
    """A recording that is being written, and what has been read of it so far."""

    path: Path
    """FILE.mcap, or the folder that `ros2 bag record` writes it into."""
    options: ScanOptions
    """How the scans are read; without a topic, the clouds of all topics are read."""
    idle_s: float
    """The recording has ended when nothing was written for this many seconds."""
    dropped: int = field(default=0, init=False)
    """How many clouds were dropped because newer clouds came too fast."""
    skipped: Counter[str] = field(default_factory=Counter, init=False)
    """How many clouds could not be read, by reason."""
    damage: str = field(default="", init=False)
    """Why reading ended before the end of the recording; empty if it was read to its end."""

    def scans(self) -> Iterator[Scan]:
        """The scans of the recording as they come, until nothing was written for `idle_s`.

        Raises LogError if there is no recording or it holds no cloud, ConfigError if the package
        mcap is not installed.
        """
        file: Path | None = self.path
        if not self.path.is_file():
            file = next(iter(sorted(self.path.glob("*.mcap"))), None)
        if file is None or file.suffix != ".mcap":
            raise LogError(
                f"{self.path}: no .mcap recording to follow; other bags can be localised once they "
                "are written"
            )
        # what the reading thread writes and this thread reads, both while holding the condition
        self._changed = Condition()
        self._clouds = deque[tuple[int, bytes]](maxlen=MOST_WAITING)  # stamp and message
        self._newest_poses = Newest()
        self._child = ""  # the frame that odometry moves
        # stamps and different poses of transforms: those on tf_static, and all
        self._static_edges: Edges = {}
        self._edges: Edges = {}
        self._has_waited = False  # for the transforms
        self._ended: Exception | bool = False
        Thread(target=self._read_file, args=(file,), daemon=True).start()
        number = 0
        while (cloud := self._next_cloud()) is not None:
            stamp_ns, message = cloud
            yield self._scan(number, stamp_ns, message)
            number += 1
        if self.options.odometry and not self._newest_poses.count:
            self.damage = self.damage or f"{file}: no pose of {self.options.odometry} came"
        if isinstance(self._ended, ConfigError):
            raise self._ended
        if not number and self.damage:
            raise LogError(self.damage)
        if not number:
            on_topic = f" on {self.options.topic}" if self.options.topic else ""
            raise LogError(f"{file}: no PointCloud2{on_topic} came within {self.idle_s:g} s")

    def _next_cloud(self) -> tuple[int, bytes] | None:
        """Wait for a cloud, and at most AHEAD_S for odometry up to its stamp; returns the oldest.

        Returns None at the end of the recording.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._clouds or self._ended)
            if not self._clouds:
                return None
            if self.options.body_T_lidar is None and not self._has_waited:
                _, frame = header(self._clouds[0][1], 2)
                self._changed.wait_for(partial(self._is_placed, {frame}), TRANSFORMS_S)
                self._has_waited = True
            cloud = self._clouds.popleft()
            if self.options.odometry:
                stamp_ns, _ = cloud
                newest = self._newest_poses
                self._changed.wait_for(lambda: self._ended or newest.stamp_ns >= stamp_ns, AHEAD_S)
            return cloud

    def _is_placed(self, lidar_frames: set[str]) -> bool:
        """Whether the transforms so far lead to the lidar, or the recording has ended."""
        bodies = (*BODIES, self._child)
        is_placed = self._transforms().body_T_lidar(bodies, lidar_frames) is not None
        return bool(self._ended) or is_placed

    def _transforms(self) -> Transforms:
        """The transforms read so far."""
        static = Tree(str(self.path), dict(self._static_edges), 0)
        all_edges = Tree(str(self.path), dict(self._edges), 0)
        return Transforms(static, lambda: all_edges)

    def _scan(self, number: int, stamp_ns: int, data: bytes) -> Scan:
        """The scan of a cloud's message, placed by the transforms and poses read so far."""
        with self._changed:
            transforms = self._transforms()
            child = self._child
            before_ns = stamp_ns - round(STEP_S * 1e9)
            odom_T_body = self._newest_poses.at(stamp_ns) @ child_T_body(transforms, child)
            odom_T_before = self._newest_poses.at(before_ns) @ child_T_body(transforms, child)
        _, frame = header(data, 2)
        body_T_lidar = self.options.lidar_on_vehicle(transforms, {frame}, child)
        name = f"{self.path.name} {number}"
        step = np.linalg.inv(odom_T_before) @ odom_T_body
        points = partial(_points, data, stamp_ns, body_T_lidar, step)
        return Scan(name, stamp_ns, points, odom_T_body, NO_POSE, str(self.path), body_T_lidar)

    def _read_file(self, file: Path) -> None:
        """Read the file until it grows no more or is damaged, in a thread of its own."""
        try:
            with needed("follow"):
                from mcap.exceptions import EndOfFile
                from mcap.stream_reader import StreamReader
        except ConfigError as error:
            return self._end(error)
        try:
            with file.open("rb") as growing:
                stream: Any = GrowingFile(growing, self.idle_s)
                reader = StreamReader(
                    stream, validate_crcs=True, record_size_limit=LARGEST_RECORD_BYTES
                )
                self._read_records(reader.records)
        except EndOfFile:
            pass  # the file grows no more, and was not closed
        # mcap, zstd and struct raise errors of many classes for a damaged recording
        except Exception as error:
            self.damage = (
                f"{file}: damaged, what follows was not read ({type(error).__name__}: "
                f"{str(error)[:100]})"
            )
        self._end(True)

    def _end(self, reason: Exception | bool) -> None:
        """Note that reading has ended; `reason` is the error that ended it, or True."""
        with self._changed:
            self._ended = reason
            self._changed.notify()

    def _read_records(self, records: Iterator[Any]) -> None:
        """Keep the content of the messages among the records."""
        kind_by_schema = dict[int, str]()
        topic_and_kind_by_channel = dict[int, tuple[str, str]]()
        for record in records:
            name = type(record).__name__
            if name == "Schema":
                kind_by_schema[record.id] = record.name
            elif name == "Channel":
                kind = kind_by_schema.get(record.schema_id, "")
                topic_and_kind_by_channel[record.id] = (record.topic, kind)
            elif name == "Message":
                topic, kind = topic_and_kind_by_channel[record.channel_id]
                self._keep(record, topic, kind)

    def _keep(self, record: Any, topic: str, kind: str) -> None:
        """Keep a message if it is a transform, a pose of the odometry, or a cloud."""
        if kind == TRANSFORMS:
            self._keep_transforms(record, is_static=topic.endswith("tf_static"))
        elif kind in KINDS and topic == self.options.odometry:
            self._keep_pose(record, kind)
        elif kind == CLOUD and topic == (self.options.topic or topic):
            self._keep_cloud(record)

    def _keep_transforms(self, record: Any, is_static: bool) -> None:
        """Keep each transform's first pose and a different pose, and all poses of the odometry."""
        try:
            transforms = from_cdr(record.data, TRANSFORMS).transforms
        except LogError as error:
            self.damage = f"{self.path}: a transform was left out: {error}"
            return
        with self._changed:
            for transform in transforms:
                edge, stamp_ns, numbers = transform_of(transform)
                parent, child = edge
                parent_T_child = poses([numbers])
                if self.options.odometry == f"tf:{parent}>{child}":
                    self._add_pose(stamp_ns, record, child, parent_T_child[0])
                if np.isnan(parent_T_child).any():
                    continue
                if is_static:
                    self._static_edges[edge] = (np.zeros(1, np.int64), parent_T_child)
                _, first = self._edges.get(edge, (None, parent_T_child))
                if np.abs(parent_T_child - first[:1]).max() > MAX_FIXED_CHANGE:
                    parent_T_child = np.concatenate([first[:1], parent_T_child])
                elif len(first) > 1:  # it moves, and has come back
                    continue
                self._edges[edge] = (np.zeros(len(parent_T_child), np.int64), parent_T_child)
            self._changed.notify()

    def _keep_pose(self, record: Any, kind: str) -> None:
        """Keep the pose of an odometry message; a broken message is left out."""
        try:
            stamp_ns, _ = header(record.data, 2)
            message = from_cdr(record.data, kind)
        except LogError:
            return
        child, numbers, _ = pose_of(message, kind)
        with self._changed:
            self._add_pose(stamp_ns, record, child or "", poses([numbers])[0])
            self._changed.notify()

    def _add_pose(self, stamp_ns: int, record: Any, child: str, odom_T_child: Poses) -> None:
        self._child = child
        self._newest_poses.add(stamp_ns or int(record.log_time), odom_T_child)

    def _keep_cloud(self, record: Any) -> None:
        """Add a cloud to those that wait; if too many wait, the oldest is dropped."""
        try:
            stamp_ns, _ = header(record.data, 2)
        except LogError:
            self.skipped["broken message"] += 1
            return
        with self._changed:
            if len(self._clouds) == MOST_WAITING:
                self.dropped += 1
            self._clouds.append((stamp_ns or int(record.log_time), record.data))
            self._changed.notify()


def _points(data: bytes, stamp_ns: int, body_T_lidar: Poses, step: Poses) -> NDArray[np.float64]:
    """The points (n, 3) of a cloud's message in the body's frame, deskewed to its stamp."""
    cloud = from_cdr(data, CLOUD)
    points_m = transformed(body_T_lidar, decode(cloud))
    if not np.isfinite(step).all():
        return points_m
    return deskewed(points_m, times_s(cloud, stamp_ns), step, STEP_S)
