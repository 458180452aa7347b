"""The tables, the sentences made of numbers, and the page that holds them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.evaluation.numbers import MEASURES
from pipeline.evaluation.protocols import Distance
from pipeline.reports import comparison, findings, series, setup, tables
from pipeline.reports.page import Illustration, report, text
from pipeline.reports.result import Result
from pipeline.reports.table import Table, bracket, signed
from pipeline.reports.wording import HOW_TO_READ
from tests.reports.made import MODELS, bounded, result, study

BY_HAND = {
    "recall_at_1": 0.75,
    "oracle": 0.93,
    "auc_top1": 0.8,
    "auc_exact_top1": 0.81,
    "f1_max": 0.7,
    "recall_at_99_precision": 0.25,
    "auroc": 0.9,
    "precision_at_threshold": 0.95,
    "recall_at_threshold": 0.7,
    "median_error_m": 2.46,
}


def by_hand(method: str, sequence: str, days: int, **cells: Any) -> Result:
    given = result(method, sequence, days, **(BY_HAND | cells))
    return bounded(bounded(given, "cells", "recall_at_1", 0.704, 0.996), "cells", "auc_top1", 0.0, 0.856)


RESULTS = [
    by_hand("sci", "2012-03-17", 62, recall_at_1=0.65, auroc=None),
    by_hand("sci", "2012-02-04", 20),
    by_hand("m2dp", "2012-02-04", 20, recall_at_1=0.5),
    by_hand("m2dp", "2012-03-17", 62, recall_at_1=0.65),
]


def rejecting(given: Result, **measures: Any) -> Result:
    """With other values (kind, 3) of some measures by cells."""
    values = given.evaluation.cells.rejection.copy()
    for name, value in measures.items():
        values[:, MEASURES.index(name)] = value
    return replace(given, evaluation=replace(given.evaluation, cells=replace(given.evaluation.cells, rejection=values)))


def test_table_two_has_a_row_a_sequence_in_the_order_of_days_by_both_protocols() -> None:
    assert tables.sequences(RESULTS).rows == (
        ("2012-02-04", "20", "7", "5", "2", "0.286", "5", "2", "0"),
        ("2012-03-17", "62", "7", "5", "2", "0.286", "5", "2", "0"),
    )


def test_a_number_has_a_row_a_sequence_a_column_a_method_and_the_oracle_last() -> None:
    # The deviation of .65 and .75 with one degree of freedom is .1/√2 = .071. By cells the oracle misplaces one of five.
    assert tables.main(RESULTS, "cells", "recall_at_1", {}).text().splitlines() == [
        "recall@1                 sci              m2dp  oracle",
        "──────────  ────────────────  ────────────────  ──────",
        "2012-02-04  0.750 [.70, 1.0]  0.500 [.70, 1.0]   0.930",
        "2012-03-17  0.650 [.70, 1.0]  0.650 [.70, 1.0]   0.930",
        "mean        0.700 ± .071      0.575 ± .106       0.930",
    ]
    assert tables.main(RESULTS, "cells", "auc_top1", {}).rows[0][1:] == ("0.800 [.00, .86]",) * 2 + ("0.900",)


def test_results_by_distance_are_other_numbers() -> None:
    # Right by distance are four of five seen queries; the oracle is right for all.
    (row,) = tables.main([result()], "distance", "recall_at_1", {}).rows
    assert row[1][:5] == "0.800"
    assert row[2] == "1.000"


def test_a_mark_stands_behind_the_interval_and_leaves_the_columns_in_line() -> None:
    marks = {("m2dp", "2012-02-04", "cells", "recall_at_1"): "−", ("m2dp", "2012-03-17", "cells", "recall_at_1"): ""}
    first, second, mean = tables.main(RESULTS, "cells", "recall_at_1", marks).rows
    assert first[1:3] == ("0.750 [.70, 1.0]", "0.500 [.70, 1.0] −")
    assert second[1:3] == ("0.650 [.70, 1.0]", "0.650 [.70, 1.0]  ")
    assert mean[2] == "0.575 ± .106".ljust(18)


def test_a_number_without_an_interval_stands_alone_in_line_with_the_others() -> None:
    (row,) = tables.main([bounded(RESULTS[1], "cells", "recall_at_1", np.nan, np.nan)], "cells", "recall_at_1", {}).rows
    assert row[1] == "0.750" + " " * 11


def test_two_drives_of_one_day_keep_their_times() -> None:
    drives = [by_hand("sci", f"2014-11-25-{hour}-00-00", 1) for hour in ("09", "15")]
    assert [row[0] for row in tables.main(drives, "cells", "recall_at_1", {}).rows[:2]] == [r.sequence for r in drives]


def test_the_other_numbers_are_means_by_both_protocols() -> None:
    table = tables.means(RESULTS)
    assert table.header == ("mean", "by", "AUC exact", "F1max", "R@99%P", "AUROC", "precision", "recall", "error [m]")
    assert [row[:2] for row in table.rows] == [("sci", "cells"), ("m2dp", "cells"), ("sci", "distance"), ("m2dp", "distance")]
    assert table.rows[0][2:] == ("0.810", "0.700", "0.250", "0.900", "0.950", "0.700", "2.5")  # one sequence has no AUROC


def test_headings_are_told_of_the_methods_that_tell_them_alone() -> None:
    assert tables.headings(RESULTS) is None
    both = [result(), result("scan_context"), result("scan_context", "2012-03-17", 62)]
    table = tables.headings(both)
    assert table is not None
    # All five seen are right; they are off by 1, 3, 4, 12 and 178 degrees.
    assert [row[:2] for row in table.rows] == [("scan_context", name) for name in ("2012-02-04", "2012-03-17", "mean")]
    assert table.rows[0][2].startswith("4.0 [")
    assert table.rows[0][3].startswith("0.600 [")
    assert table.rows[2][2:4] == ("4.0 ± 0.0", "0.600 ± .000")
    assert tables.means(both).header[-2:] == ("heading error [°]", "within 10°")
    assert tables.means(both).rows[0][-2:] == ("–", "–")
    assert tables.means(both).rows[1][-2:] == ("4.0", "0.600")


def test_every_sequence_and_method_has_its_numbers() -> None:
    table = tables.everything(RESULTS, "cells")
    assert [row[:2] for row in table.rows] == [
        ("2012-02-04", "sci"),
        ("2012-02-04", "m2dp"),
        ("2012-03-17", "sci"),
        ("2012-03-17", "m2dp"),
    ]
    assert table.rows[1][2:6] == ("0.500", "0.930", "0.800", "0.810")


def test_kinds_of_novelty_have_their_means_and_their_worst_sequence() -> None:
    one = rejecting(RESULTS[1], auroc=[[0.9, 0.8, 1.0], [1.0, 0.9, 1.0]], precision_at_threshold=[[0.8] * 3, [np.nan] * 3])
    two = rejecting(RESULTS[0], auroc=[[0.7, 0.6, 0.75], [0.8, 0.76, 0.9]], precision_at_threshold=[[0.6] * 3, [0.5] * 3])
    own, other = tables.novelties([two, one], "cells").rows
    assert own[:3] == ("sci", "entropy, in use", "0.800")
    assert (own[5], own[-1]) == ("0.700", "0.700 on 2012-03-17")
    assert other[:3] == ("sci", "energy", "0.900")
    assert (other[5], other[-1]) == ("0.500", "0.800 on 2012-03-17")  # of one sequence only: in the other it accepted nothing


def test_the_findings_say_which_kind_did_best_and_how_surely() -> None:
    one = rejecting(
        RESULTS[1],
        auroc=[[0.9, 0.8, 1.0], [1.0, 0.9, 1.0]],
        auc_exact_top1=[[0.7] * 3, [0.6] * 3],
        precision_at_threshold=[[0.8] * 3, [np.nan] * 3],
        recall_at_threshold=[[0.4] * 3, [0.0] * 3],
    )
    two = rejecting(
        RESULTS[0],
        auroc=[[0.7, 0.6, 0.75], [0.8, 0.76, 0.9]],
        auc_exact_top1=[[0.5] * 3, [0.5] * 3],
        precision_at_threshold=[[0.95] * 3, [0.9] * 3],
        recall_at_threshold=[[0.6] * 3, [0.3] * 3],
    )
    assert findings.novelties([one, two], "cells") == [
        "`sci`, by cells: energy told unseen from seen best (mean AUROC 0.900 against 0.800 of entropy, in use): ahead in 2 of 2"
        " sequences, by more than both 95 % intervals in 1. Counting misplaced queries too, entropy has the largest area under"
        " precision over recall (mean exact AUC 0.600). Of the thresholds chosen for a precision of 0.9, those of entropy missed"
        " it least: by 0.075 on average; its lowest precision was 0.800, its mean recall 0.500."
    ]


def test_the_findings_do_not_praise_another_kind_that_is_no_better() -> None:
    one = rejecting(RESULTS[1], auroc=[[0.9, 0.8, 1.0], [0.85, 0.8, 0.9]])
    assert findings.novelties([one], "cells")[0].startswith(
        "`sci`, by cells: no other kind told unseen from seen better than entropy, in use (mean AUROC 0.900; next energy, 0.850)."
    )


def test_markdown_is_a_table_that_github_draws_with_numbers_flush_right() -> None:
    table = Table(("who", "n"), (("a", "1"), ("bbbb", "22")), words=1)
    assert table.markdown() == "| who  |   n |\n| :--- | --: |\n| a    |   1 |\n| bbbb |  22 |\n"


def test_plain_text_lines_its_columns_up() -> None:
    table = Table(("who", "n"), (("a", "1"), ("bbbb", "22")), words=1)
    assert table.text() == "who    n\n────  ──\na      1\nbbbb  22\n"


def test_too_wide_a_table_goes_on_below_with_its_words() -> None:
    # Beside 10 columns of words fit 150 / (2 + 50) = 2 columns of 50.
    table = Table(("name", *"abc"), (("x" * 10, *(letter * 50 for letter in "123")),), words=1)
    first, second = table.text().split("\n\n")
    assert [line.split() for line in first.splitlines()] == [
        ["name", "a", "b"],
        ["─" * 10, "─" * 50, "─" * 50],
        ["x" * 10, "1" * 50, "2" * 50],
    ]
    assert second.split() == ["name", "c", "─" * 10, "─" * 50, "x" * 10, "3" * 50]


def test_brackets_and_signs_are_typographic() -> None:
    assert bracket((0.704, 0.996), 3) == " [.70, 1.0]"
    assert bracket((2.14, 13.0), 1) == " [2.1, 13.0]"
    assert bracket(None, 3) == ""
    assert (signed(-0.1204, 3), signed(0.05, 2), signed(None, 2)) == ("−0.120", "+0.05", "–")


def test_the_methods_are_told_with_what_they_are_and_what_they_had_to_learn_with() -> None:
    table = setup.table(MODELS)
    what = "SCI localisation: places as classes of a small CNN over Scan Context Images"
    assert table.rows[0] == ("sci", what, "scan_context", "0.01", "2 rounds, no. 1 kept", "1.2")
    assert table.rows[1] == ("m2dp", "–", "m2dp", "–", "nothing", "0.0")
    unsaid = setup.table({"sci": replace(MODELS["sci"], best_round=None)}).rows[0]
    assert unsaid[3:5] == ("0.01", "2 rounds")
    assert setup.settings(MODELS) == ["`sci`: view scan_context, epochs 200, budget 0.01", "`m2dp`: view m2dp, budget 0.01"]


def page(simulated: bool) -> str:
    figures = [
        Illustration("year", "figures/year.svg", "The year"),
        Illustration("novelty", "sci.svg", "sci: novelty"),
        Illustration("map", "one.svg", "sci on one"),
        Illustration("novelty", "m2dp.svg", "m2dp: novelty"),
    ]
    return report(study(RESULTS, simulated, Distance(unseen_m=20.0)), figures)


def test_the_report_holds_the_setup_the_tables_by_both_protocols_and_each_figure() -> None:
    told, tested = page(simulated=False), study(RESULTS).tested
    assert told.startswith("# Localising in campus\n")
    assert setup.table(study(RESULTS).models, 400).markdown() in told
    assert tables.sequences(RESULTS).markdown() in told
    for protocol in ("cells", "distance"):
        for number in ("recall_at_1", "auc_top1"):
            assert tables.main(RESULTS, protocol, number, comparison.marks(tested)).markdown() in told
        assert comparison.table(tested, protocol).markdown() in told
        assert findings.comparisons(tested, protocol)[0] in told
        assert tables.everything(RESULTS, protocol).markdown() in told
        assert f"### By {protocol}\n\n{tables.novelties(RESULTS, protocol).markdown()}" in told
    assert f"![The year](figures/year.svg)\n\n{HOW_TO_READ['year']}" in told
    assert "## Headings" not in told


def test_figures_of_one_kind_stand_together_and_are_explained_once() -> None:
    told = page(simulated=False)
    assert told.count(HOW_TO_READ["novelty"]) == 1
    places = [told.index(words) for words in ("](sci.svg)", HOW_TO_READ["novelty"], "](m2dp.svg)", "- [sci on one](one.svg)")]
    assert places == sorted(places)


def test_a_study_of_one_method_is_compared_with_none() -> None:
    told = report(study([result()]), [])
    assert "## Against" not in told
    assert "paired test" not in told + text(study([result()]))


def test_the_report_explains_the_protocols_by_the_distances_that_were_used_and_owns_its_caveats() -> None:
    told = " ".join(page(simulated=False).split())
    assert "nearer than 5 m, *unseen* if none is within 20 m" in told
    assert "40 resamples of the query path in blocks of 15 m" in told
    assert "a little too narrow" in told
    assert "touches the training path cannot be told" in told
    assert "at least 2 / 41" in told


def test_the_report_says_first_that_its_data_was_simulated_and_only_then() -> None:
    assert page(simulated=True).splitlines()[2].startswith("**Simulated, not recorded data.**")
    assert "imulated" not in page(simulated=False)


def test_the_terminal_sees_the_methods_and_both_protocols_within_its_width() -> None:
    many = [by_hand(method, name, 20) for method in ("sci", "m2dp", "scan_context") for name in ("2012-02-04", "2012-03-17")]
    told = text(study(many, simulated=True))
    assert told.startswith("simulated campus, trained on 2012-01-15 alone, cells of 10 m\n\nmethod ")
    assert text(study(many)).startswith("campus, ")
    assert "\n\nBy cells of 10 m: seen = training was" in told
    assert "\n\nBy distance: seen = a training pose within 5 m, right = within 15 m" in told
    assert "than sci on the same queries" in told
    assert max(map(len, told.splitlines())) <= 160


@pytest.mark.parametrize(("made", "header"), [(series.year, series.YEAR), (series.precision_recall, series.CURVE)])
def test_plain_data_has_a_header_and_a_row_a_point(made: Any, header: tuple[str, ...]) -> None:
    lines = made(RESULTS, False).splitlines()
    assert lines[0] == ",".join(header)
    assert len(lines) == 1 + len(RESULTS) * (1 if header is series.YEAR else 200)
    assert all(line.count(",") == len(header) - 1 for line in lines)


def test_the_year_as_plain_data() -> None:
    one = [by_hand("sci", "2012-02-04", 20, oracle=None)]
    assert series.year(one, False).splitlines()[1] == "sci,2012-02-04,20,0.8,0.75,0.8,"
    assert series.year(one, True).splitlines()[1].startswith("sci (simulated),")
