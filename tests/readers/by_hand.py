"""Writes bags byte by byte from the descriptions of their formats, without the library that reads
them.

Each bag holds two clouds, at 10.5 s and 11 s with the points (1, 2, 3) and (4, 5, 6), and two
poses, at 10 s and 12 s, 10 m apart on x and turned to the left. `/cloud` is a PointCloud2 in the
frame `lidar`, `/pose` a PoseStamped in `map`. In ROS 2 messages are CDR, in either byte order.
"""

import sqlite3
import struct
from pathlib import Path

CLOUD_MD5 = b"1158d486dd51d683ce2f1be655c3c181"
POSE_MD5 = b"d3812c3cbc69362b77dc0b19b345f8f5"
HALF = 0.5**0.5
CLOUDS = {10_500_000_000: (1.0, 2.0, 3.0), 11_000_000_000: (4.0, 5.0, 6.0)}
"""The one point of each cloud, by its stamp in ns."""
POSES = {
    10_000_000_000: (0.0, 0.0, 0.0, 0.0, 0.0, HALF, HALF),
    12_000_000_000: (10.0, 0.0, 0.0, 0.0, 0.0, HALF, HALF),
}
"""Position and quaternion of each pose, by its stamp in ns."""
FIELDS = (("x", 0), ("y", 4), ("z", 8))
"""The fields of a point with their offsets."""
FLOAT32 = 7
"""The number of that type in sensor_msgs/PointField."""


