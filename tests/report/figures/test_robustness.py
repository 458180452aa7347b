"""Figures of altered queries and of cells show the means that they are given."""

import numpy as np
import pytest

from pipeline.report.comparison import AUC, KEPT
from pipeline.report.figures import robustness
from pipeline.report.figures.style import colour
from tests.report.figures.made import BUILT, COMPARED, TURNED


def test_dots_stand_at_the_means_the_best_when_turned_above() -> None:
    auc, kept = robustness.dots(COMPARED, (AUC, KEPT), TURNED, "Turned").axes
    # Turned, sci_ring: .9 and .78 of one seed, .85 and .72 of the other, .8125 on average; sci-4way
    # .74; sci .3.
    assert [text.get_text() for text in auc.get_yticklabels()] == ["sci_ring", "sci-4way", "sci"]
    at = {
        (float(line.get_ydata()[0]), line.get_markerfacecolor()): float(line.get_xdata()[0])
        for line in auc.lines
    }
    assert at[0.0, colour("sci_ring")] == pytest.approx(0.8125)
    assert at[2.0, "white"] == pytest.approx(0.8)  # sci, as driven
    assert len(kept.lines) == 4  # turned alone, and the line at 1
    assert auc.get_xlim()[0] < 0.3 - 0.1 * np.sqrt(2)  # no bar is cut


def test_each_sequence_has_its_own_values() -> None:
    fig = robustness.sequences(COMPARED, {"2012-02-04": "first", "2012-06-15": "second"}, "Stress")
    assert [fig.axes[row].get_title(loc="left") for row in (0, 4)] == ["first", "second"]
    four_way = [
        next(line for line in axis.lines if line.get_ydata()[0] == 2)
        for axis in (fig.axes[0], fig.axes[4])
    ]
    assert [float(line.get_xdata()[0]) for line in four_way] == pytest.approx(
        [0.7, 0.8]
    )  # the lowest on average


def test_levels_join_as_driven_and_all_changes_with_and_without_shadow() -> None:
    fig = robustness.levels(BUILT, "Walls", "walls")
    found = {
        i: next(line for line in fig.axes[i].lines if line.get_label() == "sci").get_ydata()
        for i in (1, 3)
    }
    assert found[3] == pytest.approx([0.8, 0.6, 0.3])
    assert found[1] == pytest.approx([1.0, 0.875, 0.75])  # kept, without shadow
    assert {"sci", "m2dp"} == {text.get_text() for text in fig.axes[0].texts}
    assert [fig.axes[i].get_ylabel() for i in (0, 3)] == [
        "what is behind stays in view",
        "what is behind is hidden",
    ]


def test_ways_are_in_order_and_others_are_level() -> None:
    auc = robustness.ways(COMPARED, TURNED, ["sci_ring"], "Ways").axes[0]
    assert [text.get_text() for text in auc.get_xticklabels()] == ["2", "4"]
    shown = [np.asarray(line.get_ydata(), float).tolist() for line in auc.lines]
    assert [
        pytest.approx(line) in shown for line in ([0.3, 0.74], [0.8, 0.75], [0.8125, 0.8125])
    ] == [True] * 3
    assert {"sci as driven", "sci turned", "sci_ring"} == {text.get_text() for text in auc.texts}


def test_cells_join_the_means_of_the_test_sequences_at_each_size() -> None:
    nothing = np.array([np.nan, np.nan])
    values = {
        ("sci", "cells", "auc_top1"): [
            np.array([0.4, 0.6]),
            np.array([0.5, 0.7]),
            np.array([0.9, np.nan]),
        ]
    }
    values["m2dp", "cells", "auc_top1"] = [np.array([0.4, 0.3]), nothing, np.array([0.5, 0.2])]
    fig = robustness.cells(
        values, (5.0, 10.0, 20.0), {"cells": (0.8,) * 3, "distance": (1.0,) * 3}, "Cells"
    )
    auc, recall, *_ = fig.axes
    assert [text.get_text() for text in auc.get_xticklabels()] == ["5 m", "10 m", "20 m"]
    found = {line.get_label(): np.asarray(line.get_ydata()) for line in auc.lines}
    assert found["sci"] == pytest.approx([0.5, 0.6, 0.9])
    assert found["m2dp"] == pytest.approx([0.35, np.nan, 0.35], nan_ok=True)
    assert [text.get_text() for text in recall.texts] == ["oracle"]
