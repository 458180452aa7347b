"""The tables, the sentences made of numbers, and the page that holds them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.numbers import MEASURES
from pipeline.evaluation.protocols import Distance
from pipeline.reports import findings, series, tables
from pipeline.reports.page import HOW_TO_READ, Illustration, report, text
from pipeline.reports.result import Result
from tests.reports.made import bounded, result

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


def test_results_in_a_terminal_have_intervals_means_and_dashes() -> None:
    lines = tables.outcomes(RESULTS, "cells").text().splitlines()
    assert lines[:1] + lines[2:] == [
        "sequence    method          recall@1  oracle         AUC top-1  AUC exact "
        " F1max  R@99%P  AUROC  precision  recall  error [m]",
        "2012-02-04  sci     0.750 [.70, 1.0]   0.930  0.800 [.00, .86]      0.810 "
        " 0.700   0.250  0.900      0.950   0.700        2.5",
        "2012-02-04  m2dp    0.500 [.70, 1.0]   0.930  0.800 [.00, .86]      0.810 "
        " 0.700   0.250  0.900      0.950   0.700        2.5",
        "2012-03-17  sci     0.650 [.70, 1.0]   0.930  0.800 [.00, .86]      0.810 "
        " 0.700   0.250      –      0.950   0.700        2.5",
        "mean        sci     0.700 ± .071       0.930  0.800 ± .000          0.810 "
        " 0.700   0.250  0.900      0.950   0.700        2.5",
    ]
    assert max(map(len, lines)) <= 130


def test_results_by_distance_are_other_numbers() -> None:
    # Right by distance are four of five seen queries; the oracle is right for all.
    row = tables.outcomes([result()], "distance").rows[0]
    assert row[2][:5] == "0.800"
    assert row[3] == "1.000"


def test_a_number_without_an_interval_stands_alone_in_line_with_the_others() -> None:
    row = tables.outcomes([bounded(RESULTS[1], "cells", "recall_at_1", np.nan, np.nan)], "cells").rows[0]
    assert row[2] == "0.750" + " " * 11


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
    table = tables.Table(("who", "n"), (("a", "1"), ("bbbb", "22")), words=1)
    assert table.markdown() == "| who  |   n |\n| :--- | --: |\n| a    |   1 |\n| bbbb |  22 |\n"


def test_plain_text_lines_its_columns_up() -> None:
    table = tables.Table(("who", "n"), (("a", "1"), ("bbbb", "22")), words=1)
    assert table.text() == "who    n\n────  ──\na      1\nbbbb  22\n"


def page(simulated: bool) -> str:
    figures = [Illustration("year", "figures/year.svg", "The year")]
    methods: dict[str, dict[str, object]] = {"sci": {"epochs": 30}, "m2dp": {}}
    return report(
        "nclt", "2012-01-15", 10.0, methods, RESULTS, figures, simulated, Distance(unseen_m=20.0), Bootstrap(block_m=30.0)
    )


def test_the_report_holds_the_setup_the_tables_by_both_protocols_and_each_figure_with_how_to_read_it() -> None:
    told = page(simulated=False)
    assert told.startswith("# Localising in nclt\n")
    assert "- grid cells of 10 m\n- method `sci`: epochs 30\n- method `m2dp`\n" in told
    assert tables.sequences(RESULTS).markdown() in told
    for protocol in ("cells", "distance"):
        assert f"## Results by {protocol}\n\n{tables.outcomes(RESULTS, protocol).markdown()}" in told
        assert f"### By {protocol}\n\n{tables.novelties(RESULTS, protocol).markdown()}" in told
    assert f"![The year](figures/year.svg)\n\n{HOW_TO_READ['year']}" in told


def test_the_report_explains_the_protocols_by_the_distances_that_were_used_and_owns_its_caveats() -> None:
    told = " ".join(page(simulated=False).split())
    assert "nearer than 5 m, *unseen* if none is within 20 m" in told
    assert "1,000 resamples of the query path in blocks of 30 m" in told
    assert "a little too narrow" in told
    assert "touches the training path cannot be told" in told


def test_the_report_says_first_that_its_data_was_simulated_and_only_then() -> None:
    assert page(simulated=True).splitlines()[2].startswith("**Simulated, not recorded data.**")
    assert "imulated" not in page(simulated=False)


def test_the_terminal_sees_both_protocols_named_above_their_tables() -> None:
    told = text("head", RESULTS, 10.0, Distance())
    assert told.startswith("head\n\nBy cells of 10 m: ")
    assert "\n\nBy distance: seen = a training pose within 5 m, right = within 15 m" in told
    assert max(map(len, told.splitlines())) <= 130


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
