"""Damaged RobotCar files: a log that keeps its promises, or one of this project's errors; nothing else, and no great memory."""

import itertools
import re
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import YearlocError
from pipeline.readers.robotcar import RobotCar
from tests.readers.damage import ANY, of_any_file
from tests.readers.robotcar_drive import DATE, START, drive, sweep

COUNT = itertools.count()
WORDS = [
    *(b"nan", b"-inf", b"inf", b"1e308", b"-1e308", b"1e18", b"9" * 40, b"9" * 400, b"1e-320", b"-1", b"0", b"0.5", b""),
    *(b"#", b'"', b"\xff", b"\0", b"0x10", b"1_0", str(START).encode(), str(START + 150_000).encode(), b"INS_INACTIVE", b"31U"),
]
FILES = [
    f"{DATE}/vo/vo.csv",
    f"{DATE}/gps/ins.csv",
    f"{DATE}/lms_front.timestamps",
    f"{DATE}/lms_front/{START + 350_000}.bin",
    "extrinsics/lms_front.txt",
    "extrinsics/ins.txt",
]


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """`data` cut short, with bits flipped, words replaced, rows lost, repeated or swapped, of the wrong end, endless or empty."""
    kind = draw(st.sampled_from(["cut", "flip", "word", "rows", "endian", "endless", "empty", "noise"]))
    if kind in ANY:
        return of_any_file(draw, data, kind)
    if kind == "word":
        pieces = re.split(rb"([,\s])", data)
        for _ in range(draw(st.integers(1, 3))):
            pieces[2 * draw(st.integers(0, len(pieces) // 2))] = draw(st.sampled_from(WORDS))
        return b"".join(pieces)
    if kind == "rows":
        rows = data.split(b"\n")
        at, other = (draw(st.integers(0, len(rows) - 1)) for _ in range(2))
        changed = draw(st.sampled_from([[], rows[at : at + 1] * 2, rows[other : other + 1]]))
        return b"\n".join(rows[:at] + changed + rows[at + 1 :])
    if kind == "endian":
        return np.frombuffer(data[: len(data) // 8 * 8], "<f8").byteswap().tobytes()
    return data * draw(st.integers(2, 2_000))


@pytest.mark.parametrize("file", FILES)
@given(data=st.data())
@settings(max_examples=40, deadline=None, derandomize=True)
def test_robotcar_survives_a_damaged_file(tmp_path_factory: pytest.TempPathFactory, file: str, data: st.DataObject) -> None:
    beam = sweep(*((i, 1.5, 9) for i in range(9)))
    sweeps = {50 + 100 * i: beam for i in range(10)}
    root = drive(tmp_path_factory.mktemp(f"robotcar{next(COUNT)}"), sweeps, {**sweeps, 475: beam})
    (root / file).write_bytes(data.draw(damaged((root / file).read_bytes())))
    refused = ""
    tracemalloc.start()
    try:
        log = RobotCar(("lms_front", "lms_rear")).open(root, DATE)
        rows = range(len(log.stamps_ns))
        clouds = [log.points(row) for row in rows]
    except YearlocError as error:
        refused = str(error)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**28
    if refused:
        assert root.name in refused
        assert "\n" not in refused
        return
    assert (np.diff(log.stamps_ns) > 0).all()
    known = [np.isfinite(poses).all(axis=(1, 2)) for poses in (log.world_T_scan, log.odom_T_scan)]
    assert (known[0] | known[1]).all()
    for poses, known_rows in zip((log.world_T_scan, log.odom_T_scan), known, strict=True):
        assert poses.shape == (len(rows), 4, 4)
        assert np.isnan(poses[~known_rows]).all()
    assert all(cloud.shape[1:] == (3,) and np.isfinite(cloud).all() for cloud in clouds)
    assert all(count > 0 for count in log.skipped.values())
