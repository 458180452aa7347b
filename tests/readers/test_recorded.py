"""Tests how the logs of a recorded data set are checked and listed."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.compute import Compute
from pipeline.core.errors import LogError
from pipeline.core.progress import Progress
from pipeline.formats.changes import Change
from pipeline.readers.kitti import Kitti
from pipeline.readers.log import Log
from pipeline.readers.recorded import Recorded
from tests.readers.logs import kitti_log


def test_what_is_on_disk_is_listed(tmp_path: Path) -> None:
    # Scan 1 holds one point, scan 4 two; scan 2 is cut short.
    point = np.zeros(4, "<f4").tobytes()
    scans = {"000001": point, "000004": 2 * point, "000002": point[:-1]}
    root = kitti_log(tmp_path / "data", scans=scans)
    says = Recorded(Kitti(), str(root)).record("07", tmp_path / "out" / "07", Compute(), Progress())
    header, one, other = (tmp_path / "out" / "07" / "inventory.csv").read_text().splitlines()
    assert header == "stamp_ns,points,digest"
    assert (one[:12], other[:12]) == ("100000000,1,", "400000000,2,")
    assert says.startswith(f"2 scans found below {root}")
    assert "1 skipped (truncated record)" in says
    assert "4 of 6 scans are not on disk" in says


def test_the_inventory_changes_with_a_pose_or_a_point(tmp_path: Path) -> None:
    point = np.zeros(4, "<f4").tobytes()
    poses_text = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {2 * i}\n" for i in range(6))
    texts = set()
    logs = (
        ("a", poses_text, point),
        ("b", poses_text.replace("1 10", "1 11"), point),
        ("c", poses_text, point[::-1] + point),
    )
    for name, poses, scan in logs:
        scans = {"000001": point, "000005": scan}
        root = kitti_log(tmp_path / name / "data", poses=poses, scans=scans)
        Recorded(Kitti(), str(root)).record("07", tmp_path / name / "out", Compute(), Progress())
        texts.add((tmp_path / name / "out" / "inventory.csv").read_text())
    assert len(texts) == 3


def test_nothing_is_written_for_a_log_that_cannot_be_read(tmp_path: Path) -> None:
    root = kitti_log(tmp_path / "data", poses=None)
    with pytest.raises(LogError):
        Recorded(Kitti(), str(root)).record("07", tmp_path / "out", Compute(), Progress())
    assert not (tmp_path / "out").exists()


class Days:
    """Logs whose names are the day on which they were recorded."""

    def open(self, root: Path, sequence: str) -> Log:
        stamps_ns = np.array([(86_400 * int(sequence) + 50_000) * 10**9])
        return Log(stamps_ns, np.eye(4)[None], np.eye(4)[None], lambda row: np.zeros((1, 3)), {})


def test_a_change_is_visible_from_its_day_on(tmp_path: Path) -> None:
    noted = tmp_path / "noted.csv"
    noted.write_text(
        "x_m, y_m, what, day, "
        "from_day\n1.5,-2,demolition,40,40\n3,4,scaffold,90,8\n0,0,fence,-3,-3\n"
    )
    site = Recorded(Days(), str(tmp_path), str(noted))
    scaffold = Change("scaffold", 8, 90, 3.0, 4.0)
    demolition = Change("demolition", 40, 40, 1.5, -2.0)
    # Day 107 is 7 days after day 100; what was there before training is no change.
    assert [site.changes("100", sequence) for sequence in ("107", "108", "140")] == [
        [],
        [scaffold],
        [scaffold, demolition],
    ]
    assert Recorded(Days(), str(tmp_path)).changes("100", "140") == []
