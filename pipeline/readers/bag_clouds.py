"""Reads the clouds (PointCloud2) or sweeps (LaserScan) of one topic from the bags of a drive.

`Clouds.read` reads all headers and sorts the messages by stamp. The points of a message are read
from the bag when they are wanted, so that only one message is in memory.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Stamps
from pipeline.formats.bag import CLOUD
from pipeline.formats.bag_file import BagFile, Key
from pipeline.formats.messages import header, sweep_points
from pipeline.formats.pointcloud2 import decode, times_s
from pipeline.readers.bag_poses import message_stamps


class CloudMessage(NamedTuple):
    """The address of one message."""

    file: BagFile
    key: Key
    """Where it is in the bag."""
    stamp_ns: int
    """The stamp in its header."""


@dataclass(frozen=True)
class Clouds:
    """All readable messages of a topic of PointCloud2 or LaserScan."""

    topic: str
    kind: str
    """The type of the messages."""
    stamps_ns: Stamps
    """(cloud,) strictly increasing."""
    frames: set[str]
    """The frame_ids of all messages."""
    messages: list[CloudMessage]
    """(cloud,) the address of each message."""
    notes: tuple[str, ...]
    """Lines for the user."""

    @staticmethod
    def read(files: Sequence[BagFile], topic: str, skipped: Counter[str]) -> "Clouds":
        """Read the headers of all messages of `topic`.

        Counts in `skipped` broken messages and repeated stamps. Raises LogError for a topic of
        several types, or without any readable message.
        """
        messages: list[CloudMessage] = []
        frames: set[str] = set()
        kinds: set[str] = set()
        notes: tuple[str, ...] = ()
        for file in files:
            if topic not in file.topics:
                continue
            kinds.add(file.topics[topic].kind)
            message_count = 0
            for key, data in file.messages(topic):
                message_count += 1
                try:
                    stamp_ns, frame = header(data, file.ros)
                except LogError:
                    skipped["broken message"] += 1
                    continue
                messages.append(CloudMessage(file, key, stamp_ns))
                frames.add(frame)
            if message_count != file.topics[topic].count:
                notes += (
                    f"{file.path}: {message_count:,} messages of {topic}, but "
                    f"{file.topics[topic].count:,} in its index",
                )
        if len(kinds) > 1:
            raise LogError(
                f"{files[0].path}: {topic} is of several types in these bags: "
                f"{', '.join(sorted(kinds))}"
            )
        if not messages:
            raise LogError(f"{files[0].path}: {topic} holds no message that can be read")
        stamps_ns, stamp_notes = message_stamps(
            topic, [(message.stamp_ns, message.key.received_ns) for message in messages]
        )
        order = np.argsort(stamps_ns, kind="stable")
        is_new = np.diff(stamps_ns[order], prepend=np.int64(-1)) > 0  # no stamp is as early as −1
        skipped["stamp of an earlier one"] += int((~is_new).sum())
        order = order[is_new]
        ordered_messages = [messages[i] for i in order]
        return Clouds(
            topic=topic,
            kind=kinds.pop(),
            stamps_ns=stamps_ns[order],
            frames=frames,
            messages=ordered_messages,
            notes=notes + stamp_notes,
        )

    def points(self, row: int) -> NDArray[np.floating]:
        """Points (n, 3) in metres of one message, in the LiDAR's frame.

        Raises LogError for a broken message.
        """
        file, key, stamp_ns = self.messages[row]
        data = file.read(key)
        try:
            present_stamp_ns, _ = header(data, file.ros)
            if present_stamp_ns != stamp_ns:
                raise LogError("its stamp is not what it was when the bag was opened")
            message = file.decode(data, self.kind)
            return decode(message) if self.kind == CLOUD else sweep_points(message)
        except LogError as error:
            raise LogError(
                f"{file.path}: {self.topic} at {self.stamps_ns[row]} ns: {error}"
            ) from None

    def times_s(self, row: int) -> NDArray[np.float64] | None:
        """Seconds (n,) after the stamp at which each point of one message was measured.

        None if the message has no times. Raises LogError for a broken message.
        """
        if self.kind != CLOUD:
            return None
        file, key, _ = self.messages[row]
        return times_s(file.decode(file.read(key), self.kind), int(self.stamps_ns[row]))
