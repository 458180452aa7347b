"""Lists what the bags of a drive hold: their paths in; topics and transforms out.

A topic has its type, count, rate and frames, over all bags together. The functions below choose the
topics that are most likely the LiDAR's, the true poses, the odometry and the gyroscope.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.formats.bag import CLOUD, IMU, ODOMETRY, SWEEP, TRANSFORMS
from pipeline.formats.bag_file import BagFile, plain
from pipeline.formats.messages import frame_name, header
from pipeline.formats.pointcloud2 import decode
from pipeline.readers.bag_poses import KINDS
from pipeline.readers.mounting import Transforms

WORLDS = ("map", "world", "earth", "utm", "enu", "global")
"""Frames that stand still, the likeliest first."""
TRUE_NAMES = re.compile("truth|gt|gnss|gps|rtk|ins|slam|map|locali")
"""Matches the names of topics that are likely to hold true poses."""
DRIFTING_NAMES = re.compile("odom|vo|vio|wheel")
"""Matches the names and frames of poses that are likely to drift."""
PACKET_TYPES = ("CustomMsg", "VelodyneScan", "PacketMsg")
"""Messages of Livox, Velodyne and Ouster, of which their drivers make PointCloud2."""
CLOUD_STEP = 10
CLOUD_COUNT = 9
"""`Contents.clouds` reads CLOUD_COUNT clouds of a topic, one in CLOUD_STEP."""


@dataclass(frozen=True)
class TopicSummary:
    """A topic over all bags."""

    name: str
    kind: str
    """The type of its messages."""
    count: int
    """Number of messages."""
    rate_hz: float
    """NaN where it is unknown."""
    frame: str
    """frame_id of the first message; empty if it is broken, and for types that the reader does not
    use."""
    child: str
    """child_frame_id of an Odometry, else empty."""

    @property
    def drifts(self) -> bool:
        """Whether its poses are likely odometry, by the words in its name and frame."""
        return bool(DRIFTING_NAMES.search(f"{self.frame} {self.name}"))


@dataclass(frozen=True)
class Contents:
    """The contents of all bags."""

    files: tuple[BagFile, ...]
    """The bags that can be read."""
    topics: tuple[TopicSummary, ...]
    """All topics, by name."""
    transforms: Transforms
    """All transforms."""
    errors: tuple[str, ...]
    """The error line of each bag that cannot be read."""

    @staticmethod
    def read(paths: Sequence[Path]) -> "Contents":
        """Open all bags; raises LogError where none of them can be read."""
        files: list[BagFile] = []
        errors: list[str] = []
        for path in paths:
            try:
                files.append(BagFile(path))
            except LogError as error:
                errors.append(str(error))
        if not files:
            raise LogError(errors[0])
        names = sorted({name for file in files for name in file.topics})
        topics = tuple(_summary(files, name) for name in names)
        return Contents(tuple(files), topics, Transforms.read(files), tuple(errors))

    @property
    def span_ns(self) -> tuple[int, int]:
        """The times of receipt of the first message, and after that of the last one."""
        start_ns = min(file.span_ns[0] for file in self.files)
        end_ns = max(file.span_ns[1] for file in self.files)
        return start_ns, end_ns

    def of(self, *kinds: str) -> list[TopicSummary]:
        """The topics of these types that hold a message, the most frequent first."""
        topics = [topic for topic in self.topics if topic.kind in kinds and topic.count]
        return sorted(topics, key=lambda topic: -topic.count)

    def clouds(self, topic: TopicSummary) -> Iterator[NDArray[np.floating]]:
        """Points (n, 3) in metres of a few clouds, in their own frame.

        They are every tenth cloud at the start of the first bag that has the topic; broken ones are
        left out.
        """
        file = next(
            file
            for file in self.files
            if topic.name in file.topics and file.topics[topic.name].count
        )
        messages = islice(file.messages(topic.name), 0, CLOUD_COUNT * CLOUD_STEP, CLOUD_STEP)
        for _, data in messages:
            with suppress(LogError):
                yield decode(file.decode(data, topic.kind))


def _summary(files: Sequence[BagFile], name: str) -> TopicSummary:
    """The topic `name` over all files that have it."""
    files = [file for file in files if name in file.topics]
    files_with_messages = [file for file in files if file.topics[name].count]
    kind = files[0].topics[name].kind
    count = sum(file.topics[name].count for file in files)
    span_s = 1e-9 * sum(max(file.span_ns[1] - file.span_ns[0], 0) for file in files_with_messages)
    rate_hz = count / span_s if span_s > 0 else np.nan
    frame = ""
    child = ""
    if kind in (CLOUD, SWEEP, *KINDS):
        file = files_with_messages[0] if files_with_messages else files[0]
        with suppress(LogError):  # a broken message: both stay empty, or the child
            data = file.first(name) or b""
            _, frame = header(data, file.ros)
            if kind == ODOMETRY:
                child = frame_name(file.decode(data, kind).child_frame_id)
    return TopicSummary(name, kind, count, rate_hz, frame, child)


def points_source(contents: Contents, poses: TopicSummary | None) -> TopicSummary:
    """The topic that is most likely the LiDAR's.

    It is the most frequent one of clouds, or else of sweeps. One that is already in the world frame
    of the `poses` is taken only if there is no other. Raises LogError for bags without points.
    """
    sources = contents.of(CLOUD) or contents.of(SWEEP)
    if not sources:
        raise LogError(f"{contents.files[0].path}: {_without_points(contents)}")
    for source in sources:
        if poses is None or source.frame != poses.frame:
            return source
    return sources[0]


def _without_points(contents: Contents) -> str:
    """The error on bags without points: what they hold instead."""
    topic_list = ", ".join(f"{topic.name} ({topic.kind})" for topic in contents.topics) or "nothing"
    advice = ""
    for topic in contents.topics:
        if topic.kind.rpartition("/")[2] in PACKET_TYPES:
            advice = (
                f"; let the lidar's driver make PointCloud2 of {topic.kind} while `ros2 bag "
                "record` runs"
            )
            break
    return f"neither a PointCloud2 nor a LaserScan in it; it holds {plain(topic_list, 800)}{advice}"


def drifting(contents: Contents) -> TopicSummary | None:
    """The source of poses that is most likely odometry, which drifts but never jumps; else None."""
    best_poses, odometry = pose_sources(contents)
    if odometry is None and best_poses is not None and best_poses.drifts:
        return best_poses
    return odometry


def gyroscope(contents: Contents) -> TopicSummary | None:
    """The most frequent topic of an IMU; None without any."""
    return next(iter(contents.of(IMU)), None)


def pose_sources(contents: Contents) -> tuple[TopicSummary | None, TopicSummary | None]:
    """The source of poses that is most likely the ground truth, and the likeliest odometry.

    The two differ. Each is None where the bags hold no such source.
    """
    sources = contents.of(*KINDS)
    tree = contents.transforms.read_all()
    frames = {frame for edge in tree.edges for frame in edge}
    body = contents.transforms.vehicle()
    for world in (*WORLDS, "odom"):
        if body and world in frames and tree.moves(world, body):
            name = f"tf:{world}>{body}"
            sources.append(
                TopicSummary(name, TRANSFORMS, count=0, rate_hz=np.nan, frame=world, child=body)
            )
    best = max(sources, key=_trust, default=None)
    drifting_sources = [source for source in sources if source is not best and source.drifts]
    return best, min(drifting_sources, key=_trust, default=None)


def _trust(source: TopicSummary) -> int:
    """A score, larger for poses that are more likely the ground truth than odometry."""
    score = 0
    if source.frame in WORLDS:
        score += 8
    if TRUE_NAMES.search(source.name):
        score += 4
    if source.drifts:
        score -= 4
    if not source.name.startswith("tf:"):
        score += 1
    return score
