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
    assert (tmp_path / "out" / "07" / "inventory.csv").read_text() == "stamp_ns,points\n100000000,1\n400000000,2\n"
    assert says.startswith(f"2 scans found below {root}")
    assert "1 skipped (truncated record)" in says
    assert "4 of 6 scans are not on disk" in says


def test_nothing_is_written_of_a_log_that_cannot_be_read(tmp_path: Path, kitti: Callable[..., Path]) -> None:
    root = kitti(tmp_path / "data", poses=None)
    with pytest.raises(LogError):
        Recorded(Kitti(), str(root)).record("07", tmp_path / "out", Compute(), Watch())
    assert not (tmp_path / "out").exists()
