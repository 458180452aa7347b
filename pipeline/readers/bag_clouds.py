"""Reads the clouds or sweeps of bags in order of their stamps, points one message at a time."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Stamps
from pipeline.formats.bag import CLOUD
from pipeline.formats.bag_file import BagFile, Key
from pipeline.formats.messages import header, sweep_points
from pipeline.formats.pointcloud2 import decode, times_s
from pipeline.readers.bag_poses import message_stamps


@dataclass(frozen=True)
class Clouds:
    """Every message of a topic of PointCloud2 or LaserScan."""

    topic: str
    kind: str
    stamps_ns: Stamps
    """(cloud,) strictly increasing."""
    frames: set[str]
    """The frame_ids of all messages."""
    keys: list[tuple[BagFile, Key, int]]
    """(cloud,) bag, address of the message in it, and the stamp in its header."""
    notes: tuple[str, ...]

    @staticmethod
    def read(files: Sequence[BagFile], topic: str, skipped: Counter[str]) -> "Clouds":
        """Read all headers, with one message in memory at a time.

        Counts in `skipped` broken messages and repeated stamps. Raises LogError for a topic of
        several types, or without any readable message.
        """
        keys: list[tuple[BagFile, Key, int]] = []
        frames: set[str] = set()
        kinds: set[str] = set()
        notes: tuple[str, ...] = ()
        for file in (file for file in files if topic in file.topics):
            kinds.add(file.topics[topic].kind)
            count = 0
            for key, data in file.messages(topic):
                count += 1
                try:
                    stamp_ns, frame = header(data, file.ros)
                except LogError:
                    skipped["broken message"] += 1
                    continue
                keys.append((file, key, stamp_ns))
                frames.add(frame)
            if count != file.topics[topic].count:
                notes += (
                    f"{file.path}: {count:,} messages of {topic}, but "
                    f"{file.topics[topic].count:,} in its index",
                )
        if len(kinds) > 1:
            raise LogError(
                f"{files[0].path}: {topic} is of several types in these bags: "
                f"{', '.join(sorted(kinds))}"
            )
        if not keys:
            raise LogError(f"{files[0].path}: {topic} holds no message that can be read")
        times, unstamped = message_stamps(
            topic, [(stamp_ns, key.received_ns) for _, key, stamp_ns in keys]
        )
        order = np.argsort(times, kind="stable")
        fresh = np.diff(times[order], prepend=np.int64(-1)) > 0
        skipped["stamp of an earlier one"] += int((~fresh).sum())
        order = order[fresh]
        return Clouds(
            topic, kinds.pop(), times[order], frames, [keys[i] for i in order], notes + unstamped
        )

    def points(self, row: int) -> NDArray[np.floating]:
        """Points (n, 3) in metres of one message, in the LiDAR's frame.

        Raises LogError for a broken one.
        """
        file, key, stamp_ns = self.keys[row]
        data = file.read(key)
        try:
            if header(data, file.ros)[0] != stamp_ns:
                raise LogError("its stamp is not what it was when the bag was opened")
            message = file.decode(data, self.kind)
            return decode(message) if self.kind == CLOUD else sweep_points(message)
        except LogError as error:
            raise LogError(
                f"{file.path}: {self.topic} at {self.stamps_ns[row]} ns: {error}"
            ) from None

    def times_s(self, row: int) -> NDArray[np.float64] | None:
        """Seconds (n,) after the stamp at which each point of a message was measured.

        None where a message does not say. Raises LogError for a broken one.
        """
        file, key, _ = self.keys[row]
        if self.kind != CLOUD:
            return None
        return times_s(file.decode(file.read(key), self.kind), int(self.stamps_ns[row]))
