"""Lists what the bags of a drive hold: their paths in; topics and transforms out.

A topic has its type, count, rate and frames, over all bags together. `bags` describes the contents
to the user, `bag_proposal` proposes a yaml from them.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.formats.bag import CLOUD, ODOMETRY, SWEEP
from pipeline.formats.bag_file import BagFile
from pipeline.formats.messages import frame_name, header
from pipeline.formats.pointcloud2 import decode
from pipeline.readers.bag_poses import KINDS
from pipeline.readers.mounting import Transforms

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
