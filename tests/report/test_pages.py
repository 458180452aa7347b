"""Published numbers: blocks are filled from tables of results, the published pages agree with each
other, and the page of results says what each study is."""

import re
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from pipeline.core.errors import ConfigError
from pipeline.evaluation.rows import row, table
from pipeline.report.pages import PAGES, Block, blocks, document, filled, table_texts
from tests.report.test_brief import ROBOT, TESTS, results
from tests.studies.made import study as made_study

ROOT = Path(__file__).parents[2]
PAGE = """# A page
<!-- results: campus minutes brief -->
old
<!-- end of results -->
between
<!-- results: town demo tables -->
<!-- end of results -->
"""
CAMPUS = Block("campus", "minutes", "brief")
TOWN = Block("town", "demo", "tables")
STUDY = made_study(tests=TESTS, world="campus_demo", budget="minutes")
DEMO = replace(STUDY, budget="demo")


def test_a_block_is_filled_between_its_marks_and_others_are_left() -> None:
    assert blocks(PAGE) == [CAMPUS, TOWN]
    once = filled(PAGE, {CAMPUS: "new\n"})
    assert once == PAGE.replace("old", "new")
    assert filled(once, {CAMPUS: "new"}) == once


def test_a_mark_of_another_kind_is_named() -> None:
    with pytest.raises(
        ConfigError,
        match="results: campus minutes pictures -->: expected STUDY BUDGET and brief, tables",
    ):
        blocks(PAGE.replace("brief", "pictures"))


def test_a_picture_names_its_model_and_no_other_kind_does() -> None:
    mark = "picture sci_ring-pose"
    assert blocks(PAGE.replace("brief", mark)) == [
        Block("campus", "minutes", "picture", "sci_ring-pose"),
        TOWN,
    ]
    for wrong in ("picture", "brief sci", "picture sci ring"):
        with pytest.raises(
            ConfigError,
            match=f"results: campus minutes {wrong} -->: expected STUDY BUDGET .* or picture MODEL",
        ):
            blocks(PAGE.replace("brief", wrong))


def test_a_study_fills_the_blocks_of_its_budget_and_of_this_machines_arithmetic_alone() -> None:
    texts = table_texts(results("campus", methods=2), {"campus": STUDY}, "float32")
    assert set(texts) == {CAMPUS, CAMPUS._replace(kind="tables"), CAMPUS._replace(kind="float32")}
    assert texts[CAMPUS].startswith(
        "```\ncampus, simulated: learned 2012-01-15, 2 test days, cells of 10 m\n"
    )
    assert "## campus, simulated" in texts[CAMPUS._replace(kind="tables")]
    table = texts[CAMPUS._replace(kind="float32")]
    assert "| m1 " in table
    assert "12.4" not in table  # a query's milliseconds differ from run to run


def published(kind: str, page: str = "docs/RESULTS.md") -> str:
    """The text of the block of this kind that is of the demo."""
    found = re.search(
        rf"<!-- results: campus minutes {kind} -->\n(.*?)<!-- end",
        (ROOT / page).read_text(),
        re.DOTALL,
    )
    assert found, f"{page} has no {kind}"
    return found[1]


def rows(text: str) -> dict[str, list[str]]:
    """Method to the numbers behind it, of a table of either form, intervals left out."""
    lines = (re.sub(r"\[[^]]*\]|\|", " ", line).split() for line in text.splitlines())
    return {
        words[0]: words[1:]
        for words in lines
        if len(words) > 2 and re.fullmatch(r"[a-z_]+(-[a-z]+)*", words[0])
    }


def test_readme_index_and_results_say_the_same_of_the_demo() -> None:
    brief = published("brief", "README.md")
    whole = published("tables")
    assert published("brief", "docs/index.md") == brief
    scorecard = rows(whole.partition("**Right cell first")[0])
    shown = {name: numbers for name, numbers in rows(brief).items() if "sc" in name}
    assert shown.keys() >= {"sci", "sci_ring-pose", "scan_context"}
    for name, numbers in shown.items():
        first, last, accepted, wrong, refused, _, all_wrong = numbers[:7]
        days = scorecard[name][:3]
        assert [first, last] == [days[0], days[-1]]
        assert int(accepted) >= int(wrong) == int(all_wrong) - int(refused)


def test_the_pictures_caption_counts_no_more_of_the_last_day_than_the_table_of_all_days() -> None:
    caption = published("picture sci_ring-pose", "README.md")
    accepted, wrong = map(
        int, re.findall(r"(\d+) poses accepted, (\d+) wrong among them", caption)[0]
    )
    of_all_days, wrong_of_all_days = rows(published("brief", "README.md"))["sci_ring-pose"][2:4]
    assert 0 < accepted < int(of_all_days)
    assert wrong <= int(wrong_of_all_days)


def test_the_tables_of_two_kinds_of_processor_are_both_there_and_the_demos_is_one_of_them() -> None:
    kinds = [rows(published(kind)) for kind in ("bfloat16", "float32")]
    assert kinds[0].keys() == kinds[1].keys()
    demo = rows(published("tables").partition("**Right cell first")[0])
    assert any(all(demo[name][:3] == kind[name][:3] for name in kind) for kind in kinds)


def test_every_mark_of_the_published_pages_is_known_and_filled() -> None:
    for page in PAGES:
        text = (ROOT / page).read_text()
        assert blocks(text)
        assert "-->\n<!-- end of results" not in text


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
        {"campus": DEMO, "robot": ROBOT, "suburb": made_study("suburb")},
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
    found = whole.partition("Poses by day")[2].partition("**Verdicts, in numbers")[0]
    cells = [
        [cell.strip() for cell in line.split("|")[1:5]]
        for line in found.splitlines()
        if line.startswith("| m0")
    ]
    assert cells == [
        ["m0-pose", "2012-02-04", "0.250", "–"],
        ["m0-pose", "2013-04-05", "1.000", "–"],
    ]
