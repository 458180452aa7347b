"""The reader of numbered scans with a table of their poses."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.readers.posed_scans import HEADER, PosedScans
from tests.readers.damage import one_line

NORTH = "0,-1,0,4, 1,0,0,5, 0,0,1,6"
"""At (4, 5, 6) m, turned by 90° to the left."""
PCD = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\n"


def sequence(folder: Path, *rows: str, header: str = ",".join(HEADER)) -> Path:
    """A root with the sequence `car`: scans 0, 1 and 3, scan n of one point at x = n."""
    (folder / "car/scans").mkdir(parents=True)
    for number in (0, 1, 3):
        text = f"{PCD}DATA ascii\n{number} 2 3\n"
        (folder / f"car/scans/{number:03}.pcd").write_text(text)
    (folder / "car/truth.csv").write_text("\n".join([header, *rows]) + "\n")
    return folder


def test_scans_have_the_poses_of_their_rows_and_stamps_of_their_numbers(tmp_path: Path) -> None:
    root = sequence(tmp_path, f"0,1,.8,{NORTH}", f"3,1,.8,{NORTH}")
    log = PosedScans().open(root, "car")
    assert log.stamps_ns.tolist() == [0, 3_000_000_000]
    expected = [[0, -1, 0, 4], [1, 0, 0, 5], [0, 0, 1, 6], [0, 0, 0, 1]]
    assert log.world_T_scan[1].tolist() == expected
    assert log.points(1).tolist() == [[3, 2, 3]]
    assert log.skipped == {"no pose": 1}  # scan 1


def test_scans_whose_pose_is_not_sure_and_rows_without_a_scan_are_left_out(tmp_path: Path) -> None:
    none = ",".join(["nan"] * 12)
    root = sequence(tmp_path, f"0,1,.8,{NORTH}", f"1,0,nan,{none}", f"2,1,.8,{NORTH}")
    log = PosedScans().open(root, "car")
    assert len(log.stamps_ns) == 1
    assert log.skipped == {"no such file": 1, "no pose": 1, "no sure pose": 1}


def test_the_ground_is_lifted_to_z_0(tmp_path: Path) -> None:
    root = sequence(tmp_path, f"0,1,.8,{NORTH}")
    log = PosedScans(lift_m=0.5).open(root, "car")
    assert log.points(0).tolist() == [[0, 2, 3.5]]
    # the origins of both the scan's and the world's frame are moved down by the same length
    assert np.allclose(log.world_T_scan[0][:3, 3], [4, 5, 6])


def test_a_sequence_is_a_folder_with_a_table_and_scans(tmp_path: Path) -> None:
    root = sequence(tmp_path, f"0,1,.8,{NORTH}")
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty/truth.csv").write_text("")
    assert PosedScans().sequences(root) == {"car": [], "empty": ["scans/*.pcd"]}


@pytest.mark.parametrize(
    ("rows", "complaint"),
    [
        ((f"1,1,.8,{NORTH}", f"0,1,.8,{NORTH}"), "row 2 is of scan 0; expected whole numbers"),
        ((f".5,1,.8,{NORTH}",), "row 1 is of scan 0.5"),
        (("0,1,.8,1",), "row 1 has 4 numbers, expected 15"),
        ((f"0,1,x,{NORTH}",), "row 1: could not convert"),
        (("0,1,.8, 2,0,0,4, 0,2,0,5, 0,0,2,6",), "row 1 has no rotation"),
        ((), "holds no rows"),
        ((f"0,0,.8,{NORTH}",), "no scan in scans/\\*.pcd that truth.csv gives a sure pose"),
    ],
)
def test_a_wrong_table_is_refused_with_its_row(
    tmp_path: Path, rows: tuple[str, ...], complaint: str
) -> None:
    root = sequence(tmp_path, *rows)
    with one_line(LogError, complaint):
        PosedScans().open(root, "car")


def test_a_table_of_other_columns_is_refused(tmp_path: Path) -> None:
    root = sequence(tmp_path, header="x,y")
    with one_line(LogError, "begins with 'x,y'; expected scan,sure,overlap,T00"):
        PosedScans().open(root, "car")
