from pathlib import Path

import pytest

from pipeline.errors import LogError
from pipeline.formats.changes import Change, read_changes, write_changes

CHANGES = [Change("construction", 20, 130, 5_735_010.25, -3.5), Change("tree", 41, 41, 0.0, 7.0)]


def test_what_is_written_is_read(tmp_path: Path) -> None:
    write_changes(tmp_path / "changes.csv", CHANGES)
    assert (tmp_path / "changes.csv").read_text().splitlines() == [
        "what,from_day,day,x_m,y_m",
        "construction,20,130,5735010.25,-3.50",
        "tree,41,41,0.00,7.00",
    ]
    assert read_changes(tmp_path / "changes.csv") == CHANGES


def test_a_file_of_no_changes_has_its_header(tmp_path: Path) -> None:
    write_changes(tmp_path / "changes.csv", [])
    assert read_changes(tmp_path / "changes.csv") == []


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (None, "no such file"),
        ("what,day,x_m\n", "names no column from_day, y_m"),
        ("what,from_day,day,x_m,y_m\ntree,1,1,0,0\ntree,1,soon,0,0\n", "row 2 holds no change"),
        ("what,from_day,day,x_m,y_m\ntree,1,1,0\n", "row 1 holds no change"),
        ("what,from_day,day,x_m,y_m\ntree,1,1,nan,0\n", "row 1 holds no change"),
    ],
)
def test_what_is_no_such_csv_is_one_line_of_error(tmp_path: Path, text: str | None, told: str) -> None:
    path = tmp_path / "changes.csv"
    if text is not None:
        path.write_text(text)
    with pytest.raises(LogError, match=told) as error:
        read_changes(path)
    assert "\n" not in str(error.value)
