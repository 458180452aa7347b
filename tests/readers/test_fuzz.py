"""Damaged files: a reader answers with a log or with one of this project's errors, never with another exception.

Each reader is given 200 of them and more, and a gigabyte to do it in.
"""

import io
import itertools
import resource
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import YearlocError
from pipeline.readers.folder import Folder, read_scan
from pipeline.readers.kitti import Kitti, read_velodyne
from pipeline.readers.log import Log, Reader
from pipeline.readers.nclt import Nclt, read_poses, read_velodyne_sync
from tests.readers.damage import ANY, of_any_file

COUNT = itertools.count()
HITS = (
    np.concatenate([np.full(4, 44_444), [2, 0], np.arange(6), np.arange(8), np.full(4, 44_444), np.zeros(8)])
    .astype("<u2")
    .tobytes()
)
NUMBERS = [
    b"nan",
    b"-inf",
    b"1e308",
    b"-1e308",
    b"1e18",
    b"1000000000000",
    b"-1",
    b"",
    b"#",
    b"0",
    b"1 2",
    b"\xff",
    b"\0",
    b"0x10",
]
LARGE = [b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\xc0\x7f", b"\0\0\x80\xff"]
"""As little-endian words: counts of thousands of millions, and as floats NaN and −inf."""


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """`data` with something wrong: most of what disks, cables, editors and other computers do to a file."""
    kind = draw(st.sampled_from(["cut", "flip", "number", "line", "order", "endian", "huge", "longer", "empty", "noise"]))
    if kind in ANY:
        return of_any_file(draw, data, kind)
    if kind == "number":
        lines = [line.split(b" ") for line in data.split(b"\n")]
        line = draw(st.sampled_from(lines))
        line[draw(st.integers(0, len(line) - 1))] = draw(st.sampled_from(NUMBERS))
        return b"\n".join(b" ".join(words) for words in lines)
    if kind in ("line", "order"):
        rows = data.split(b"\n")
        at = draw(st.integers(0, len(rows) - 1))
        row = rows.pop(at)
        copies, to = (draw(st.sampled_from([0, 2])), at) if kind == "line" else (1, draw(st.integers(0, len(rows))))
        return b"\n".join(rows[:to] + copies * [row] + rows[to:])
    if kind == "endian":
        width = draw(st.sampled_from([2, 4, 8]))
        start = draw(st.integers(0, len(data)))
        return data[:start] + b"".join(data[at : at + width][::-1] for at in range(start, len(data), width))
    if kind == "huge":
        start = draw(st.integers(0, max(0, len(data) - 4)))
        return data[:start] + draw(st.sampled_from(LARGE)) + data[start + 4 :]
    return data + draw(st.sampled_from([data, bytes(1), bytes(16), data[-8:]]))


@pytest.fixture(autouse=True, scope="module")
def one_gigabyte() -> Iterator[None]:
    """More than that on top of what the tests themselves hold is a MemoryError, touched or not."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + 2**30, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


def opened(reader: Reader, root: Path, sequence: str) -> Log | None:
    """Open a log and check what it promises; one of the project's errors is an answer too."""
    try:
        log = reader.open(root, sequence)
        clouds = [log.points(row) for row in range(len(log.stamps_ns))]
    except YearlocError:
        return None
    shape = (len(log.stamps_ns), 4, 4)
    assert (np.diff(log.stamps_ns) > 0).all()
    assert log.world_T_scan.shape == log.odom_T_scan.shape == shape
    assert np.isfinite(log.world_T_scan).all()
    assert all(cloud.shape[1:] == (3,) and np.isfinite(cloud).all() for cloud in clouds)
    assert all(count > 0 for count in log.skipped.values())
    return log


def assert_turned(log: Log | None) -> None:
    """The 3×3 of every pose is a rotation."""
    turned = np.eye(3)[None] if log is None else log.world_T_scan[:, :3, :3]
    np.testing.assert_allclose(turned @ turned.transpose(0, 2, 1), np.zeros_like(turned) + np.eye(3), atol=1e-2)
    assert (np.linalg.det(turned) > 0).all()


@pytest.mark.parametrize("file", ["groundtruth_2012-01-08.csv", "odometry_mu_100hz.csv", "velodyne_sync/1326030975150000.bin"])
@given(data=st.data())
@settings(max_examples=80, deadline=None, derandomize=True)
def test_nclt_survives_a_damaged_file(
    tmp_path_factory: pytest.TempPathFactory, nclt: Callable[..., Path], file: str, data: st.DataObject
) -> None:
    odometry = "".join(f"{1_326_030_975_000_000 + 10_000 * i}, {i}, 0, 0, 0, 0, 0\n" for i in range(20))
    root = nclt(tmp_path_factory.mktemp(f"nclt{next(COUNT)}"), odometry=odometry)
    path = root / "2012-01-08" / file
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    assert_turned(opened(Nclt(), root, "2012-01-08"))


@pytest.mark.parametrize(
    "file", ["poses/07.txt", "sequences/07/calib.txt", "sequences/07/times.txt", "sequences/07/velodyne/000002.bin"]
)
@given(data=st.data())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_kitti_survives_a_damaged_file(
    tmp_path_factory: pytest.TempPathFactory, kitti: Callable[..., Path], file: str, data: st.DataObject
) -> None:
    root = kitti(tmp_path_factory.mktemp(f"kitti{next(COUNT)}"))
    (root / file).write_bytes(data.draw(damaged((root / file).read_bytes())))
    assert_turned(opened(Kitti(), root, "07"))


TUM = "".join(f"1326030975.{i} {i} 0 0 0 0 0 1\n" for i in range(8))
KITTI = "".join(f"1 0 0 {i} 0 1 0 0 0 0 1 0\n" for i in range(8))
TIMES = "".join(f"0.{i}\n" for i in range(8))


@pytest.mark.parametrize(
    ("file", "form"), [("poses.txt", "tum"), ("odometry.txt", "tum"), ("poses.txt", "kitti"), ("times.txt", "kitti")]
)
@given(data=st.data())
@settings(max_examples=60, deadline=None, derandomize=True)
def test_a_robots_own_folder_survives_a_damaged_pose_file(
    tmp_path_factory: pytest.TempPathFactory, folder: Callable[..., Path], file: str, form: str, data: st.DataObject
) -> None:
    poses, names = (TUM, (f"1326030975.{i}5" for i in range(6))) if form == "tum" else (KITTI, map(str, range(6)))
    scans = {f"scans/{name}.bin": np.array([2, 1, 3, 0.5], "<f4").tobytes() for name in names}
    root = folder(tmp_path_factory.mktemp(f"folder{next(COUNT)}"), poses, scans, TIMES)
    (root / "drive" / "odometry.txt").write_text(poses)
    path = root / "drive" / file
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    assert_turned(opened(Folder(poses_format=form, odometry="odometry.txt"), root, "drive"))  # type: ignore[arg-type]


def pcd(data: str, body: bytes) -> bytes:
    head = "VERSION 0.7\nFIELDS x y z ring\nSIZE 4 4 8 2\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\n"
    return f"{head}DATA {data}\n".encode() + body


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


RECORDS = struct.pack("<ffdHffdH", 1, 2, 3, 4, 5, 6, 7, 8)
BLOCK = bytes([31]) + RECORDS[:32] + bytes([0]) + RECORDS[32:33] + bytes([1 << 5, 7])  # 32 literals, 1, and a copy of 3
SCANS = {
    "1.bin": np.arange(12, dtype="<f4").tobytes(),
    "1.npy": npy(np.arange(12.0).reshape(3, 4)),
    "1.pcd": pcd("ascii", b"1 2 3 4\n5 6 nan 8\n"),
    "2.pcd": pcd("binary", RECORDS),
    "3.pcd": pcd("binary_compressed", struct.pack("<II", len(BLOCK), 36) + BLOCK),
}


@pytest.mark.parametrize("name", SCANS)
@given(data=st.data())
@settings(max_examples=200, deadline=None, derandomize=True)
def test_a_scan_of_ones_own_is_read_or_refused(tmp_path_factory: pytest.TempPathFactory, name: str, data: st.DataObject) -> None:
    path = tmp_path_factory.getbasetemp() / name
    path.write_bytes(data.draw(damaged(SCANS[name])))
    try:
        points = read_scan(path, 4, np.eye(4))
    except YearlocError:
        return
    assert points.shape[1:] == (3,)
    assert np.isfinite(points).all()


@pytest.mark.parametrize("name", SCANS)
def test_the_files_that_are_damaged_are_good_ones(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(SCANS[name])
    assert len(read_scan(tmp_path / name, 4, np.eye(4))) in (1, 2, 3)


@pytest.mark.parametrize("read", [read_velodyne_sync, read_velodyne, read_poses])
@given(data=st.data())
@settings(max_examples=200, deadline=None, derandomize=True)
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
