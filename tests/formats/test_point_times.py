"""Tests the times of points, by the fields that several drivers write them to."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.formats.pointcloud2 import times_s

STAMP_NS = 1_700_000_000_000_000_000


def message(name: str, kind: str, times: list[float]) -> Any:
    """A cloud of three points with a field of times; the second point is not finite."""
    fields = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), (name, kind)])
    points = np.zeros(3, fields)
    points["x"] = [1.0, np.nan, 3.0]
    points[name] = np.array(times).astype(kind)
    numbers = {"f4": 7, "f8": 8, "u4": 6}
    return SimpleNamespace(
        height=1,
        width=3,
        fields=[
            SimpleNamespace(name=field, offset=offset, datatype=numbers[dtype.str[1:]], count=1)
            for field, (dtype, offset) in fields.fields.items()  # type: ignore[union-attr]
        ],
        is_bigendian=False,
        point_step=fields.itemsize,
        row_step=3 * fields.itemsize,
        data=points.view(np.uint8),
    )


@pytest.mark.parametrize(
    ("name", "kind", "times", "expected_s"),
    [
        ("t", "<u4", [0, 5e7, 1e8], [0.0, 0.1]),  # Ouster: nanoseconds after the stamp
        ("time", "<f4", [-0.1, -0.05, 0.0], [-0.1, 0.0]),  # Velodyne: seconds before it
        ("timestamp", "<f8", [1.7e9, 1.7e9 + 0.05, 1.7e9 + 0.1], [0.0, 0.1]),  # Hesai: since 1970
        ("timestamp", "<f8", [1.7e18, 1.7e18 + 5e7, 1.7e18 + 1e8], [0.0, 0.1]),  # Livox, in ns
        ("offset_time", "<u4", [0, 5e7, 1e8], [0.0, 0.1]),  # Livox: nanoseconds
        ("time", "<f4", [0.0, 5e4, 1e5], [0.0, 0.1]),  # microseconds, as some converters write
    ],
)
def test_times_are_seconds_after_the_stamp(
    name: str, kind: str, times: list[float], expected_s: list[float]
) -> None:
    found = times_s(message(name, kind, times), STAMP_NS)
    assert found is not None
    np.testing.assert_allclose(found, expected_s, atol=1e-6)


def test_numbers_that_no_turn_of_a_lidar_spans_are_no_times() -> None:
    """Seconds since 1970 in float32 have steps of 128 s, so all are equal."""
    assert times_s(message("timestamp", "<f4", [1.7e9, 1.7e9, 1.7e9]), STAMP_NS) is None
    assert times_s(message("ring", "<f4", [0.0, 0.05, 0.1]), STAMP_NS) is None
