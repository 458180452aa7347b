"""Reads ROS bags without ROS: a bag in; its topics, and the bytes of its messages, out.

`rosbags` reads all kinds: a ROS 1 .bag (plain, bz2, lz4), a ROS 2 folder (sqlite3 or MCAP; zstd by
file or by message), a bare .mcap or .db3. Any exception that it raises at a damaged file becomes
one LogError that names the file. `messages` and `pointcloud2` turn the bytes into arrays.
"""

import re
import weakref
from collections import Counter
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from itertools import islice
from operator import attrgetter
from pathlib import Path
from threading import Lock
from typing import Any

from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection

from pipeline.core.errors import LogError, YearlocError
from pipeline.formats.bag import TRANSFORMS, typestore

SUFFIXES = (".bag", ".mcap", ".db3")
"""Suffixes of bags that are one file."""
MCAP_MAGIC = b"\x89MCAP0\r\n"
"""The first bytes of an MCAP."""
ALIASES = {"tf/msg/tfMessage": TRANSFORMS}
"""Today's names of message types by their older ones."""


@dataclass(frozen=True)
class Topic:
    """A topic of a bag."""

    kind: str
    """The message type, such as sensor_msgs/msg/PointCloud2."""
    count: int
    """Number of messages."""

    def __str__(self) -> str:
        return f"{self.kind.replace('/msg/', '/')}, {self.count:,}"


@dataclass(frozen=True)
class Key:
    """Address of a message in its bag."""

    topic: str
    received_ns: int
    nth: int
    """Its number, from 0, among the messages of the topic that were received at `received_ns`."""


def plain(text: str, length: int) -> str:
    """Text from a bag, made fit for an error line: printable letters only, cut to `length`."""
    return "".join(letter if letter.isprintable() else " " for letter in text)[:length].strip()


def is_bag(path: Path) -> bool:
    """Whether a path is one bag: a file, or a ROS 2 folder with its metadata.yaml."""
    return (path / "metadata.yaml").is_file() or (path.is_file() and path.suffix in SUFFIXES)


def find(path: Path) -> list[Path]:
    """The bags at `path`: the path itself, or those right below it, sorted by name."""
    if is_bag(path):
        return [path]
    if not path.is_dir():
        return []
    return sorted(child for child in path.iterdir() if is_bag(child))


