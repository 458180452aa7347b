"""The page of results says what each study is, and has a table per number over the test days."""

import pandas as pd

from pipeline.evaluation.rows import row, table
from pipeline.report.document import document
from tests.report.test_brief import ROBOT, TESTS, results
from tests.studies.made import study as made_study

CAMPUS = made_study(tests=TESTS, world="campus_demo", budget="demo")


def posed() -> pd.DataFrame:
    """Rows of a method m0 with poses, which are right on the last day alone."""
    place = {"grid": "10m", "method": "m0", "variant": "pose"}
    rows = [
        place | {"sequence": day, "days": days} | row(name, "distance", value)
        for day, days, right in (("2012-02-04", 20, 0.25), ("2013-04-05", 446, 1.0))
        for name, value in (
            ("recall_at_1", right),
            ("answered", 0.5),
            ("within_2m_5deg", right),
            ("error_m", 0.2),
        )
    ]
    return table(rows, study="robot", dataset="robot")


def test_recorded_studies_come_first_and_simulated_ones_are_called_so() -> None:
    tables = pd.concat([results("campus", methods=2), results("robot"), posed()])
    text = document(
        tables,
        {"campus": CAMPUS, "robot": ROBOT, "suburb": made_study("suburb")},
    )
    recorded, _, simulated = text.partition("## campus, simulated")
    assert "## robot, recorded" in recorded
    assert "Simulated" not in recorded
    assert "**Simulated, not recorded data** (world `campus_demo`)" in simulated
    assert "suburb" not in text
    heads = [
        line.split(" | ")[0].strip("| ")
        for line in simulated.splitlines()
        if line.startswith("| m")
    ]
    assert heads[:3] == ["method", "m1", "m0"]
    assert "\n\n\n" not in text
    assert "{" not in text


def test_poses_have_a_row_a_day_only_where_there_are_some() -> None:
    studies = {"robot": ROBOT}
    assert "2 m, 5°" not in document(results("robot"), studies)
    whole = document(pd.concat([results("robot"), posed()]), studies)
    found = whole.partition("Poses by day")[2].partition("What a robot is told")[0]
    cells = [
        [cell.strip() for cell in line.split("|")[1:5]]
        for line in found.splitlines()
        if line.startswith("| m0")
    ]
    assert cells == [
        ["m0-pose", "2012-02-04", "0.250", "–"],
        ["m0-pose", "2013-04-05", "1.000", "–"],
    ]
