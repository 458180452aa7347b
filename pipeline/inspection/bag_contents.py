"""The contents of bags: paths in; topics with types, counts, rates and frames, and transforms out.

Of all bags of a drive together; `bags` describes them, `bag_proposal` makes a yaml of them.
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
from pipeline.readers.bag_poses import KINDS, Tree


@dataclass(frozen=True)
class TopicSummary:
    """A topic over all bags."""

    name: str
    kind: str
    count: int
    rate_hz: float
    """NaN where it is unknown."""
    frame: str
    """frame_id of the first message; empty if it is broken, and for types that the reader does not
    use."""
    child: str
    """child_frame_id of an Odometry."""


@dataclass(frozen=True)
class Contents:
    """The contents of all bags."""

    files: tuple[BagFile, ...]
    topics: tuple[TopicSummary, ...]
    tree: Tree
    broken: tuple[str, ...]
    """The error line of each bag that cannot be read."""

    @staticmethod
    def read(paths: Sequence[Path]) -> "Contents":
        """Open all bags; raises LogError where none of them can be read."""
        files: list[BagFile] = []
        broken: list[str] = []
        for path in paths:
            try:
                files.append(BagFile(path))
            except LogError as error:
                broken.append(str(error))
        if not files:
            raise LogError(broken[0])
        names = sorted({name for file in files for name in file.topics})
        topics = tuple(_summary(files, name) for name in names)
        return Contents(tuple(files), topics, Tree.read(files, moving=True), tuple(broken))

    @property
    def span_ns(self) -> tuple[int, int]:
        """Receipt of the first and of the last message."""
        return min(file.span_ns[0] for file in self.files), max(
            file.span_ns[1] for file in self.files
        )

    def of(self, *kinds: str) -> list[TopicSummary]:
        """The topics of these types that hold a message, the most frequent first."""
        return sorted(
            (topic for topic in self.topics if topic.kind in kinds and topic.count),
            key=lambda topic: -topic.count,
        )

    def clouds(self, topic: TopicSummary) -> Iterator[NDArray[np.floating]]:
        """Points (n, 3) in metres of nine clouds, in their own frame.

        They are every tenth cloud of the first bag that has the topic; broken ones are left out.
        """
        file = next(
            file
            for file in self.files
            if topic.name in file.topics and file.topics[topic.name].count
        )
        for _, data in islice(file.messages(topic.name), 0, 90, 10):
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
        file = next(iter(files_with_messages), files[0])
        with suppress(LogError):
            data = file.first(name) or b""
            frame = header(data, file.ros)[1]
            child = frame_name(file.decode(data, kind).child_frame_id) if kind == ODOMETRY else ""
    return TopicSummary(name, kind, count, rate_hz, frame, child)
