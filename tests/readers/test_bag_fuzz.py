"""Tests the bag reader on damaged bags.

It returns a log that is as the class Log says, or raises an error of one line, and never takes a
gigabyte of memory.
"""

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

from pipeline.core.errors import LogError
from pipeline.formats.bag import BagWriter
from pipeline.readers.bag import Bag
from tests.readers.bags import KINDS, START_NS, STEP_NS, at, bag_path, cloud, drive, fill
from tests.readers.damage import assert_line, damaged, opened

COUNT = itertools.count()
READER = Bag(ground_truth="/ground_truth", odometry="/odom")


def check(reader: Bag, root: Path) -> None:
    """Open the sequence `drive`: it is refused, or each scan has a true pose."""
    log = opened(reader, root, "drive")
    assert log is None or np.isfinite(log.world_T_scan).all()


def files(path: Path) -> list[Path]:
    """The files of a bag."""
    return [path] if path.is_file() else sorted(path.iterdir())


@pytest.fixture(scope="module", params=KINDS)
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An undamaged bag."""
    return drive(bag_path(tmp_path_factory.mktemp("whole"), request.param), request.param)


@given(data=st.data())
@settings(max_examples=100, derandomize=True)
def test_a_damaged_bag_gives_a_valid_log_or_is_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, whole: Path, data: st.DataObject
) -> None:
    root = tmp_path_factory.getbasetemp() / f"bag{next(COUNT)}"
    root.mkdir()
    copy = root / whole.name
    shutil.copytree(whole, copy) if whole.is_dir() else shutil.copy(whole, copy)
    file = data.draw(st.sampled_from(files(copy)))
    file.write_bytes(data.draw(damaged(file.read_bytes())))
    check(READER, root)
    shutil.rmtree(root)


@pytest.mark.parametrize("kind", KINDS)
def test_sizes_of_gigabytes_take_no_memory(tmp_path: Path, kind: str) -> None:
    """A huge number is written at each of fifty places of a bag, which is read in a process of its
    own: the peak of its memory is checked."""
    drive(bag_path(tmp_path, kind), kind, clouds=1)
    code = f"""
from pathlib import Path
from tests.readers.test_bag_fuzz import READER, check, files
root = Path({str(tmp_path)!r})
file = next(path for path in files(root / {bag_path(tmp_path, kind).name!r}) if path.suffix != ".yaml")
whole = file.read_bytes()
for at in range(0, len(whole), max(len(whole) // 50, 1)):
    file.write_bytes(whole[:at] + b"\\xff\\xff\\xff\\x7e" + whole[at + 4 :])
    check(READER, root)
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""
    out = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    # In KiB; the libraries take some 200 MiB. getrusage would count the parent's memory too.
    assert int(out.stdout) < 1024**2


@given(kind=st.sampled_from(["ros1", "mcap"]), data=st.data())
@settings(max_examples=100, derandomize=True)
def test_a_bag_with_a_damaged_message_gives_a_valid_log_or_is_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, kind: str, data: st.DataObject
) -> None:
    root = tmp_path_factory.getbasetemp() / f"message{next(COUNT)}"
    with BagWriter(bag_path(root, kind), kind) as bag:
        original_write = bag._writer.write
        damaged_number = data.draw(st.integers(0, 10))
        numbers = itertools.count()

        def write(connection: Connection, stamp_ns: int, message: bytes) -> None:
            if next(numbers) == damaged_number:
                message = data.draw(damaged(bytes(message)))
            original_write(connection, stamp_ns, message)

        bag._writer.write = write  # type: ignore[method-assign]
        fill(bag, clouds=3)
    check(READER, root)
    shutil.rmtree(root)


@given(
    st.lists(
        st.tuples(st.integers(0, 12), st.sampled_from([0.0, 1.0, np.nan, np.inf])),
        min_size=1,
        max_size=8,
    ),
    st.lists(
        st.tuples(st.integers(0, 12), st.sampled_from([0.0, 1.0, np.nan, 1e300])),
        min_size=1,
        max_size=12,
    ),
)
@settings(max_examples=100, derandomize=True)
def test_of_clouds_with_one_stamp_the_first_is_read(
    tmp_path_factory: pytest.TempPathFactory,
    clouds: list[tuple[int, float]],
    poses: list[tuple[int, float]],
) -> None:
    root = tmp_path_factory.getbasetemp() / f"stamps{next(COUNT)}"
    with BagWriter(root / "drive.bag", "ros1") as bag:
        for step, x in poses:
            bag.odometry(START_NS + step * STEP_NS, "map", "lidar", at(x), "/ground_truth")
        for i, (step, x) in enumerate(clouds):
            cloud(bag, START_NS + step * STEP_NS, "lidar", [[i, 0, 0], [x, 0, 0]])
    reader = Bag(ground_truth="/ground_truth", max_gap_s=10)
    check(reader, root)
    first = {step: i for i, (step, _) in reversed(list(enumerate(clouds)))}
    try:
        log = reader.open(root, "drive")
    except LogError as error:
        assert_line(error, root)
    else:
        steps = ((log.stamps_ns - START_NS) // STEP_NS).tolist()
        assert [log.points(row)[0, 0] for row in range(len(steps))] == [
            first[step] for step in steps
        ]
        assert len(steps) + log.skipped.total() == len(clouds)
    shutil.rmtree(root)
