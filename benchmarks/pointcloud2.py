"""Races to decode a PointCloud2 of 120,000 points of 32 bytes: yearloc, numpy, struct, a copy."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from benchmarks.race import Race, race
from pipeline.formats.pointcloud2 import Field, decode

POINTS = 120_000
STEP = 32


@dataclass
class Message:
    """sensor_msgs/PointCloud2 as a driver sends it: x, y, z, intensity as float32, ring, time."""

    data: NDArray[np.uint8]
    fields: Sequence[Field]
    height: int = 1
    width: int = POINTS
    is_bigendian: bool = False
    point_step: int = STEP
    row_step: int = POINTS * STEP


def messages(number: int = 16, unaligned: int = 0) -> list[Message]:
    """More messages than a core's own cache holds; one point in a hundred is NaN."""
    rng = np.random.default_rng(0)
    fields: list[Field] = [
        SimpleNamespace(name=name, offset=4 * i, datatype=7, count=1)
        for i, name in enumerate("xyzi")
    ]
    made = []
    for _ in range(number):
        points = rng.normal(0, 30, (POINTS, STEP // 4)).astype("<f4")
        points[rng.integers(0, POINTS, POINTS // 100), 0] = np.nan
        data = np.frombuffer(bytes(unaligned) + points.tobytes(), np.uint8)[unaligned:]
        made.append(Message(data, fields))
    return made


def structured(message: Message) -> NDArray[np.float32]:
    """Finite points by numpy's structured view, with its columns stacked."""
    view = message.data.view(
        {"names": ["x", "y", "z"], "formats": ["<f4"] * 3, "offsets": [0, 4, 8], "itemsize": STEP}
    )
    points: NDArray[np.float32] = np.stack([view["x"], view["y"], view["z"]], axis=1)
    return points[np.isfinite(points).all(axis=1)]


def read_points(message: Message) -> list[tuple[float, ...]]:
    """Points one by one, as in ROS 1's sensor_msgs.point_cloud2, without its NaN test."""
    return list(struct.iter_unpack(f"<3f{STEP - 12}x", message.data.tobytes()))


def run() -> list[Race]:
    """Races from the deserialised message to finite points (n, 3) in float32."""
    clouds = messages()
    shifted = messages(unaligned=1)
    if any(not np.array_equal(decode(cloud), structured(cloud)) for cloud in clouds):
        raise AssertionError("the points differ from numpy's")
    copy = np.empty_like(clouds[0].data)
    aligned = race(
        f"PointCloud2 of {POINTS:,} points × {STEP} B, to finite float32 points",
        {
            "yearloc": lambda i: decode(clouds[i % 16]),
            "yearloc, data at an odd address": lambda i: decode(shifted[i % 16]),
            "numpy structured view": lambda i: structured(clouds[i % 16]),
            "memcpy of the message's data": lambda i: np.copyto(copy, clouds[i % 16].data),
        },
    )
    slow = race(
        "the same point by point",
        {
            "yearloc": lambda i: decode(clouds[i % 16]),
            "struct.iter_unpack": lambda i: read_points(clouds[i % 16]),
        },
        rounds=8,
    )
    return [aligned, slow]


def main() -> None:
    """Print the races."""
    for result in run():
        print(result.table(), end="\n\n")


if __name__ == "__main__":
    main()
