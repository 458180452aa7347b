"""Decodes ROS's clouds, sensor_msgs/PointCloud2, into points and their times (METHODS 7.4).

Fields may have any layout, aligned or not, and either byte order; rows may be padded.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.errors import LogError

DATATYPES = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    8: "f8",
    9: "i8",
    10: "u8",
    11: "u1",
}
"""numpy's types by the numbers of sensor_msgs/PointField.

Only newer ROS distributions have 9 and 10 (64-bit integers) and 11 (a boolean in a byte).
"""
FARTHEST = float(np.finfo(np.float32).max)
"""A larger coordinate, which float32 cannot hold, counts as infinite."""

TIME_FIELDS = ("t", "time", "timestamp", "offset_time", "time_stamp")
"""Names that drivers give to the field with the time of a point."""
TIME_UNITS_S = (1.0, 1e-3, 1e-6, 1e-9)
"""Units that such times may have, in seconds."""
MIN_TURN_S = 0.01
MAX_TURN_S = 0.5
"""A LiDAR turns once, or takes one frame, in a time between these."""
LATEST_OFFSET_S = 3600.0
"""A time farther from 0 than this is no offset from the stamp: it counts from 1970."""


class Field(Protocol):
    """sensor_msgs/PointField."""

    name: str
    offset: int
    datatype: int
    count: int


class PointCloud2(Protocol):
    """The message, as `rosbags` gives it."""

    height: int
    width: int
    fields: Sequence[Field]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: NDArray[np.uint8]


def decode(message: PointCloud2) -> NDArray[np.floating]:
    """Points (n, 3) of a message, row after row, in its frame and unit.

    Points with a NaN or infinite coordinate are dropped. The type is float32 if x, y and z are
    little-endian float32, else float64. Raises LogError, before anything is allocated, for sizes
    that do not fit.
    """
    x, y, z = _columns(message, ("x", "y", "z"))
    if not all(column.dtype == np.dtype(np.float32) for column in (x, y, z)):
        x = _float64(x)
        y = _float64(y)
        z = _float64(z)
    return np.asarray(finite(x, y, z))


def times_s(message: PointCloud2, stamp_ns: int) -> NDArray[np.float64] | None:
    """Seconds (n,) after the stamp of the message at which each point of `decode` was measured.

    None for a message that has none of TIME_FIELDS whose numbers span what a turn of a LiDAR takes.
    Ouster's `t` and Livox' `offset_time` are nanoseconds, Velodyne's `time` is in seconds, Hesai's
    `timestamp` in seconds since 1970 and Livox' in nanoseconds since 1970. The unit is the one that
    makes the span of the numbers a turn.
    """
    names = [field.name for field in message.fields]
    name = next((name for name in TIME_FIELDS if name in names), None)
    if name is None:
        return None
    times, *xyz = _columns(message, (name, "x", "y", "z"))
    is_point = np.ones(len(times), bool)
    for column in xyz:
        with np.errstate(invalid="ignore"):
            is_point &= np.abs(column.astype(np.float64)) <= FARTHEST
    point_times = times[is_point].astype(np.float64)
    if not len(point_times) or not np.isfinite(point_times).all():
        return None
    span = float(np.ptp(point_times))
    for unit_s in TIME_UNITS_S:
        if MIN_TURN_S <= span * unit_s <= MAX_TURN_S:
            seconds = point_times * unit_s
            is_since_1970 = abs(float(seconds[0])) > LATEST_OFFSET_S
            return np.asarray(seconds - stamp_ns / 1e9 if is_since_1970 else seconds)
    return None


def _columns(message: PointCloud2, names: Sequence[str]) -> list[NDArray[Any]]:
    """The numbers (point,) of some fields, as views on the message's bytes where it has one row."""
    layouts = [_layout(message, name) for name in names]
    shape = (_rows(message), message.width)
    strides = (_row_bytes(message), message.point_step)
    return [
        np.ndarray(shape, dtype, buffer=message.data, offset=offset, strides=strides).reshape(-1)
        for dtype, offset in layouts
    ]


