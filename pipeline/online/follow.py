"""Reads the clouds of an MCAP recording while it is still being written.

Clouds that wait too long are dropped and counted.
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

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import Poses
from pipeline.formats.bag import CLOUD, ODOMETRY, TRANSFORMS
from pipeline.formats.messages import (
    frame_name,
    from_cdr,
    header,
    pose_numbers,
    poses,
    transform_numbers,
)
from pipeline.formats.pointcloud2 import decode, times_s
from pipeline.online.inputs import NO_POSE, Scan, child_T_body, extrinsic, placed
from pipeline.online.odometry import AHEAD_S, Newest
from pipeline.readers.bag_poses import KINDS, Tree
from pipeline.readers.deskew import deskewed
from pipeline.readers.log import raised

POLL_S = 0.02
WAITING = 8
"""Clouds that may wait: a recorder writes several at once. Of more the oldest is dropped."""
STEP_S = 0.1
"""The motion within a cloud is taken to be as in this time before its stamp."""


class GrowingFile:
    """A file that another process is writing.

    A read waits for bytes that are not there yet, and ends after `idle_s` without any.
    """

    def __init__(self, file: BinaryIO, idle_s: float) -> None:
        self._file = file
        self._idle_s = idle_s

    def read(self, size: int) -> bytes:
        """Read `size` bytes; fewer at the end of the file."""
        parts = []
        missing = size
        since = time.monotonic()
        while missing > 0 and time.monotonic() - since < self._idle_s:
            if part := self._file.read(missing):
                parts.append(part)
                missing = missing - len(part)
                since = time.monotonic()
            else:
                time.sleep(POLL_S)
        return b"".join(parts)


@dataclass
class Following:
    """Reads a recording in a thread of its own, and hands out the oldest cloud that still waits."""

    path: Path
    """FILE.mcap, or the folder that `ros2 bag record` writes it into."""
    topic: str | None
    lift_m: float
    idle_s: float
    odometry: str | None = None
    """A topic of poses, or tf:PARENT>CHILD, of one transform that is sent as such."""
    body_T_lidar: Poses | None = None
    """(4, 4) places the points, in place of the transforms and of `lift_m`."""
    dropped: int = field(default=0, init=False)
    """Clouds that were pushed out by newer ones."""
    skipped: Counter[str] = field(default_factory=Counter, init=False)
    """Clouds that cannot be taken: reason to count."""
    damage: str = field(default="", init=False)
    """Why reading ended before the recording did; empty where it did not."""

    def scans(self) -> Iterator[Scan]:
        """The scans of the recording, until nothing has been written for `idle_s`.

        Raises LogError where no recording is, or it holds no cloud.
        """
        file = (
            self.path if self.path.is_file() else next(iter(sorted(self.path.glob("*.mcap"))), None)
        )
        if file is None or file.suffix != ".mcap":
            raise LogError(
                f"{self.path}: no .mcap recording to follow; other bags can be localised once they "
                "are written"
            )
        self._clouds = deque[tuple[int, bytes]](maxlen=WAITING)
        self._ended: Exception | bool = False
        self._changed = Condition()
        self._edges = dict[tuple[str, str], tuple[Any, Any]]()
        self._newest_poses = Newest()
        self._child = ""
        Thread(target=self._reading, args=(file,), daemon=True).start()
        number = 0
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._clouds or self._ended)
                oldest = self._clouds.popleft() if self._clouds else None
                if oldest and self.odometry:
                    self._changed.wait_for(partial(self._poses_reach, oldest[0]), AHEAD_S)
            if oldest is None:
                break
            yield self._scan(number, *oldest)
            number += 1
        if self.odometry and not self._newest_poses.count:
            self.damage = self.damage or f"{file}: no pose of {self.odometry} came"
        if isinstance(self._ended, ConfigError):
            raise self._ended
        if not number and self.damage:
            raise LogError(self.damage)
        if not number:
            raise LogError(
                f"{file}: no PointCloud2{f' on {self.topic}' if self.topic else ''} came within "
                f"{self.idle_s:g} s"
            )

    def _scan(self, number: int, stamp_ns: int, data: bytes) -> Scan:
        tree = Tree(str(self.path), dict(self._edges), 0)
        with self._changed:
            odom_T_body = self._newest_poses.at(stamp_ns) @ child_T_body(tree, self._child)
            before_ns = stamp_ns - round(STEP_S * 1e9)
            odom_T_before = self._newest_poses.at(before_ns) @ child_T_body(tree, self._child)
        body_T_lidar = self.body_T_lidar
        if body_T_lidar is None:
            body_T_lidar = raised(self.lift_m) @ extrinsic(tree, {header(data, 2)[1]})
        name = f"{self.path.name} {number}"
        step = np.linalg.inv(odom_T_before) @ odom_T_body
        points = partial(_points, data, stamp_ns, body_T_lidar, step)
        return Scan(name, stamp_ns, points, odom_T_body, NO_POSE, str(self.path), body_T_lidar)

    def _poses_reach(self, stamp_ns: int) -> bool:
        return bool(self._ended) or self._newest_poses.stamp_ns >= stamp_ns

    def _reading(self, file: Path) -> None:
        """Keep the newest clouds and all fixed transforms until the file ends or is damaged."""
        try:
            from mcap.exceptions import EndOfFile
            from mcap.stream_reader import StreamReader
        except ImportError:
            return self._end(ConfigError("mcap: not installed; `pip install 'yearloc[follow]'`"))
        try:
            with file.open("rb") as growing:
                stream: Any = GrowingFile(growing, self.idle_s)
                self._read(
                    StreamReader(stream, validate_crcs=True, record_size_limit=2**28).records
                )
        except EndOfFile:
            pass  # it grows no more, and was not closed
        # mcap, zstd and struct raise whatever they like at a damaged recording
        except Exception as error:
            self.damage = (
                f"{file}: damaged, what follows was not read ({type(error).__name__}: "
                f"{str(error)[:100]})"
            )
        self._end(True)

    def _end(self, reason: Exception | bool) -> None:
        with self._changed:
            self._ended = reason
            self._changed.notify()

    def _read(self, records: Iterator[Any]) -> None:
        kinds = dict[int, str]()
        topics = dict[int, tuple[str, str]]()
        for record in records:
            name = type(record).__name__
            if name == "Schema":
                kinds[record.id] = record.name
            elif name == "Channel":
                topics[record.id] = (record.topic, kinds.get(record.schema_id, ""))
            elif name == "Message":
                topic, kind = topics[record.channel_id]
                if kind == TRANSFORMS and topic.endswith("tf_static"):
                    self._keep_transforms(record.data)
                elif self.odometry and (
                    topic == self.odometry
                    or (kind == TRANSFORMS and self.odometry.startswith("tf:"))
                ):
                    self._keep_poses(record, kind)
                elif kind == CLOUD and topic == (self.topic or topic):
                    self._keep_cloud(record)

    def _keep_transforms(self, data: bytes) -> None:
        try:
            transforms = from_cdr(data, TRANSFORMS).transforms
        except LogError as error:
            self.damage = f"{self.path}: a transform was left out: {error}"
            return
        for transform in transforms:
            self._edges[_edge(transform)] = (
                np.zeros(1, np.int64),
                poses([transform_numbers(transform)]),
            )

    def _keep_poses(self, record: Any, kind: str) -> None:
        """Keep the poses of an odometry message.

        One that is broken or of another kind is passed over.
        """
        try:
            message = from_cdr(record.data, kind)
            if kind == TRANSFORMS:
                transforms = [
                    transform
                    for transform in message.transforms
                    if self.odometry == f"tf:{_edge(transform)[0]}>{_edge(transform)[1]}"
                ]
                stamped_poses = [
                    (transform.header.stamp, _edge(transform)[1], transform_numbers(transform))
                    for transform in transforms
                ]
            else:
                child = frame_name(message.child_frame_id) if kind == ODOMETRY else ""
                stamped_poses = (
                    [(message.header.stamp, child, pose_numbers(message, kind))]
                    if kind in KINDS
                    else []
                )
        except LogError:
            return
        with self._changed:
            for stamp, self._child, numbers in stamped_poses:
                self._newest_poses.add(
                    stamp.sec * 10**9 + stamp.nanosec or int(record.log_time), poses([numbers])[0]
                )
            self._changed.notify()

    def _keep_cloud(self, record: Any) -> None:
        try:
            stamp_ns = header(record.data, 2)[0] or int(record.log_time)
        except LogError:
            self.skipped["broken message"] += 1
            return
        with self._changed:
            self.dropped += len(self._clouds) == WAITING
            self._clouds.append((stamp_ns, record.data))
            self._changed.notify()


def _points(data: bytes, stamp_ns: int, body_T_lidar: Poses, step: Poses) -> NDArray[np.float64]:
    """The points (n, 3) in the body as they lay at the stamp, by its `step` of STEP_S before it."""
    cloud = from_cdr(data, CLOUD)
    points_m = placed(decode(cloud), body_T_lidar)
    if not np.isfinite(step).all():
        return points_m
    return deskewed(points_m, times_s(cloud, stamp_ns), step, STEP_S)


def _edge(transform: Any) -> tuple[str, str]:
    """The parent and child frame of a transform."""
    return frame_name(transform.header.frame_id), frame_name(transform.child_frame_id)
