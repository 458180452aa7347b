"""Tests the readers of files on damaged files.

A reader returns a log that is as the class Log says, or raises an error of one line, and never
takes more than a gigabyte of memory.
"""

import gzip
import io
import itertools
import resource
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.core.errors import LogError, YearlocError
from pipeline.readers.carmen import Carmen
from pipeline.readers.folder import Folder, read_scan, read_tum
from pipeline.readers.keyframes import KeyFrames
from pipeline.readers.kitti import Kitti, read_velodyne
from pipeline.readers.log import Reader
from pipeline.readers.nclt import Nclt, read_packets, read_poses, read_velodyne_sync
from pipeline.readers.robotcar import RobotCar, read_sweep
from tests.readers import robotcar_drive
from tests.readers.damage import damaged, one_line, opened
from tests.readers.logs import (
    DATE,
    START,
    carmen_log,
    folder_log,
    key_frames,
    kitti_log,
    nclt_log,
    nclt_row,
    packet,
)

COUNT = itertools.count()


@pytest.fixture(autouse=True, scope="module")
def one_gigabyte() -> Iterator[None]:
    """Limit the memory: to allocate more than 1 GiB beyond what the tests have is a MemoryError,
    even if it is never touched."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + 2**30, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


def nclt(root: Path) -> Path:
    """Write a sequence of NCLT with odometry."""
    return nclt_log(
        root, odometry="".join(f"{START + 10_000 * i}, {i}, 0, 0, 0, 0, 0\n" for i in range(20))
    )


def tum_folder(root: Path) -> Path:
    """Write a user's sequence with scans named by stamps, and TUM poses and odometry."""
    poses = "".join(f"1326030975.{i} {i} 0 0 0 0 0 1\n" for i in range(8))
    return own_folder(root, poses, [f"1326030975.{i}5" for i in range(6)])


def kitti_folder(root: Path) -> Path:
    """Write a user's sequence with scans named by number, and KITTI poses and odometry."""
    poses = "".join(f"1 0 0 {i} 0 1 0 0 0 0 1 0\n" for i in range(8))
    return own_folder(root, poses, [str(i) for i in range(6)])


def own_folder(root: Path, poses: str, names: list[str]) -> Path:
    """Write a user's sequence with `poses`, the same as odometry, and scans of these `names`."""
    times = "".join(f"0.{i}\n" for i in range(8))
    scans = {f"scans/{name}.bin": np.array([2, 1, 3, 0.5], "<f4").tobytes() for name in names}
    folder_log(root, poses, scans, times)
    (root / "drive" / "odometry.txt").write_text(poses)
    return root


def robotcar(root: Path) -> Path:
    """Write a RobotCar drive with sweeps of both lasers."""
    beams = robotcar_drive.sweep(*((i, 1.5, 9) for i in range(9)))
    sweeps = {50 + 100 * i: beams for i in range(10)}
    return robotcar_drive.drive(root, sweeps, {**sweeps, 475: beams})


def carmen_pair(root: Path) -> Path:
    """Write a CARMEN log and a corrected one beside it."""
    return carmen_log(carmen_log(root), name="drive.gfs.log")


def carmen_packed(root: Path) -> Path:
    """Write a gzipped CARMEN log."""
    log = carmen_log(root) / "drive.log"
    (root / "drive.log.gz").write_bytes(gzip.compress(log.read_bytes(), mtime=0))
    log.unlink()
    return root


TUM = Folder(poses_format="tum", odometry="odometry.txt")
KITTI = Folder(poses_format="kitti", odometry="odometry.txt")
DRIVE = robotcar_drive.DATE
BOTH = RobotCar(("lms_front", "lms_rear"))
SCAN = f"lms_front/{robotcar_drive.START + 350_000}.bin"
PAIR = Carmen(corrected="{sequence}.gfs.log")


class LogFile(NamedTuple):
    """A file of a log, which the test damages."""

    write_log: Callable[[Path], Path]
    """Writes the log below a root, and returns the root."""
    reader: Reader
    sequence: str
    path: str
    """Below the root."""


