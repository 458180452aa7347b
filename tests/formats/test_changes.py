"""Tests the csv of changes in a place since training."""

from pathlib import Path

import pytest

from pipeline.core.errors import LogError
from pipeline.formats.changes import Change, read_changes, write_changes
from tests.readers.damage import one_line

CHANGES = [Change("construction", 20, 130, 5_735_010.25, -3.5), Change("tree", 41, 41, 0.0, 7.0)]


@pytest.mark.parametrize("changes", [CHANGES, []])
def test_what_is_written_is_read(tmp_path: Path, changes: list[Change]) -> None:
    path = tmp_path / "changes.csv"
    write_changes(path, changes)
    lines = [
        "what,from_day,day,x_m,y_m",
        "construction,20,130,5735010.25,-3.50",
        "tree,41,41,0.00,7.00",
    ]
    assert path.read_text().splitlines() == lines[: 1 + len(changes)]
    assert read_changes(path) == changes


def test_a_kind_of_change_with_a_comma_is_quoted(tmp_path: Path) -> None:
    fence = [Change('fence, "high"', 3, 4, 1.0, 2.0)]
    write_changes(tmp_path / "changes.csv", fence)
    assert read_changes(tmp_path / "changes.csv") == fence


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "no such file"),
        ("what,day,x_m\n", "names no column from_day, y_m"),
        ("what,from_day,day,x_m,y_m\ntree,1,1,0,0\ntree,1,soon,0,0\n", "row 2 holds no change"),
        ("what,from_day,day,x_m,y_m\ntree,1,1,0\n", "row 1 holds no change"),
        ("what,from_day,day,x_m,y_m\ntree,1,1,nan,0\n", "row 1 holds no change"),
    ],
)
def test_a_wrong_csv_raises_an_error_of_one_line(
    tmp_path: Path, text: str | None, says: str
) -> None:
    path = tmp_path / "changes.csv"
    if text is not None:
        path.write_text(text)
    with one_line(LogError, says):
        read_changes(path)
