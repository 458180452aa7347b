"""Tests what `yearloc inspect` says of RobotCar's files and folders."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.inspection.report import inspect
from tests.inspection.scanner import assert_says
from tests.readers.damage import one_line
from tests.readers.robotcar_drive import (
    DATE,
    DRIVEN,
    START,
    drive,
    ins_row,
    ins_text,
    sweep,
    vo_row,
)


def test_a_sweep_is_described_with_its_beams_and_laser(tmp_path: Path) -> None:
    # Beams at 0°, 0.5°, … 180° of a circle of 10 m, and as many without a return: 180° and the 3°
    # that no gap is wider than.
    angles = np.radians(np.arange(0, 180.5, 0.5))
    beams = [(10 * np.cos(angle), 10 * np.sin(angle), 40) for angle in angles]
    root = drive(tmp_path, {50: sweep(*beams, *[(0, 0, 0)] * 180)})
    found = inspect(root / DATE / "lms_front" / f"{START + 50_000}.bin")
    assert "RobotCar sweep of lms_front" in found.headline
    assert_says(found, "2014-07-14 14:49:50 UTC", "361 of 541 beams", "10 m … 10 m, median 10 m")
    assert_says(found, "180° of 360°", "0 … 40")
    assert found.warnings == ()


def test_a_strange_sweep_is_warned_of(tmp_path: Path) -> None:
    path = tmp_path / "lms_rear" / f"{START}.bin"
    path.parent.mkdir()
    path.write_bytes(sweep(*[(60, 0, 1)] * 600))
    assert [warning.split(":")[0].split(" beyond")[0] for warning in inspect(path).warnings] == [
        "600 beams",
        "600 returns",
    ]
    path.write_bytes(sweep((0, 0, 0)))
    assert inspect(path).warnings == ("no beam has a return: was the laser covered?",)


def test_a_folder_of_sweeps_is_compared_with_its_list_of_stamps(tmp_path: Path) -> None:
    root = drive(tmp_path)
    found = inspect(root / DATE / "lms_front")
    assert_says(found, "10 a second")
    assert found.warnings == ()
    (root / DATE / "lms_front" / f"{START + 50_000}.bin").write_bytes(b"")
    (root / DATE / "lms_front" / f"{START + 60_000}.bin").write_bytes(sweep((1, 0, 0)))
    assert inspect(root / DATE / "lms_front").warnings == (
        "1 sweeps are skipped: empty file",
        "1 sweeps are skipped: file without a stamp",
    )
    (root / DATE / "lms_front.timestamps").unlink()
    assert inspect(root / DATE / "lms_front").warnings[1].startswith("no lms_front.timestamps: ")


def test_visual_odometry_is_described_with_breaks_and_gaps(tmp_path: Path) -> None:
    # Ten steps of 1 m; then a row that starts 0.1 s later than the last ended, and takes a second.
    root = drive(tmp_path, vo=DRIVEN + vo_row(2100, 1100, 3.0))
    found = inspect(root / DATE / "vo" / "vo.csv")
    assert_says(found, "13, in 2 chains", "13 m, longest step 3 m")
    breaks, gap = found.warnings
    assert breaks.startswith("breaks: 1 rows")
    assert gap.startswith("1 steps over 0.5 s, the longest 1 s")


def test_inertial_navigation_is_described_with_its_good_share_and_outages(tmp_path: Path) -> None:
    # Rows a tenth of a second apart; six of twenty are bad in a row: 0.7 s without a good one.
    rows = [
        ins_row(100 * i, 5_735_000 + i, status="INS_BAD" if 5 <= i < 11 else "INS_SOLUTION_GOOD")
        for i in range(20)
    ]
    found = inspect(drive(tmp_path, ins=ins_text(*rows)) / DATE / "gps" / "ins.csv")
    assert_says(found, "20, of which 70.0 % are INS_SOLUTION_GOOD", "INS_BAD 6", "30U", "12 m")
    assert_says(found, "northing 5735000.0 … 5735019.0 m")
    (outage,) = found.warnings
    assert outage.split(":")[1] == " 1 over 0.5 s without a good row, the longest 0.7 s"


def test_a_warning_says_that_no_row_is_good(tmp_path: Path) -> None:
    root = drive(
        tmp_path, ins=ins_text(*(ins_row(100 * i, status="INS_INACTIVE") for i in range(9)))
    )
    first_warning, *_ = inspect(root / DATE / "gps" / "ins.csv").warnings
    assert first_warning.startswith("no row is INS_SOLUTION_GOOD")
    assert any("no scan has a true pose" in warning for warning in inspect(root / DATE).warnings)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        *((f"lms_front/{START}.bin", data) for data in (b"", b"123", sweep((1e9, 0, 0)))),
        *(("vo.csv", data) for data in (b"", b"\xff\xfe", b"timestamp\n1\n")),
        *(("ins.csv", data) for data in (b"", b"\xff\xfe", b"timestamp\n1\n")),
    ],
)
def test_the_error_on_a_broken_file_is_one_line_that_names_it(
    tmp_path: Path, name: str, data: bytes
) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    with one_line(LogError, path.name):
        inspect(path)


def test_a_sequence_is_opened_as_its_reader_opens_it(tmp_path: Path) -> None:
    # 1 of 11 sweeps of the front laser has no true pose; the path is that of the others.
    sweeps = {50 + 100 * i: sweep((2, 1, 0), (3, 0, 0)) for i in range(10)}
    good = [ins_row(20 * i, 0.2 * i) for i in range(46)]
    bad = [ins_row(20 * i, 0.2 * i, status="INS_BAD") for i in range(46, 51)]
    root = drive(tmp_path, sweeps, {55: sweep((1, 0, 0))}, ins=ins_text(*good, *bad))
    found = inspect(root / DATE)
    assert "RobotCar sequence" in found.headline
    assert_says(found, "with lms_front and lms_rear", "11, 10 with a true pose", "8 m, step")
    assert_says(found, "odometry", "at 100 % of the sweeps")
    assert found.warnings == ("1 of 11 sweeps have no place (INS outages: 1)",)
    (root / DATE / "vo" / "vo.csv").unlink()
    assert "the reader refuses the sequence" in inspect(root / DATE).warnings[0]


def test_a_root_lists_its_drives(tmp_path: Path) -> None:
    root = drive(tmp_path)
    found = inspect(root)
    assert "RobotCar root, sequences: 1" in found.headline
    assert "can be read" in found.text()
    (root / "extrinsics" / "ins.txt").unlink()
    assert "lacks extrinsics/ins.txt" in inspect(root).text()
