"""Damaged files: a reader answers with a log or with one of this project's errors, never with another exception."""

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import YearlocError
from pipeline.readers.kitti import Kitti, read_velodyne
from pipeline.readers.nclt import Nclt, read_poses, read_velodyne_hits, read_velodyne_sync

COUNT = itertools.count()
HITS = (
    np.concatenate([np.full(4, 44_444), [2, 0], np.arange(6), np.arange(8), np.full(4, 44_444), np.zeros(8)])
    .astype("<u2")
    .tobytes()
)
NUMBERS = [b"nan", b"-inf", b"1e308", b"-1e308", b"1e18", b"", b"#", b"0", b"1 2", b"\xff", b"\0", b"0x10"]


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """`data` cut short, with bits flipped, a number replaced, a line lost or repeated, or nothing left of it."""
    kind = draw(st.sampled_from(["cut", "flip", "number", "line", "empty", "noise"]))
    if kind == "cut":
        return data[: draw(st.integers(0, len(data)))]
    if kind == "flip":
        found = bytearray(data)
        for bit in draw(st.lists(st.integers(0, 8 * len(data) - 1), min_size=1, max_size=4)):
            found[bit // 8] ^= 1 << bit % 8
        return bytes(found)
    if kind == "number":
        lines = [line.split(b" ") for line in data.split(b"\n")]
        line = draw(st.sampled_from(lines))
        line[draw(st.integers(0, len(line) - 1))] = draw(st.sampled_from(NUMBERS))
        return b"\n".join(b" ".join(words) for words in lines)
    if kind == "line":
        rows = data.split(b"\n")
        at = draw(st.integers(0, len(rows) - 1))
        return b"\n".join(rows[:at] + rows[at : at + 1] * draw(st.sampled_from([0, 2])) + rows[at + 1 :])
    return b"" if kind == "empty" else draw(st.binary(max_size=64))


def opened(reader: Nclt | Kitti, root: Path, sequence: str) -> None:
    """Open a log and check what it promises; one of the project's errors is an answer too."""
    try:
        log = reader.open(root, sequence)
        clouds = [log.points(row) for row in range(len(log.stamps_ns))]
    except YearlocError:
        return
    assert (np.diff(log.stamps_ns) > 0).all()
    assert np.isfinite(log.world_T_scan).all()
    assert log.world_T_scan.shape == (len(log.stamps_ns), 4, 4)
    assert all(cloud.shape[1:] == (3,) and np.isfinite(cloud).all() for cloud in clouds)


@pytest.mark.parametrize("file", ["groundtruth_2012-01-08.csv", "odometry_mu_100hz.csv", "velodyne_sync/1326030975150000.bin"])
@given(data=st.data())
@settings(max_examples=40, deadline=None, derandomize=True)
def test_nclt_survives_a_damaged_file(
    tmp_path_factory: pytest.TempPathFactory, nclt: Callable[..., Path], file: str, data: st.DataObject
) -> None:
    odometry = "".join(f"{1_326_030_975_000_000 + 10_000 * i}, {i}, 0, 0, 0, 0, 0\n" for i in range(20))
    root = nclt(tmp_path_factory.mktemp(f"nclt{next(COUNT)}"), odometry=odometry)
    path = root / "2012-01-08" / file
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    opened(Nclt(), root, "2012-01-08")


@pytest.mark.parametrize(
    "file", ["poses/07.txt", "sequences/07/calib.txt", "sequences/07/times.txt", "sequences/07/velodyne/000002.bin"]
)
@given(data=st.data())
@settings(max_examples=40, deadline=None, derandomize=True)
def test_kitti_survives_a_damaged_file(
    tmp_path_factory: pytest.TempPathFactory, kitti: Callable[..., Path], file: str, data: st.DataObject
) -> None:
    root = kitti(tmp_path_factory.mktemp(f"kitti{next(COUNT)}"))
    (root / file).write_bytes(data.draw(damaged((root / file).read_bytes())))
    opened(Kitti(), root, "07")


@pytest.mark.parametrize("read", [read_velodyne_sync, read_velodyne_hits, read_velodyne, read_poses])
@given(data=st.data())
@settings(max_examples=40, deadline=None, derandomize=True)
def test_a_file_of_hits_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, read: Callable[[Path], object], data: st.DataObject
) -> None:
    path = tmp_path_factory.getbasetemp() / f"hits{next(COUNT)}.bin"
    path.write_bytes(data.draw(damaged(HITS)))
    try:
        found = read(path)
    except YearlocError:
        return
    if isinstance(found, np.ndarray):
        assert found.shape[1] == 3


@pytest.mark.parametrize(
    "folder", ["2012-01-08/velodyne_sync/1326030975350000.bin", "2012-01-08/velodyne_sync/1326030975150000.bin"]
)
def test_a_folder_named_like_a_scan_is_skipped_or_refused(tmp_path: Path, nclt: Callable[..., Path], folder: str) -> None:
    root = nclt(tmp_path)
    (root / folder).unlink(missing_ok=True)
    (root / folder).mkdir()
    opened(Nclt(), root, "2012-01-08")