TABLES = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
CREATE TABLE messages(
    id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
INSERT INTO topics VALUES (1, '/cloud', 'sensor_msgs/msg/PointCloud2', 'cdr');
INSERT INTO topics VALUES (2, '/pose', 'geometry_msgs/msg/PoseStamped', 'cdr');
"""
"""The tables of rosbag2's first version."""


class Cdr:
    """A message in ROS 2's Common Data Representation.

    Four bytes of encapsulation come first; after them each number lies at a multiple of its size.
    """

    def __init__(self, big: bool) -> None:
        """Begin a message, big-endian with `big`."""
        self.order = ">" if big else "<"
        self.data = b"\0\0\0\0" if big else b"\0\1\0\0"

    def add(self, code: str, *numbers: float) -> None:
        """Add numbers of a type by its letter in `struct`, each with the padding before it."""
        size = struct.calcsize(code)
        for number in numbers:
            self.data += bytes(-(len(self.data) - 4) % size)
            self.data += struct.pack(self.order + code, number)

    def text(self, text: str) -> None:
        """Add a text: its length with the final zero, then its letters."""
        self.add("I", len(text) + 1)
        self.data += text.encode() + b"\0"

    def header(self, stamp_ns: int, frame: str) -> None:
        """Add a std_msgs/Header."""
        self.add("i", stamp_ns // 10**9)
        self.add("I", stamp_ns % 10**9)
        self.text(frame)


def cdr_cloud(stamp_ns: int, point: tuple[float, ...], big: bool = False) -> bytes:
    """A PointCloud2 of one point for ROS 2."""
    cdr = Cdr(big)
    cdr.header(stamp_ns, "lidar")
    cdr.add("I", 1, 1, 3)  # height, width, number of fields
    for name, offset in FIELDS:
        cdr.text(name)
        cdr.add("I", offset)
        cdr.add("B", FLOAT32)
        cdr.add("I", 1)  # count
    cdr.add("B", big)
    cdr.add("I", 12, 12, 12)  # point_step, row_step, length of the data
    cdr.data += struct.pack(cdr.order + "3f", *point)
    cdr.add("B", 1)  # is_dense
    return cdr.data


def cdr_pose(stamp_ns: int, numbers: tuple[float, ...], big: bool = False) -> bytes:
    """A PoseStamped for ROS 2."""
    cdr = Cdr(big)
    cdr.header(stamp_ns, "map")
    cdr.add("d", *numbers)
    return cdr.data


def text(text: str) -> bytes:
    """A text as ROS 1 and MCAP write it: its length, then its letters."""
    return struct.pack("<I", len(text)) + text.encode()


def ros1_header(stamp_ns: int, frame: str) -> bytes:
    """A std_msgs/Header of ROS 1, whose counter is 7."""
    return struct.pack("<3I", 7, stamp_ns // 10**9, stamp_ns % 10**9) + text(frame)


def ros1_cloud(stamp_ns: int, point: tuple[float, ...]) -> bytes:
    """A PointCloud2 of one point for ROS 1."""
    data = ros1_header(stamp_ns, "/lidar")
    data += struct.pack("<3I", 1, 1, 3)  # height, width, number of fields
    for name, offset in FIELDS:
        data += text(name) + struct.pack("<IBI", offset, FLOAT32, 1)
    data += struct.pack("<BIII", 0, 12, 12, 12)  # byte order, point_step, row_step, length
    return data + struct.pack("<3fB", *point, 1)  # the point, is_dense


def ros1_pose(stamp_ns: int, numbers: tuple[float, ...]) -> bytes:
    """A PoseStamped for ROS 1."""
    return ros1_header(stamp_ns, "map") + struct.pack("<7d", *numbers)


def u32(*numbers: int) -> bytes:
    """Numbers as unsigned 32-bit integers."""
    return struct.pack(f"<{len(numbers)}I", *numbers)


def joined(fields: dict[str, bytes]) -> bytes:
    """The fields of a ROS 1 record: NAME=VALUE, each with its length before it."""
    return b"".join(
        u32(len(name) + 1 + len(value)) + name.encode() + b"=" + value
        for name, value in fields.items()
    )


def record(data: bytes, **fields: bytes) -> bytes:
    """A record of a ROS 1 bag: its fields, then its data, each with its length before it."""
    head = joined(fields)
    return u32(len(head)) + head + u32(len(data)) + data


def ros1(path: Path) -> Path:
    """Write a ROS 1 bag as https://wiki.ros.org/Bags/Format/2.0 describes it.

    It has a header, one chunk with all messages, the index of the chunk, the connections (one a
    topic), and the chunk's info.
    """
    kinds = (
        (b"/cloud", b"sensor_msgs/PointCloud2", CLOUD_MD5),
        (b"/pose", b"geometry_msgs/PoseStamped", POSE_MD5),
    )
    connections = b""
    for number, (topic, kind, md5) in enumerate(kinds):
        fields = {"topic": topic, "type": kind, "md5sum": md5, "message_definition": b"by hand"}
        connections += record(joined(fields), op=b"\7", conn=u32(number), topic=topic)
    sent = [(stamp, 0, ros1_cloud(stamp, point)) for stamp, point in CLOUDS.items()]
    sent += [(stamp, 1, ros1_pose(stamp, numbers)) for stamp, numbers in POSES.items()]
    chunk = connections
    index = {0: b"", 1: b""}  # of each connection: the time and the place of its messages
    for stamp, number, data in sorted(sent):
        time = u32(stamp // 10**9, stamp % 10**9)
        index[number] += time + u32(len(chunk))
        chunk += record(data, op=b"\2", conn=u32(number), time=time)

    def opening(index_pos: int) -> bytes:
        """The magic and the bag's header, padded to 4096 bytes, which says where the index is."""
        fields = {
            "op": b"\3",
            "index_pos": struct.pack("<Q", index_pos),
            "conn_count": u32(2),
            "chunk_count": u32(1),
        }
        padding = bytes(4096 - len(record(b"", **fields)))
        return b"#ROSBAG V2.0\n" + record(padding, **fields)

    body = record(chunk, op=b"\5", compression=b"none", size=u32(len(chunk)))
    body += b"".join(
        record(entry, op=b"\4", ver=u32(1), conn=u32(n), count=u32(len(entry) // 12))
        for n, entry in index.items()
    )
    start = min(sent)[0]
    end = max(sent)[0]
    info = record(
        u32(0, 2, 1, 2),
        op=b"\6",
        ver=u32(1),
        chunk_pos=struct.pack("<Q", len(opening(0))),
        start_time=u32(start // 10**9, start % 10**9),
        end_time=u32(end // 10**9, end % 10**9),
        count=u32(2),
    )
    path.write_bytes(opening(len(opening(0)) + len(body)) + body + connections + info)
    return path


def mcap(path: Path, big: bool = False) -> Path:
    """Write an MCAP as https://mcap.dev/spec describes it.

    It has the magic, a header, schemas, channels and messages, a footer and the magic again, but no
    chunks and no index.
    """

    def part(op: int, data: bytes) -> bytes:
        """A record: its code and length, then its data."""
        return struct.pack("<BQ", op, len(data)) + data

    magic = b"\x89MCAP0\r\n"
    data = part(1, text("ros2") + text("by hand"))
    topics = (
        (1, "/cloud", "sensor_msgs/msg/PointCloud2"),
        (2, "/pose", "geometry_msgs/msg/PoseStamped"),
    )
    for number, topic, kind in topics:
        data += part(3, struct.pack("<H", number) + text(kind) + text("ros2msg") + text("by hand"))
        data += part(4, struct.pack("<HH", number, number) + text(topic) + text("cdr") + u32(0))
    for stamp, number, message in messages(big):
        data += part(5, struct.pack("<HIQQ", number, 0, stamp, stamp) + message)
    path.write_bytes(magic + data + part(2, struct.pack("<QQI", 0, 0, 0)) + magic)
    return path


def db3(path: Path, big: bool = False) -> Path:
    """Write rosbag2's sqlite3 tables of its first version, without metadata.yaml or definitions."""
    with sqlite3.connect(path) as database:
        database.executescript(TABLES)
        database.executemany(
            "INSERT INTO messages(timestamp, topic_id, data) VALUES (?, ?, ?)", messages(big)
        )
    database.close()
    return path


def messages(big: bool) -> list[tuple[int, int, bytes]]:
    """Stamp, number of the topic (1 for /cloud, 2 for /pose) and CDR of each message, by stamp."""
    clouds = [(stamp, 1, cdr_cloud(stamp, point, big)) for stamp, point in CLOUDS.items()]
    poses = [(stamp, 2, cdr_pose(stamp, numbers, big)) for stamp, numbers in POSES.items()]
    return sorted(clouds + poses)