LOG_FILES = [
    LogFile(nclt, Nclt(), DATE, f"{DATE}/groundtruth_{DATE}.csv"),
    LogFile(nclt, Nclt(), DATE, f"{DATE}/odometry_mu_100hz.csv"),
    LogFile(nclt, Nclt(), DATE, f"{DATE}/velodyne_sync/{START + 150_000}.bin"),
    LogFile(kitti_log, Kitti(), "07", "sequences/07/calib.txt"),
    LogFile(kitti_log, Kitti(), "07", "sequences/07/times.txt"),
    LogFile(kitti_log, Kitti(), "07", "sequences/07/velodyne/000002.bin"),
    LogFile(kitti_log, Kitti(), "07", "poses/07.txt"),
    LogFile(tum_folder, TUM, "drive", "drive/poses.txt"),
    LogFile(tum_folder, TUM, "drive", "drive/odometry.txt"),
    LogFile(kitti_folder, KITTI, "drive", "drive/poses.txt"),
    LogFile(kitti_folder, KITTI, "drive", "drive/times.txt"),
    LogFile(robotcar, BOTH, DRIVE, f"{DRIVE}/vo/vo.csv"),
    LogFile(robotcar, BOTH, DRIVE, f"{DRIVE}/gps/ins.csv"),
    LogFile(robotcar, BOTH, DRIVE, f"{DRIVE}/lms_front.timestamps"),
    LogFile(robotcar, BOTH, DRIVE, f"{DRIVE}/{SCAN}"),
    LogFile(robotcar, BOTH, DRIVE, "extrinsics/lms_front.txt"),
    LogFile(robotcar, BOTH, DRIVE, "extrinsics/ins.txt"),
    LogFile(carmen_log, Carmen(), "drive", "drive.log"),
    LogFile(carmen_pair, PAIR, "drive", "drive.gfs.log"),
    LogFile(carmen_packed, Carmen(), "drive", "drive.log.gz"),
    LogFile(key_frames, KeyFrames(), "run", "run/keyframes.txt"),
    LogFile(key_frames, KeyFrames(), "run", "run/2.pcd"),
]


@pytest.mark.parametrize(
    "file", LOG_FILES, ids=lambda file: f"{type(file.reader).__name__} {file.path}"
)
@given(data=st.data())
@settings(max_examples=60, derandomize=True)
def test_a_log_with_a_damaged_file_is_valid_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, file: LogFile, data: st.DataObject
) -> None:
    root = file.write_log(tmp_path_factory.mktemp(f"log{next(COUNT)}"))
    path = root / file.path
    path.write_bytes(data.draw(damaged(path.read_bytes())))
    opened(file.reader, root, file.sequence)


def pcd(data: str, body: bytes) -> bytes:
    """A PCD of two points; `data` is the form of its `body`."""
    head = (
        "VERSION 0.7\nFIELDS x y z ring\nSIZE 4 4 8 2\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH "
        "2\nHEIGHT 1\nPOINTS 2\n"
    )
    return f"{head}DATA {data}\n".encode() + body


def npy(array: np.ndarray) -> bytes:
    """The bytes of a .npy."""
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


RECORDS = struct.pack("<ffdHffdH", 1, 2, 3, 4, 5, 6, 7, 8)
BLOCK = bytes([31]) + RECORDS[:32] + bytes([0]) + RECORDS[32:33] + bytes([1 << 5, 7])
"""RECORDS as LZF: 32 literals, one literal, and a copy of 3 bytes."""
PACKETS = [np.full(4, 44_444), [2, 0], np.arange(6), np.arange(8), np.full(4, 44_444), np.zeros(8)]
HITS = np.concatenate(PACKETS).astype("<u2").tobytes()
"""A velodyne_hits.bin of a packet with two hits and one without."""


def own_scan(path: Path) -> np.ndarray:
    """Points of a scan file of a user's robot."""
    return read_scan(path, np.eye(4))


def positions(path: Path) -> np.ndarray:
    """Positions (n, 3) of NCLT's poses."""
    return read_poses(path).world_T_body[:, :3, 3]


