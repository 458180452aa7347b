"""The report of a study of learning further days: its sections, tables, findings and short
table."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from syrupy.assertion import SnapshotAssertion

from pipeline.evaluation.results import where
from pipeline.report import report
from pipeline.report.brief import brief
from pipeline.report.render import sentence
from pipeline.report.strategies import Strategy, findings, read_strategies
from pipeline.report.study import StudyResults
from pipeline.report.tables import of_order, pseudo_labelled, query_days
from tests.report import learned
from tests.report.studied import FEW


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> StudyResults:
    return learned.build(Path(tmp_path_factory.mktemp("learned"), "artifacts"))


@pytest.fixture(scope="module")
def every(study: StudyResults) -> list[Strategy]:
    return read_strategies(study.rows)


def of(every: list[Strategy], *wanted: str) -> Strategy:
    return next(one for one in every if (one.model, one.order, one.name) == wanted)


def test_numbers_are_by_seed_and_step(every: list[Strategy]) -> None:
    one = of(every, "sci", "days", "fine_tuned")
    assert one.steps == [learned.TRAIN, learned.LEARNED]
    assert one.groups == learned.QUERIED
    assert one.over("recall_of_all", "cells").tolist() == [
        [0.5, 0.5],
        [0.5, 0.75],
    ]  # of four known: 1 and 3; then 3, 4; 1, 3, 4
    assert one.matrix("cells").tolist() == [[0.5, 1.0], [0.25, 1.0]]  # the mean of 0 and .5
    assert one.over("cpu_s").tolist() == [[100.0, 2.0]] * 2
    assert np.isnan(one.over("wrong")).tolist() == [[True, True]] * 2
    assert of(every, "sci", "self_training", "self_trained_all").last("wrong").tolist() == [
        3.0,
        4.0,
    ]
    first = of(every, "sad", "streets", "incremental").matrix("distance")[0]
    assert first[0] == pytest.approx(2 / 3)
    assert np.isnan(first[1])


def test_a_row_a_model_and_strategy_with_both_protocols_and_what_a_step_costs(
    every: list[Strategy],
) -> None:
    only, *others = of_order("days", [one for one in every if one.order == "days"])
    assert not others
    assert [(row[0].text, row[1].text) for row in only.rows] == [
        *(("sci", strategy) for strategy in ("frozen", "incremental", "fine_tuned", "joint")),
        *(("sad", strategy) for strategy in ("frozen", "incremental")),
    ]
    fine_tuned = [str(cell) for cell in only.rows[2][2:]]
    # forgetting: (.5 - 0) and (1 - 1) of one seed, none of the other; transfer: the third query
    # stays right
    assert fine_tuned == [
        *["0.625 ± .177", "0.625 ± .177", "0.125 ± .177", "0.000 ± .000"] * 2,
        "3 → 4",
        "3.0 ± 0.0",
        "2.0 ± 0.0",
    ]


def test_days_without_reference_poses_have_counts_and_each_queried_day_before_and_after(
    every: list[Strategy],
) -> None:
    self_training = [one for one in every if one.order == "self_training"]
    assert [[str(cell) for cell in row[1:]] for row in pseudo_labelled(self_training).rows] == [
        ["self_trained", "50 ± 0", "40 ± 0", "0 ± 0", "7 ± 0"],
        ["self_trained_all", "50 ± 0", "44 ± 1", "4 ± 1", "7 ± 0"],
    ]
    days = query_days(self_training, "distance")
    assert days.header == ("model", "strategy", "when", *learned.QUERIED)
    assert [[cell.text for cell in row[1:]] for row in days.rows] == [
        ["self_trained", "before", "0.500", "1.000"],
        ["self_trained", "after", "1.000", "0.500"],
        ["self_trained_all", "before", "0.500", "1.000"],
        ["self_trained_all", "after", "0.500", "0.000"],
    ]


def test_findings_say_by_how_much_and_over_how_many_seeds(
    every: list[Strategy], snapshot: SnapshotAssertion
) -> None:
    forgets, below, regained = findings(every)
    listed = [(one["order"], one["difference"], one["seeds"]) for one in forgets.values["listed"]]
    assert listed == [
        ("days", pytest.approx(-0.375), 2)
    ]  # −.25 of incremental learning, against .25 and 0
    assert [
        (one["own"], one["reference"], one["difference"]) for one in below.values["listed"]
    ] == [(1.0, 1.0, 0.0)]
    assert sentence(forgets) == snapshot(name="what incremental learning forgets")
    assert sentence(below) == snapshot(name="how far below the joint model it is")
    assert sentence(regained) == snapshot(name="what a site regains by itself")
    assert findings([one for one in every if one.model == "sad"]) == []


def test_the_report_and_the_page_are_whole(
    study: StudyResults, tmp_path: Path, snapshot: SnapshotAssertion
) -> None:
    line = report.write(
        tmp_path / "report",
        study.layout,
        {"campus": learned.SETTINGS},
        study.table,
        FEW,
        pytest.fail,
    )
    assert line.startswith("1 sections and 8 figures of 1 study")
    folder = tmp_path / "report/campus/10m"
    text = (folder / "report.md").read_text()
    assert re.findall(r"^## (.*)", text, re.MULTILINE) == [
        "Learning further days: simulated campus"
    ]
    prose = re.sub(r"^(\||!\[|- `|Sources).*", "", text, flags=re.MULTILINE)
    assert not re.findall(r"\bnan\b|None|\{|\}|\[|\S  +\S| [,;.:] |\.\.|\(\)|``|−0\.000", prose)
    assert "queried on 2 other days after each" in " ".join(text.split())
    shown = set(re.findall(r"!\[[^]]*\]\(([^)]*)\)", text))
    assert shown == {path.name for path in folder.glob("*.svg")}
    assert shown == {one["file"] for one in json.loads((folder / report.MANIFEST).read_text())}
    page = (tmp_path / "report/page.html").read_text()
    assert "sci: recall and forgetting after each step" in page
    assert "sad: recall and forgetting after each step" not in page
    text = report.terminal_text(study, 7)
    assert re.sub(r"\S*/artifacts/", "artifacts/", text) == snapshot
    assert not re.search("[`*]|nan", text)
    assert max(map(len, text.splitlines())) <= 160


def test_a_terminal_shows_strategies_in_a_few_lines(study: StudyResults) -> None:
    text = brief(study.table, {"campus": learned.SETTINGS}, 78)
    lines = text.splitlines()
    assert len(lines) <= 12
    assert max(map(len, lines)) <= 78
    assert lines[0] == "campus, simulated: learned further days, cells of 10 m, right within 15 m"
    assert next(line for line in lines if "fine_tuned" in line).split() == [
        "sci",
        "fine_tuned",
        "0.625",
        "0.125",
        *["–"] * 3,
    ]
    assert "… and 1 more" in text
    narrow = brief(study.table, {"campus": learned.SETTINGS}, 60).splitlines()
    assert max(map(len, narrow)) <= 60
    assert next(line for line in narrow if "fine_tuned" in line).split() == [
        "sci",
        "fine_tuned",
        "0.625",
        "–",
        "–",
    ]


def test_without_rows_nothing_is_printed_but_the_title(study: StudyResults) -> None:
    assert (
        len(
            brief(where(study.table, {"grid": "5m"}), {"campus": learned.SETTINGS}, 78).splitlines()
        )
        <= 3
    )
