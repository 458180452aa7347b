"""The study of cells: means over the test sequences at every size, and sentences that follow from them."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from pipeline.errors import InputError
from pipeline.reports import cells, cells_findings
from pipeline.reports.result import Result
from pipeline.reports.section import Section
from pipeline.reports.style import SIMULATED, colour
from tests.reports.made import result

CELL_M = {"5m": 5.0, "10m": 10.0, "20m": 20.0}
AUC = ("cells", "auc_top1", "AUC top-1 by cells")


def evaluated(method: str, *aucs: float | None) -> list[Result]:
    """A method's AUC by cells on one test sequence after the other."""
    return [
        result(method, sequence, days, auc_top1=auc)
        for (sequence, days), auc in zip((("2012-02-04", 20), ("2012-03-17", 62)), aucs, strict=False)
    ]


# In no order of sizes: sci .5, .6, .9 on average and up on both sequences; m2dp down on one of them, and missing at 10 m.
EVALUATED = {
    "20m": [*evaluated("sci", 0.9, 0.9), *evaluated("m2dp", 0.5, 0.2)],
    "5m": [*evaluated("sci", 0.4, 0.6), *evaluated("m2dp", 0.4, 0.3)],
    "10m": [*evaluated("sci", 0.5, 0.7)],
}
ORDERED = {grid: EVALUATED[grid] for grid in CELL_M}


def test_lines_join_the_means_from_the_smallest_cells_to_the_largest() -> None:
    fig = cells.draw(ORDERED, CELL_M, True, "Cells")
    auc = fig.axes[0]
    assert [axis.get_title(loc="left") for axis in fig.axes] == [title for *_, title in cells.PANELS]
    assert [text.get_text() for text in auc.get_xticklabels()] == ["5 m", "10 m", "20 m"]
    means = {str(line.get_color()): np.asarray(line.get_ydata()) for line in auc.lines}
    assert means[colour("sci")] == pytest.approx([0.5, 0.6, 0.9])
    assert means[colour("m2dp")] == pytest.approx([0.35, np.nan, 0.35], nan_ok=True)
    assert SIMULATED in [text.get_text() for text in fig.findobj(Text)]
    assert {"sci", "m2dp"} == {text.get_text() for text in auc.texts}


def test_tables_have_a_column_a_size_the_best_at_the_largest_above() -> None:
    table = cells.table(ORDERED, CELL_M, "cells", "auc_top1")
    assert table.header == ("method", "5 m", "10 m", "20 m")
    assert table.rows == (
        ("sci", "0.500 ± .141", "0.600 ± .141", "0.900 ± .000"),
        ("m2dp", "0.350 ± .071", "–", "0.350 ± .212"),
    )
    # Five of seven queries are seen; the oracle's cell is wrong for one of the five.
    assert cells.asked_of(ORDERED, CELL_M).rows[0] == ("5 m", "2", "0.714 ± .000", "0.800 ± .000")


def test_a_trend_is_told_where_all_sequences_agree() -> None:
    # sci: .9 − .4 and .9 − .6, .4 on average; m2dp: +.1 and −.1.
    assert cells_findings.trend(ORDERED, CELL_M, *AUC) == (
        "From 5 to 20 m, AUC top-1 by cells rises on every sequence for 1 of 2 methods (`sci` +0.400) and falls on every sequence"
        " for none of 2 methods."
    )
    assert "One size alone" in cells_findings.trend({"5m": EVALUATED["5m"]}, CELL_M, *AUC)
    assert cells_findings.best(ORDERED, CELL_M, *AUC) == (
        "Highest mean AUC top-1 by cells: `sci` at 5 m (0.500), `sci` at 10 m (0.600), `sci` at 20 m (0.900)."
    )


def test_the_section_puts_sizes_in_order_and_says_how_to_compare_them(tmp_path: Path) -> None:
    section = cells.section(tmp_path, "campus", EVALUATED, CELL_M, True, ("artifacts/evaluate",), {"budget": "tiny"})
    section.write(tmp_path)
    again = Section.read(tmp_path)
    assert again.answer[0].startswith("From 5 to 20 m")
    assert again.answer[-1] == "Asked on simulated campus, cells of 5 to 20 m, 2 test sequences, budget `tiny`."
    assert "by distance the queries are the same" in again.prose()
    assert (tmp_path / again.figures[0].path).is_file()
    assert [table.header[1:] for _, table in again.tables[:4]] == [("5 m", "10 m", "20 m")] * 4


def test_a_number_that_is_missing_on_a_sequence_is_left_out() -> None:
    small, large = evaluated("sci", None, 0.6), evaluated("sci", 0.9, 0.7)
    assert cells_findings.differences(small, large, "sci", "cells", "auc_top1") == pytest.approx([0.1])


def test_a_section_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at least one evaluation"):
        cells.section(tmp_path, "campus", {"5m": []}, CELL_M, False, (), {})
