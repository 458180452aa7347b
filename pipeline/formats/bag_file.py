"""Reads ROS bags without ROS: the topics, the messages in order, and any single message again.

`rosbags` reads all kinds: a ROS 1 .bag (plain, bz2, lz4), a ROS 2 folder (sqlite3 or MCAP; zstd by
file or by message), a bare .mcap or .db3. Any exception that it raises at a damaged file becomes
one LogError that names the file.
"""

import re
import weakref
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any

from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection

from pipeline.core.errors import LogError, YearlocError
from pipeline.formats.bag import TRANSFORMS, typestore

SUFFIXES = (".bag", ".mcap", ".db3")
MCAP = b"\x89MCAP0\r\n"
"""The first bytes of an MCAP."""
ALIASES = {"tf/msg/tfMessage": TRANSFORMS}
"""Older names of message types."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag."""

    kind: str
    """The message type, such as sensor_msgs/msg/PointCloud2."""
    count: int

    def __str__(self) -> str:
        return f"{self.kind.replace('/msg/', '/')}, {self.count:,}"


@dataclass(frozen=True)
class Key:
    """Address of a message in its bag: the n-th of its topic that was received at `received_ns`."""

    topic: str
    received_ns: int
    nth: int


def plain(text: str, length: int) -> str:
    """Text from a bag for one line of an error: without unprintable letters, cut to `length`."""
    return "".join(letter if letter.isprintable() else " " for letter in text)[:length].strip()


def is_bag(path: Path) -> bool:
    """Whether a path is one bag: a file, or a ROS 2 folder with its metadata.yaml."""
    return (path / "metadata.yaml").is_file() or (path.is_file() and path.suffix in SUFFIXES)


def find(path: Path) -> list[Path]:
    """The bags at `path`: itself, or those right below it, by name."""
    if is_bag(path):
        return [path]
    return sorted(child for child in path.iterdir() if is_bag(child)) if path.is_dir() else []


