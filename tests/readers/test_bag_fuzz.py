"""Damaged bags: the reader answers with a log that keeps its promises or with one line, and never with a gigabyte."""

import itertools
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.interfaces import Connection

from pipeline.errors import LogError, YearlocError
from pipeline.formats.bag import BagWriter
from pipeline.readers.bag import Bag
from tests.readers.bags import KINDS, START_NS, STEP_NS, at, bag_path, drive, fill
from tests.readers.damage import ANY, of_any_file

COUNT = itertools.count()
READER = Bag(truth="/truth", odometry="/odom")
HUGE = [b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\0\0", b"\0\0\xc0\x7f", b"\xff" * 8, b"\0" * 7 + b"\x40"]


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """`data` cut short, with bits flipped, a number replaced, a stretch lost, repeated or turned round, or none of it."""
    kind = draw(st.sampled_from(["cut", "flip", "flip", "number", "number", "stretch", "empty", "noise"]))
    if kind in ANY:
        return of_any_file(draw, data, kind)
    start = draw(st.integers(0, len(data) - 1))
    part = data[start : start + draw(st.integers(1, 64))]
    new = draw(st.sampled_from(HUGE if kind == "number" else [b"", part + part, part[::-1]]))
    return data[:start] + new + data[start + len(new if kind == "number" else part) :]


def opened(reader: Bag, root: Path) -> None:
    """Open a bag and check what a log promises; one of the project's errors, one line long, is an answer too."""
    try:
        log = reader.open(root, "drive")
    except YearlocError as error:
        refused(error, root)
        return
    assert (np.diff(log.stamps_ns) > 0).all()
    assert log.world_T_scan.shape == log.odom_T_scan.shape == (len(log.stamps_ns), 4, 4)
    assert np.isfinite(log.world_T_scan).all()
    driven = log.odom_T_scan[np.isfinite(log.odom_T_scan).all(axis=(1, 2))]
    for poses in (log.world_T_scan[:, :3, :3], driven[:, :3, :3]):
        np.testing.assert_allclose(poses @ poses.swapaxes(1, 2), np.broadcast_to(np.eye(3), poses.shape), atol=1e-9)
    for row in range(len(log.stamps_ns)):
        try:
            points = log.points(row)
        except LogError as error:
            refused(error, root)
            continue
        assert points.shape[1:] == (3,)
        assert np.isfinite(points).all()


def refused(error: YearlocError, root: Path) -> None:
    assert "\n" not in str(error)
    assert str(root) in str(error)


def files(path: Path) -> list[Path]:
    return [path] if path.is_file() else sorted(path.iterdir())


@pytest.fixture(scope="module", params=KINDS)
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drive(bag_path(tmp_path_factory.mktemp("whole"), request.param), request.param)


@given(data=st.data())
@settings(max_examples=200, deadline=None, derandomize=True)
def test_a_damaged_bag_is_a_log_or_a_line(tmp_path_factory: pytest.TempPathFactory, whole: Path, data: st.DataObject) -> None:
    root = tmp_path_factory.getbasetemp() / f"bag{next(COUNT)}"
    root.mkdir()
    copy = root / whole.name
    shutil.copytree(whole, copy) if whole.is_dir() else shutil.copy(whole, copy)
    file = data.draw(st.sampled_from(files(copy)))
    file.write_bytes(data.draw(damaged(file.read_bytes())))
    opened(READER, root)
    shutil.rmtree(root)


@pytest.mark.parametrize("kind", KINDS)
def test_sizes_of_gigabytes_take_no_memory(tmp_path: Path, kind: str) -> None:
    """A huge number at a hundred places of a bag, read in a process of its own, whose largest memory is looked at."""
    drive(bag_path(tmp_path, kind), kind, clouds=1)
    code = f"""
import resource
from pathlib import Path
from tests.readers.test_bag_fuzz import READER, files, opened
root = Path({str(tmp_path)!r})
file = next(path for path in files(root / {bag_path(tmp_path, kind).name!r}) if path.suffix != ".yaml")
whole = file.read_bytes()
for at in range(0, len(whole), max(len(whole) // 100, 1)):
    file.write_bytes(whole[:at] + b"\\xff\\xff\\xff\\x7e" + whole[at + 4 :])
    opened(READER, root)
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2])
    assert int(out.stdout) < 1024**2  # KiB, of which the libraries take some 200 MiB; getrusage would count the parent's too


@given(kind=st.sampled_from(["ros1", "mcap"]), data=st.data())
@settings(max_examples=200, deadline=None, derandomize=True)
def test_a_damaged_message_in_a_whole_bag_is_a_log_or_a_line(
    tmp_path_factory: pytest.TempPathFactory, kind: str, data: st.DataObject
) -> None:
    """Cut, flipped, of the wrong byte order or of huge counts: the bag is sound, one of its messages is not."""
    root = tmp_path_factory.getbasetemp() / f"message{next(COUNT)}"
    with BagWriter(bag_path(root, kind), kind) as bag:
        put, hit = bag._writer.write, data.draw(st.integers(0, 10))
        number = itertools.count()

        def write(connection: Connection, stamp_ns: int, message: bytes) -> None:
            whole = bytes(message)
            wrong = data.draw(damaged(whole)) if next(number) == hit else whole
            turned = (
                bytes([0, wrong[1] ^ 1]) + wrong[2:] if wrong != whole and len(wrong) > 2 and data.draw(st.booleans()) else wrong
            )
            put(connection, stamp_ns, turned)

        bag._writer.write = write  # type: ignore[method-assign]
        fill(bag, clouds=3)
    opened(READER, root)
    shutil.rmtree(root)


@given(
    st.lists(st.tuples(st.integers(0, 12), st.sampled_from([0.0, 1.0, np.nan, np.inf])), min_size=1, max_size=8),
    st.lists(st.tuples(st.integers(0, 12), st.sampled_from([0.0, 1.0, np.nan, 1e300])), min_size=1, max_size=12),
)
@settings(max_examples=200, deadline=None, derandomize=True)
def test_stamps_in_any_order_give_the_first_cloud_of_each_between_poses(
    tmp_path_factory: pytest.TempPathFactory, clouds: list[tuple[int, float]], poses: list[tuple[int, float]]
) -> None:
    root = tmp_path_factory.getbasetemp() / f"stamps{next(COUNT)}"
    with BagWriter(root / "drive.bag", "ros1") as bag:
        for step, x in poses:
            bag.odometry(START_NS + step * STEP_NS, "map", "lidar", at(x), "/truth")
        for i, (step, x) in enumerate(clouds):
            bag.points(START_NS + step * STEP_NS, "lidar", np.array([[i, 0, 0], [x, 0, 0]], np.float32), np.ones(2), np.ones(2))
    reader = Bag(truth="/truth", max_gap_s=10)
    opened(reader, root)
    first = {step: i for i, (step, _) in reversed(list(enumerate(clouds)))}
    try:
        log = reader.open(root, "drive")
    except LogError as error:
        refused(error, root)
    else:
        steps = ((log.stamps_ns - START_NS) // STEP_NS).tolist()
        assert [log.points(row)[0, 0] for row in range(len(steps))] == [first[step] for step in steps]
        assert len(steps) + log.skipped.total() == len(clouds)
    shutil.rmtree(root)