@pytest.mark.parametrize(
    ("read", "suffix", "whole", "count"),
    [
        (own_scan, "bin", np.arange(12, dtype="<f4").tobytes(), 3),
        (own_scan, "npy", npy(np.arange(12.0).reshape(3, 4)), 3),
        (own_scan, "pcd", pcd("ascii", b"1 2 3 4\n5 6 nan 8\n"), 1),
        (own_scan, "pcd", pcd("binary", RECORDS), 2),
        (own_scan, "pcd", pcd("binary_compressed", struct.pack("<II", len(BLOCK), 36) + BLOCK), 2),
        (read_velodyne_sync, "bin", HITS[: 8 * 7], 7),
        (read_velodyne, "bin", HITS[:48], 3),
        (lambda path: read_packets(path).hits(0), "bin", HITS, 2),
        (positions, "csv", b"1, 2, 0, 0, 0, 0, 0\n5, 3, 0, 0, 0, 0, 0\n", 2),
    ],
    ids=[
        "bin",
        "npy",
        "ascii",
        "binary",
        "compressed",
        "velodyne_sync",
        "velodyne",
        "packets",
        "poses",
    ],
)
@given(data=st.data())
@settings(max_examples=120, derandomize=True)
def test_a_damaged_scan_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory,
    read: Callable[[Path], np.ndarray],
    suffix: str,
    whole: bytes,
    count: int,
    data: st.DataObject,
) -> None:
    path = tmp_path_factory.getbasetemp() / f"scan{next(COUNT)}.{suffix}"
    path.write_bytes(whole)
    assert len(read(path)) == count
    path.unlink()  # it may be mapped into memory
    path.write_bytes(data.draw(damaged(whole)))
    try:
        found = read(path)
    except YearlocError:
        return
    assert found.shape[1:] in ((3,), (4,))
    assert read is not own_scan or np.isfinite(found).all()


def test_a_range_image_is_points(tmp_path: Path) -> None:
    np.save(tmp_path / "1.npy", np.arange(24.0).reshape(2, 3, 4))
    assert own_scan(tmp_path / "1.npy")[:, 0].tolist() == [0, 4, 8, 12, 16, 20]
    np.save(tmp_path / "1.npy", np.asfortranarray(np.arange(24.0).reshape(2, 3, 4)))
    assert own_scan(tmp_path / "1.npy")[:, 0].tolist() == [0, 4, 8, 12, 16, 20]


def npy_header(shape: str, kind: str = "<f4", body: bytes = bytes(24), version: int = 1) -> bytes:
    """A .npy whose header claims this shape and type, and its body."""
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return (
        b"\x93NUMPY"
        + bytes([version, 0])
        + len(head).to_bytes(2 if version == 1 else 4, "little")
        + head
        + body
    )


def tum(*rows: str) -> str:
    """A TUM file; a row begins with the decimals of its stamp."""
    return "".join(f"1326030975.{row}\n" for row in rows)


def whole_until(at: int) -> str:
    """The error on packets of which one is broken."""
    return f"no whole packet at byte {at};"