class BagFile:
    """An open bag.

    It closes when nothing refers to it any more, may be shared between threads, and re-opens when
    unpickled.
    """

    def __init__(self, path: Path) -> None:
        """Open the bag at `path`; raises LogError for a file that is missing, damaged, or no bag.

        `topics` are by name. `span_ns` is the time of the first receipt and the time after the last
        one; in an empty bag the first is later than the last.
        """
        self.path = path
        self._lock = Lock()
        self._connections_by_topic: dict[str, list[Connection]] = {}
        is_ros1 = path.suffix == ".bag" and path.is_file()
        self._store = typestore(1 if is_ros1 else 2)
        self._reader: rosbag1.Reader | rosbag2.Reader
        with self._refusing():
            self._reader = rosbag1.Reader(path) if is_ros1 else rosbag2.Reader(path)
            self._reader.open()
            weakref.finalize(self, self._reader.close)
            self.topics: dict[str, Topic] = {}
            for connection in sorted(self._reader.connections, key=attrgetter("topic")):
                name = connection.topic
                count = int(connection.msgcount)
                if name in self.topics:  # several nodes wrote it
                    count += self.topics[name].count
                self.topics[name] = Topic(_kind(connection), count)
            self.span_ns = int(self._reader.start_time), int(self._reader.end_time)

    def __reduce__(self) -> tuple[type["BagFile"], tuple[Path]]:
        return BagFile, (self.path,)

    def messages(self, topic: str) -> Generator[tuple[Key, bytes], None, None]:
        """Every message of a topic, its address and its bytes, in order of receipt.

        Raises LogError where the file is damaged.
        """
        counts: Counter[int] = Counter()
        with self._lock, self._refusing():
            for _, received_ns, data in self._reader.messages(self._connections(topic)):
                yield Key(topic, received_ns, counts[received_ns]), bytes(data)
                counts[received_ns] += 1

    def first(self, topic: str) -> bytes | None:
        """The bytes of the first message of a topic; None where there is none."""
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
        _, _, data = message  # after the connection and the time of receipt
        return bytes(data)

    def decode(self, data: bytes, kind: str) -> Any:
        """A message of the standard type `kind` from its bytes; raises LogError if it is broken."""
        unpack = self._store.deserialize_ros1 if self.ros == 1 else self._store.deserialize_cdr
        try:
            return unpack(data, kind)
        except Exception as error:  # rosbags raises errors of any type
            raise LogError(
                f"{self.path}: a broken {kind.replace('/msg/', '/')}: {_reason(error)}"
            ) from None

    @property
    def ros(self) -> int:
        """The version of ROS: 1 or 2."""
        return 1 if isinstance(self._reader, rosbag1.Reader) else 2

    def _connections(self, topic: str) -> list[Connection]:
        """The connections, one a node, of a topic of one type and of the standard's definition."""
        if topic in self._connections_by_topic:
            return self._connections_by_topic[topic]
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
            if self.ros == 2 or kind not in self._store.fielddefs:
                continue
            _, standard_md5 = self._store.generate_msgdef(kind)
            if connection.digest not in ("*", standard_md5):
                md5 = plain(connection.digest, 32)
                raise LogError(
                    f"{self.path}: {plain(topic, 60)} is not ROS's own {kind}: its definition has "
                    f"the MD5 {md5}"
                )
        self._connections_by_topic[topic] = connections
        return connections

    @contextmanager
    def _refusing(self) -> Iterator[None]:
        """Turn any exception of a damaged file into a LogError."""
        try:
            yield
        except YearlocError:
            raise
        # rosbags, sqlite, zstd, yaml and struct raise errors of any type at a damaged file
        except Exception as error:
            raise LogError(f"{self.path}: {_why(self.path, error)}") from None


def _kind(connection: Connection) -> str:
    """The type of a connection's messages, by its name of today."""
    return ALIASES.get(connection.msgtype, connection.msgtype)


def _why(path: Path, error: Exception) -> str:
    """Why a bag cannot be read, and what to do, for an error line."""
    if not path.exists():
        return "no such bag"
    if path.is_file():
        with path.open("rb") as file:
            head = file.read(64)
        if not head:
            return "an empty file; record or fetch it again"
        version = re.match(rb"#ROS[A-Z]+ V(\d+\.\d+)", head)
        if version and version[1] != b"2.0":
            return (
                f"a ROS 1 bag of version {version[1].decode()}; only 2.0 can be read: convert it "
                "with `rosbag fix`"
            )
        if head.startswith(MCAP_MAGIC) and (profile := _profile(head)) != "ros2":
            advice = "let `ros2 bag record` write it"
            if profile == "ros1":
                advice = "give the ROS 1 .bag that it was made from"
            return f"an MCAP of profile {profile!a}; only those of ROS 2 can be read: {advice}"
    reason = _reason(error)
    return (
        f"cannot be read as a bag: {reason}; if it is cut short or unindexed, `rosbag|ros2 bag "
        "reindex` or `mcap recover` it"
    )


def _profile(head: bytes) -> str:
    """The profile in the header of an MCAP: the kind of its messages, such as ros2."""
    # before the profile stand MCAP_MAGIC, the record's type (a byte) and length (8 bytes), and the
    # length of the profile (4 bytes)
    length_at = len(MCAP_MAGIC) + 1 + 8
    profile_at = length_at + 4
    length = int.from_bytes(head[length_at:profile_at], "little")
    return plain(head[profile_at : profile_at + length].decode("utf-8", "replace"), 40)


def _reason(error: Exception) -> str:
    """The text of an exception, or its type if it has none."""
    text = plain(str(error), 160).rstrip(".")
    return text or f"sizes and contents do not fit ({type(error).__name__})"
