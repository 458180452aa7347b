"""What bags hold: topics with their types, counts, rates and frames, and the tree of frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import LogError
from pipeline.formats.bag import CLOUD, ODOMETRY, SWEEP
from pipeline.formats.bag_file import BagFile
from pipeline.formats.messages import frame_name, header, sweep_points
from pipeline.formats.pointcloud2 import decode
from pipeline.readers.bag_poses import KINDS
from pipeline.readers.bag_tree import Tree


@dataclass(frozen=True)
class Held:
    """A topic over all bags."""

    name: str
    kind: str
    count: int
    rate_hz: float
    """NaN where it cannot be told."""
    frame: str
    """frame_id of its first message; empty if that is broken, and for types that the reader does not use."""
    child: str
    """child_frame_id of an Odometry."""


@dataclass(frozen=True)
class Contents:
    """All of some bags."""

    files: tuple[BagFile, ...]
    topics: tuple[Held, ...]
    tree: Tree
    broken: tuple[str, ...]
    """Of each bag that cannot be read, why."""

    @staticmethod
    def read(paths: Sequence[Path]) -> "Contents":
        """Raises LogError where none of the bags can be read."""
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
        return Contents(tuple(files), tuple(_held(files, name) for name in names), Tree.read(files, moving=True), tuple(broken))

    @property
    def span_ns(self) -> tuple[int, int]:
        """From the first message to the last."""
        return min(file.span_ns[0] for file in self.files), max(file.span_ns[1] for file in self.files)

    def of(self, *kinds: str) -> list[Held]:
        """The topics of some types that hold a message, the most frequent first."""
        return sorted((topic for topic in self.topics if topic.kind in kinds and topic.count), key=lambda topic: -topic.count)

    def first_points(self, topic: Held) -> NDArray[np.floating]:
        """Points (n, 3) of its first message, in its own frame; raises LogError for a broken one."""
        file = next(file for file in self.files if topic.name in file.topics and file.topics[topic.name].count)
        message = file.decode(file.first(topic.name) or b"", topic.kind)
        return decode(message).points if topic.kind == CLOUD else sweep_points(message)


def _held(files: Sequence[BagFile], name: str) -> Held:
    holding = [file for file in files if name in file.topics]
    kind, count = holding[0].topics[name].kind, sum(file.topics[name].count for file in holding)
    seconds = sum(max(file.span_ns[1] - file.span_ns[0], 0) for file in holding if file.topics[name].count) * 1e-9
    frame = child = ""
    if kind in (CLOUD, SWEEP, *KINDS):
        file = next((file for file in holding if file.topics[name].count), holding[0])
        try:
            data = file.first(name) or b""
            frame = header(data, file.ros)[1]
            child = frame_name(file.decode(data, kind).child_frame_id) if kind == ODOMETRY else ""
        except LogError:
            pass
    return Held(name, kind, count, count / seconds if seconds > 0 else np.nan, frame, child)
