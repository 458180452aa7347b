"""The tables and the page that holds them."""

from types import SimpleNamespace
from typing import Any, cast

from pipeline.evaluation.judgement import Judgement
from pipeline.reports import tables
from pipeline.reports.page import HOW_TO_READ, Illustration, report
from pipeline.reports.result import Result

JUDGEMENT = cast(Judgement, SimpleNamespace())


def result(method: str, sequence: str, days: int, **changes: Any) -> Result:
    numbers = {
        "days": days,
        "queries": 100,
        "seen": 80,
        "unseen": 20,
        "top1": 0.75,
        "top1_same_heading": 0.9,
        "oracle_top1": 0.93,
        "auc_top1": 0.8,
        "auc_top5": 0.85,
        "auc_top25": 0.9,
        "precision_at_threshold": 0.95,
        "recall_at_threshold": 0.7,
        "median_error_m": 2.46,
    }
    return Result(method, sequence, numbers | changes, JUDGEMENT)


RESULTS = [
    result("sci", "2012-03-17", 62, top1=0.65, top1_same_heading=None),
    result("sci", "2012-02-04", 20),
    result("m2dp", "2012-02-04", 20, top1=0.5),
]


def test_table_two_has_a_row_a_sequence_in_the_order_of_days() -> None:
    assert tables.sequences(RESULTS).rows == (
        ("2012-02-04", "20", "100", "80", "20", "0.200"),
        ("2012-03-17", "62", "100", "80", "20", "0.200"),
    )


def test_results_have_a_row_a_sequence_and_method_then_the_means() -> None:
    table = tables.outcomes(RESULTS)
    assert [row[:3] for row in table.rows] == [
        ("2012-02-04", "sci", "0.750"),
        ("2012-02-04", "m2dp", "0.500"),
        ("2012-03-17", "sci", "0.650"),
        ("mean", "sci", "0.700"),  # m2dp has one sequence only: no mean
    ]
    assert table.rows[0][-1] == "2.5"


def test_a_missing_number_is_a_dash_and_left_out_of_the_mean() -> None:
    rows = tables.outcomes(RESULTS).rows
    assert [row[3] for row in rows] == ["0.900", "0.900", tables.MISSING, "0.900"]


def test_markdown_is_a_table_that_github_draws_with_numbers_flush_right() -> None:
    table = tables.Table(("who", "n"), (("a", "1"), ("bbbb", "22")), words=1)
    assert table.markdown() == "| who  |   n |\n| :--- | --: |\n| a    |   1 |\n| bbbb |  22 |\n"


def test_plain_text_lines_its_columns_up() -> None:
    table = tables.Table(("who", "n"), (("a", "1"), ("bbbb", "22")), words=1)
    assert table.text() == "who    n\n────  ──\na      1\nbbbb  22\n"


def page(simulated: bool) -> str:
    figures = [Illustration("year", "figures/year.svg", "The year")]
    return report("nclt", "2012-01-15", 10.0, {"sci": {"epochs": 30}, "m2dp": {}}, RESULTS, figures, simulated)


def test_the_report_holds_the_setup_both_tables_and_each_figure_with_how_to_read_it() -> None:
    text = page(simulated=False)
    assert text.startswith("# Localising in nclt\n")
    assert "- grid cells of 10 m\n- method `sci`: epochs 30\n- method `m2dp`\n" in text
    assert tables.sequences(RESULTS).markdown() in text
    assert tables.outcomes(RESULTS).markdown() in text
    assert f"![The year](figures/year.svg)\n\n{HOW_TO_READ['year']}" in text
    assert "recall, which reaches 1" in text


def test_the_report_says_first_that_its_data_was_simulated_and_only_then() -> None:
    assert page(simulated=True).splitlines()[2].startswith("**Simulated campus, not recorded data.**")
    assert "imulated" not in page(simulated=False)