def _layout(message: PointCloud2, name: str) -> tuple[np.dtype[np.generic], int]:
    """Data type of a field, and its offset in bytes in a point."""
    field = next((field for field in message.fields if field.name == name), None)
    if field is None:
        names = ", ".join(ascii(field.name) for field in message.fields) or "none"
        raise LogError(f"PointCloud2 without a field {name}: its fields are {names:.200}")
    if field.datatype not in DATATYPES:
        raise LogError(
            f"PointCloud2's field {name} has the datatype {field.datatype}; sensor_msgs/PointField "
            "knows 1 to 11"
        )
    byte_order = ">" if message.is_bigendian else "<"
    return np.dtype(byte_order + DATATYPES[field.datatype]), field.offset


def _rows(message: PointCloud2) -> int:
    """Number of rows of points; some drivers write the height of an unorganised cloud as 0."""
    nbytes = len(message.data)
    is_one_row = nbytes > 0 and nbytes == message.width * message.point_step
    return 1 if message.height == 0 and is_one_row else message.height


def _row_bytes(message: PointCloud2) -> int:
    """Bytes from one row to the next; raises LogError for sizes that do not fit."""
    # Some drivers write the size of the whole cloud as row_step, or 0: it is ignored if the points
    # fill the data without padding.
    height = _rows(message)
    width = message.width
    point_bytes = message.point_step
    row_bytes = message.row_step
    if height <= 0 or width <= 0:
        raise LogError(f"PointCloud2 of {height} × {width} points: an empty message")
    for field in message.fields:
        number_bytes = np.dtype(DATATYPES.get(field.datatype, "u1")).itemsize
        field_end = field.offset + number_bytes * max(field.count, 1)
        if field.offset < 0 or field_end > point_bytes:
            raise LogError(
                f"PointCloud2's field {field.name!a:.40} ends at byte {field_end} of points of "
                f"{point_bytes} bytes"
            )
    packed_bytes = width * point_bytes
    nbytes = len(message.data)
    if height == 1 and nbytes >= packed_bytes:
        return packed_bytes
    needed_bytes = (height - 1) * row_bytes + packed_bytes  # the last row may lack its padding
    if row_bytes >= packed_bytes and nbytes >= needed_bytes:
        return row_bytes
    if nbytes == height * packed_bytes:
        return packed_bytes
    if row_bytes < packed_bytes:
        raise LogError(
            f"PointCloud2 with rows of {row_bytes} bytes for {width} points of {point_bytes}; the "
            "message is damaged"
        )
    raise LogError(
        f"PointCloud2 of {height} × {width} points needs {needed_bytes} bytes, has {nbytes}; it is "
        "cut short"
    )


def _float64(column: NDArray[np.generic]) -> NDArray[np.float64]:
    """Numbers of any type as float64, NaN where float32 could not hold them."""
    with np.errstate(invalid="ignore"):
        numbers = column.astype(np.float64)
        numbers[~(np.abs(numbers) <= FARTHEST)] = np.nan
    return numbers


@njit(cache=True, nogil=True, error_model="numpy")
def finite(
    x: NDArray[np.floating], y: NDArray[np.floating], z: NDArray[np.floating]
) -> NDArray[np.floating]:
    """Points (k, 3) from columns (n,), only those whose three coordinates are finite.

    It is as fast as a copy, whatever the columns' stride and alignment.
    """
    points = np.empty((x.shape[0], 3), x.dtype)
    count = 0
    for i in range(x.shape[0]):
        points[count, 0] = x[i]
        points[count, 1] = y[i]
        points[count, 2] = z[i]
        # a point that is not finite is written over by the next one
        count += np.isfinite(x[i]) & np.isfinite(y[i]) & np.isfinite(z[i])
    return points[:count]
