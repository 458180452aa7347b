"""What `yearloc inspect` says of a .pcd."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import LogError
from pipeline.inspection.pcd import cloud_file

HEAD = (
    "VERSION 0.7\nFIELDS x y z normal\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 3\nWIDTH {n}\nHEIGHT 1\nPOINTS {n}\nDATA binary\n"
)


def test_fields_points_and_those_that_are_none_are_told(tmp_path: Path) -> None:
    rows = np.zeros((2000, 6), "<f4")
    rows[:, :2] = np.random.default_rng(0).uniform(-20, 20, (2000, 2))
    rows[5, 2] = np.nan
    path = tmp_path / "cloud.pcd"
    path.write_bytes(HEAD.format(n=2000).encode() + rows.tobytes())
    text = cloud_file(path).text()
    assert "cloud.pcd — PCD cloud" in text
    assert "x f4, y f4, z f4, normal×3 f4" in text
    assert "1,999, and 1 that are not finite" in text
    assert "DATA binary" in text


def test_a_cloud_of_nothing_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cloud.pcd"
    path.write_bytes(HEAD.format(n=1).encode() + np.full(6, np.nan, "<f4").tobytes())
    with pytest.raises(LogError, match="none of its 1 points has finite x, y and z"):
        cloud_file(path)
