"""Each method against the first one: the table, the marks and the sentences."""

from dataclasses import replace

import numpy as np

from pipeline.evaluation.paired import Difference, Paired
from pipeline.reports import comparison, findings
from pipeline.reports.comparison import Against, against_first
from tests.reports.made import BOOTSTRAP, RESULTS, result


def against(method: str, sequence: str, recall: tuple[float, float], area: tuple[float, float]) -> Against:
    """Differences with their corrected p, by cells."""
    differences = tuple(Difference(value, value - 0.01, value + 0.01, p / 2) for value, p in (recall, area))
    return Against(result(method, sequence), "sci", "cells", Paired(differences, 7, 3), (recall[1], area[1]))


MADE = [
    against("m2dp", "2012-02-04", (0.03, 0.01), (-0.2, 0.04)),
    against("m2dp", "2012-03-17", (0.01, 0.3), (-0.1, 0.01)),
    against("m2dp", "2012-06-15", (-0.1, 0.05), (-0.3, 0.01)),
    replace(against("m2dp", "2012-02-04", (0.5, 0.01), (0.5, 0.01)), protocol="distance"),
]


def test_every_other_method_is_held_against_the_first_by_both_protocols() -> None:
    found = against_first([*RESULTS, result("scan_context"), result("scan_context", "2012-03-17", 62)], BOOTSTRAP)
    assert [(one.result.method, one.protocol, one.result.sequence) for one in found] == [
        (method, protocol, sequence)
        for method in ("m2dp", "scan_context")
        for protocol in ("cells", "distance")
        for sequence in ("2012-02-04", "2012-03-17")
    ]
    assert {one.reference for one in found} == {"sci"}
    # By cells SCI is right at 0, 1, 4, M2DP at 0, 2 and Scan Context at all five; by distance SCI is right at 3 too.
    assert [(one.paired.only_this, one.paired.only_reference) for one in found[::2]] == [(1, 2), (1, 3), (2, 0), (1, 0)]
    assert found[0].paired.differences[0].value == 2 / 5 - 3 / 5
    # Two equal sequences: twice their p, at most 1.
    assert found[4].p[0] == min(1.0, 2 * found[4].paired.differences[0].p)


def test_a_single_method_is_held_against_none() -> None:
    assert against_first([result()], BOOTSTRAP) == []


def test_a_verdict_needs_a_small_corrected_p() -> None:
    assert [one.verdict("recall_at_1") for one in MADE[:3]] == ["better", "undecided", "undecided"]
    assert [one.verdict("auc_exact_top1") for one in MADE[:3]] == ["worse"] * 3
    assert against("m2dp", "a", (0.1, np.nan), (0.1, 0.01)).verdict("recall_at_1") == "undecided"


def test_marks_are_for_the_columns_of_the_result_tables() -> None:
    marks = comparison.marks(MADE)
    assert marks["m2dp", "2012-02-04", "cells", "recall_at_1"] == "+"
    assert marks["m2dp", "2012-03-17", "cells", "recall_at_1"] == ""
    assert marks["m2dp", "2012-03-17", "cells", "auc_top1"] == "−"


def test_the_table_shows_differences_with_intervals_p_and_who_alone_was_right() -> None:
    table = comparison.table(MADE, "cells")
    assert table.header[2:5] == ("Δ recall@1", "p", "verdict")
    assert table.header[-2:] == ("only it right", "only sci right")
    first = (
        "m2dp",
        "2012-02-04",
        "+0.030 [+0.02, +0.04]",
        "0.010",
        "better",
        "−0.200 [−0.21, −0.19]",
        "0.040",
        "worse",
        "7",
        "3",
    )
    assert table.rows[0] == first
    assert len(table.rows) == 3
    blank = replace(MADE[0], paired=Paired((Difference(0.1, np.nan, np.nan, np.nan),) * 2, 0, 0), p=(np.nan, np.nan))
    assert comparison.table([blank], "cells").rows[0][2:5] == ("+0.100", "–", "undecided")


def test_a_sentence_says_where_a_method_wins_and_where_it_loses() -> None:
    assert findings.comparisons(MADE, "cells") == [
        "`m2dp` against `sci`, by cells: recall@1 −0.020 on average, better on 1 of 3 (2012-02-04), undecided on 2 of 3;"
        " exact AUC −0.200 on average, worse on all 3 sequences."
    ]
    assert findings.comparisons(MADE, "distance") == [
        "`m2dp` against `sci`, by distance: recall@1 +0.500 on average, better on the one sequence;"
        " exact AUC +0.500 on average, better on the one sequence."
    ]