BIG_ENDIAN = np.array([[3.25, -1.125, 40], [17.3, 2.7, 40]], ">f8")
UNSTAMPED = nclt_row(1).replace(str(START + 100_000), "nan")
TWO = packet(START, (20_000, 20_200, 19_800, 9, 31), (20_001, 20_000, 20_000, 255, 0)) + packet(
    START + 5, (0, 0, 65_535, 1, 2)
)
READS: dict[str, Callable[[Path], object]] = {
    "1.npy": own_scan,
    "poses.txt": read_tum,
    "velodyne_hits.bin": read_packets,
    "groundtruth.csv": read_poses,
    "1.sync": read_velodyne_sync,
    "000009.bin": read_velodyne,
    "1.sweep": lambda path: read_sweep(path, np.eye(4)),
}


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [
        ("1.npy", b"", "no whole .npy file"),
        ("1.npy", npy_header("(2, 3)")[:20], "no whole .npy file"),
        ("1.npy", npy_header("(" * 3000), "no whole .npy file"),
        ("1.npy", npy_header("(2, 3)", version=9), "no whole .npy file"),
        ("1.npy", npy_header("(6,)"), r"points \(n, 3 or more\) as numbers, found float32\(6,\)"),
        ("1.npy", npy_header("(3, 2)"), "3 or more"),
        ("1.npy", npy_header("(2, 3)", "|O"), "as numbers, found object"),
        ("1.npy", npy_header("(2, 3)", body=bytes(23)), "23 bytes of points, 24 for its shape"),
        ("1.npy", npy_header("(2, 3)", body=bytes(25)), "25 bytes of points, 24 for its shape"),
        ("1.npy", npy_header(f"({10**12}, 3)"), "24 bytes of points, 12000000000000 for its shape"),
        ("1.npy", npy_header("(99999999999999999999, 4)"), "24 bytes of points"),
        ("poses.txt", "", "holds no rows"),
        (
            "poses.txt",
            tum("0 0 0 0 0 0 0 1", "1 0 0 0 0 0 0 1.1"),
            "row 2 has a quaternion qx qy qz qw whose length is not 1",
        ),
        ("poses.txt", tum("0 0 0 0 0 0 0 0"), "row 1 has a quaternion"),
        ("poses.txt", tum("0 0 0 0 1e200 0 0 1"), "row 1 has a quaternion"),
        (
            "poses.txt",
            tum("0 0 0 0 0 0 0"),
            "row 1 is '1326030975.0 0 0 0 0 0 0'; expected stamp x y z qx qy qz qw",
        ),
        ("poses.txt", tum("0 0 0 zero 0 0 0 1"), "row 1 is .* expected eight numbers"),
        ("poses.txt", tum("5 0 0 0 0 0 0 1", "4 0 0 0 0 0 0 1"), "row 2 is stamped"),
        ("poses.txt", "nan 0 0 0 0 0 0 1\n", "row 1 is"),
        ("poses.txt", "1e999999999999 0 0 0 0 0 0 1\n", "row 1 is"),
        ("poses.txt", tum("0 0 0 1e300 0 0 0 1"), "row 1 is not finite, or lies nowhere on Earth"),
        ("poses.txt", "\x00\xff", "row 1 is"),
        ("velodyne_hits.bin", b"", "empty"),
        ("velodyne_hits.bin", packet(1, magic=(44_444, 44_444, 44_443, 44_444)), whole_until(0)),
        # the second packet starts at byte 24 + 2 · 8 = 40
        ("velodyne_hits.bin", TWO[:40] + b"\0" + TWO[41:], whole_until(40)),
        ("velodyne_hits.bin", TWO[:-1], whole_until(40)),
        ("velodyne_hits.bin", TWO[:30], whole_until(0)),
        ("velodyne_hits.bin", TWO + TWO[:20], whole_until(72)),
        # claims four thousand million hits
        ("velodyne_hits.bin", TWO[:8] + b"\xff\xff\xff\xff" + TWO[12:], whole_until(0)),
        ("velodyne_hits.bin", packet(2**63 + 1), "which is no time in µs"),
        ("groundtruth.csv", None, "no such file"),
        ("groundtruth.csv", nclt_row(0) + nclt_row(2) + nclt_row(1), "row 3 is stamped"),
        ("groundtruth.csv", nclt_row(0) + UNSTAMPED, "row 2 is stamped nan, which is no time"),
        ("groundtruth.csv", nclt_row(0, 1, 2, 3), "7 numbers"),
        ("groundtruth.csv", nclt_row(0) + nclt_row(1).replace("1, 0", "one, 0"), "7 numbers"),
        ("groundtruth.csv", nclt_row(0, 1, 2, 3, 4, 5, 6, 7), "7 numbers"),
        ("groundtruth.csv", "", "holds no rows"),
        ("groundtruth.csv", "1e30, 0, 0, 0, 0, 0, 0\n", "row 1 is stamped"),
        ("1.sweep", BIG_ENDIAN.tobytes(), "where no laser reaches"),
        *(
            ("1.sweep", bytes(n), f"{n} bytes are no whole number of 24-byte returns")
            for n in (1, 8, 23, 25)
        ),
        ("1.sync", None, "no such file"),
        *(
            ("1.sync", bytes(n), f"{n} bytes are no whole number of 8-byte hits")
            for n in (1, 7, 9, 15)
        ),
        ("000009.bin", None, "no such file"),
        *(("000009.bin", bytes(n), f"{n} bytes") for n in (1, 15, 17)),
    ],
)
def test_the_error_on_a_broken_file_is_one_line_that_names_it(
    tmp_path: Path, name: str, data: bytes | str | None, says: str
) -> None:
    if data is not None:
        (tmp_path / name).write_bytes(data.encode() if isinstance(data, str) else data)
    with one_line(LogError, f"{name}: .*({says})"):
        READS[name](tmp_path / name)


@pytest.mark.parametrize("stem", [START + 350_000, START + 150_000])
def test_a_folder_named_like_a_scan_is_skipped_or_refused(tmp_path: Path, stem: int) -> None:
    path = nclt_log(tmp_path) / DATE / "velodyne_sync" / f"{stem}.bin"
    path.unlink(missing_ok=True)
    path.mkdir()
    opened(Nclt(), tmp_path, DATE)
