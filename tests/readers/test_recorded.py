"""Logs that exist already: checked and listed."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pipeline.compute import Compute
from pipeline.errors import LogError
from pipeline.readers.kitti import Kitti
from pipeline.readers.recorded import Recorded
from pipeline.watch import Watch


def test_what_is_on_disk_is_listed(tmp_path: Path, kitti: Callable[..., Path]) -> None:
    # Scan 1 holds one point, scan 4 two; scan 2 is cut short.
    point = np.zeros(4, "<f4").tobytes()
    root = kitti(tmp_path / "data", scans={"000001": point, "000004": 2 * point, "000002": point[:-1]})
    says = Recorded(Kitti(), str(root)).record("07", tmp_path / "out" / "07", Compute(), Watch())
    header, one, other = (tmp_path / "out" / "07" / "inventory.csv").read_text().splitlines()
    assert (header, one[:12], other[:12]) == ("stamp_ns,points,digest", "100000000,1,", "400000000,2,")
    assert says.startswith(f"2 scans found below {root}")
    assert "1 skipped (truncated record)" in says
    assert "4 of 6 scans are not on disk" in says


def test_another_pose_or_point_makes_another_inventory(tmp_path: Path, kitti: Callable[..., Path]) -> None:
    point = np.zeros(4, "<f4").tobytes()
    usual = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {2 * i}\n" for i in range(6))
    texts = set()
    for name, poses, scan in (
        ("a", usual, point),
        ("b", usual.replace("1 10", "1 11"), point),
        ("c", usual, point[::-1] + point),
    ):
        root = kitti(tmp_path / name / "data", poses=poses, scans={"000001": point, "000005": scan})
        Recorded(Kitti(), str(root)).record("07", tmp_path / name / "out", Compute(), Watch())
        texts.add((tmp_path / name / "out" / "inventory.csv").read_text())
    assert len(texts) == 3


def test_nothing_is_written_of_a_log_that_cannot_be_read(tmp_path: Path, kitti: Callable[..., Path]) -> None:
    root = kitti(tmp_path / "data", poses=None)
    with pytest.raises(LogError):
        Recorded(Kitti(), str(root)).record("07", tmp_path / "out", Compute(), Watch())
    assert not (tmp_path / "out").exists()