class BagFile:
    """An open bag.

    It closes when nothing refers to it any more, may be shared between threads, and re-opens when
    unpickled.
    """

    def __init__(self, path: Path) -> None:
        """Raises LogError for a file that is missing, damaged, or no bag.

        `topics` are by name; `span_ns` is (first receipt, after the last receipt), and start > end
        in an empty bag.
        """
        self.path = path
        self._lock = Lock()
        self._writers: dict[str, list[Connection]] = {}
        self._store = typestore(1 if path.suffix == ".bag" and path.is_file() else 2)
        self._reader: rosbag1.Reader | rosbag2.Reader
        with self._refusing():
            self._reader = (
                rosbag1.Reader(path)
                if path.suffix == ".bag" and path.is_file()
                else rosbag2.Reader(path)
            )
            self._reader.open()
            weakref.finalize(self, self._reader.close)
            self.topics: dict[str, Topic] = {}
            for connection in sorted(
                self._reader.connections, key=lambda connection: connection.topic
            ):
                earlier_count = (
                    self.topics[connection.topic].count if connection.topic in self.topics else 0
                )
                self.topics[connection.topic] = Topic(
                    _kind(connection), int(connection.msgcount) + earlier_count
                )
            self.span_ns = int(self._reader.start_time), int(self._reader.end_time)

    def __reduce__(self) -> tuple[type["BagFile"], tuple[Path]]:
        return BagFile, (self.path,)

    def messages(self, topic: str) -> Generator[tuple[Key, bytes], None, None]:
        """Every message of a topic, as bytes, in order of receipt.

        Raises LogError where the file is damaged.
        """
        counts: Counter[int] = Counter()
        with self._lock, self._refusing():
            for _, received_ns, data in self._reader.messages(self._connections(topic)):
                yield Key(topic, received_ns, counts[received_ns]), bytes(data)
                counts[received_ns] += 1

    def first(self, topic: str) -> bytes | None:
        """The first message of a topic; None where there is none."""
        with closing(self.messages(topic)) as messages:
            return next((data for _, data in messages), None)

    def read(self, key: Key) -> bytes:
        """The bytes of one message; raises LogError if it is no longer there."""
        with self._lock, self._refusing():
            messages = self._reader.messages(
                self._connections(key.topic), key.received_ns, key.received_ns + 1
            )
            message = next(islice(messages, key.nth, None), None)
        if message is None:
            raise LogError(
                f"{self.path}: a message of {key.topic} is gone; was the file changed since it was "
                "opened?"
            )
        return bytes(message[2])

    def decode(self, data: bytes, kind: str) -> Any:
        """A message of a standard type from its bytes; raises LogError for a broken one."""
        unpack = self._store.deserialize_ros1 if self.ros == 1 else self._store.deserialize_cdr
        try:
            return unpack(data, kind)
        except Exception as error:  # as below
            raise LogError(
                f"{self.path}: a broken {kind.replace('/msg/', '/')}: {_reason(error)}"
            ) from None

    @property
    def ros(self) -> int:
        """The version of ROS: 1 or 2."""
        return 1 if isinstance(self._reader, rosbag1.Reader) else 2

    def _connections(self, topic: str) -> list[Connection]:
        """The connections that wrote a topic.

        Raises LogError for messages that are not of one standard type.
        """
        if topic in self._writers:
            return self._writers[topic]
        connections = [
            connection for connection in self._reader.connections if connection.topic == topic
        ]
        for connection in connections:
            kind = _kind(connection)
            if kind != self.topics[topic].kind:
                kinds = plain(f"{kind}, {self.topics[topic].kind}", 120)
                raise LogError(
                    f"{self.path}: {plain(topic, 60)} has messages of several types: {kinds}"
                )
            has_ros1_definition = self.ros == 1 and kind in self._store.fielddefs
            if has_ros1_definition and connection.digest not in (
                "*",
                self._store.generate_msgdef(kind)[1],
            ):
                md5 = plain(connection.digest, 32)
                raise LogError(
                    f"{self.path}: {plain(topic, 60)} is not ROS's own {kind}: its definition has "
                    f"the MD5 {md5}"
                )
        self._writers[topic] = connections
        return connections

    @contextmanager
    def _refusing(self) -> Iterator[None]:
        try:
            yield
        except YearlocError:
            raise
        # rosbags, sqlite, zstd, yaml and struct raise whatever they like at a damaged file
        except Exception as error:
            raise LogError(f"{self.path}: {_why(self.path, error)}") from None


def _kind(connection: Connection) -> str:
    return ALIASES.get(connection.msgtype, connection.msgtype)


def _why(path: Path, error: Exception) -> str:
    """The error line for a bag that cannot be read: what is wrong, and what to do."""
    if not path.exists():
        return "no such bag"
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(64)
        if not head:
            return "an empty file; record or fetch it anew"
        version = re.match(rb"#ROS[A-Z]+ V(\d+\.\d+)", head)
        if version and version[1] != b"2.0":
            return (
                f"a ROS 1 bag of version {version[1].decode()}; only 2.0 can be read: convert it "
                "with `rosbag fix`"
            )
        if head.startswith(MCAP) and (profile := _profile(head)) != "ros2":
            advice = (
                "give the ROS 1 .bag that it was made from"
                if profile == "ros1"
                else "let `ros2 bag record` write it"
            )
            return f"an MCAP of profile {profile!a}; only those of ROS 2 can be read: {advice}"
    reason = _reason(error)
    return (
        f"cannot be read as a bag: {reason}; if it is cut short or unindexed, `rosbag|ros2 bag "
        "reindex` or `mcap recover` it"
    )


def _profile(head: bytes) -> str:
    """The profile that the header of an MCAP names, which is what wrote its messages."""
    size = int.from_bytes(head[17:21], "little")
    return plain(head[21 : 21 + size].decode("utf-8", "replace"), 40)


def _reason(error: Exception) -> str:
    return (
        plain(str(error), 160).rstrip(".")
        or f"sizes and contents do not fit ({type(error).__name__})"
    )
