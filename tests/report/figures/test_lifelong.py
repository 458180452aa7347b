"""Figures of learning further days: each number in its cell, a line a strategy, a colour a step."""

from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.colors import to_hex

from pipeline.report.figures import lifelong
from pipeline.studies.colours import PALETTE
from tests.report.figures.made import TRAIN_XY_M, saved_alike, words

STEPS = ["2012-01-15 1/2", "2012-01-15 2/2"]


def test_each_cell_has_its_recall_and_the_first_step_stands_above(tmp_path: Path) -> None:
    values = np.array([[0.9, np.nan], [0.35, 1.0]])
    fig = saved_alike(
        partial(lifelong.matrices, {"a": values, "b": values}, STEPS, STEPS, "Recall"), tmp_path
    )
    first, second = fig.axes
    assert [(text.get_text(), text.get_position()) for text in first.texts] == [
        (".90", (0.5, 0.5)),
        ("–", (1.5, 0.5)),
        (".35", (0.5, 1.5)),
        ("1.00", (1.5, 1.5)),
    ]
    assert [axis.get_title() for axis in (first, second)] == ["a", "b"]
    assert second.get_ylim() == (2.0, 0.0)
    assert [label.get_text() for label in first.get_yticklabels()] == ["1/2", "2/2"]


def test_a_line_joins_means_and_thin_ones_are_seeds(tmp_path: Path) -> None:
    seeds = np.array([[0.5, 0.7], [0.7, np.nan]])
    single = np.array([[0.2, 0.4]])
    numbers = {
        title: {("days", "a"): seeds, ("streets", "b"): single}
        for title in ("recall", "forgetting")
    }
    orders = {"days": ["2012-01-15", "2012-03-17"], "streets": STEPS}
    fig = saved_alike(partial(lifelong.over_steps, orders, numbers, "After each step"), tmp_path)
    lines = [np.asarray(line.get_ydata()).tolist() for line in fig.axes[0].lines]
    assert lines[:1] == [[0.5, 0.7]]
    np.testing.assert_allclose(lines[2], [0.6, 0.7])  # of the finite seeds
    assert [np.asarray(line.get_ydata()).tolist() for line in fig.axes[1].lines] == [[0.2, 0.4]]
    assert [text.get_text() for text in fig.legends[0].get_texts()] == ["a", "b"]
    assert [axis.get_ylabel() for axis in fig.axes] == ["recall", "", "forgetting", ""]


def test_a_query_has_the_colour_of_the_step_that_made_its_place_known(tmp_path: Path) -> None:
    known = (np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 5.0]]), np.array([1, -1, 0]), STEPS)
    fig = saved_alike(
        partial(lifelong.known_places, {"streets": known, "days": known}, TRAIN_XY_M), tmp_path
    )
    shown = [
        (to_hex(one.get_facecolor()[0]).upper(), one.get_offsets().tolist())
        for one in fig.axes[0].collections
    ]
    assert shown == [("#BFBFBF", [[10, 0]]), (PALETTE[0], [[20, 5]]), (PALETTE[1], [[0, 0]])]
    assert {"never: 1", "1/2: 1", "2/2: 1", "training path", "days", "streets"} <= set(words(fig))


def test_places_are_coloured_by_the_age_of_their_newest_view(tmp_path: Path) -> None:
    xy_m = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 5.0]])
    fig = saved_alike(
        partial(lifelong.ages, {"days": (xy_m, np.array([30, 0, 30]))}, TRAIN_XY_M), tmp_path
    )
    newest, oldest = fig.axes[0].collections
    assert np.asarray(newest.get_offsets()).tolist() == [[10, 0]]
    assert np.asarray(oldest.get_offsets()).tolist() == [[0, 0], [20, 5]]
    assert {"0 days: 1", "30 days: 2", "training path"} <= set(words(fig))
