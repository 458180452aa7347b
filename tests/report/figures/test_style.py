"""All figures: the same bytes each time, honest about simulation, naming their protocol, colours
that mean a model."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.spatial.distance import pdist

from pipeline.core.errors import InputError
from pipeline.report.comparison import AUC, FAR, KEPT, OFF
from pipeline.report.figures import curves, maps, matches, rejection, robustness
from pipeline.report.figures.panels import balanced, name_ends, share_limits
from pipeline.report.figures.style import colour, figure, folded, look, save
from pipeline.studies.colours import PALETTE, marker
from tests.report.figures.made import (
    BOTH,
    BUILT,
    COMPARED,
    NOTHING,
    ONE,
    TRAIN_PLACES,
    TRAIN_XY_M,
    TURNED,
    saved_alike,
    words,
)

XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
LUMINANCE = XYZ[1]
DEUTERANOPIA = np.array(
    [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ]
)
"""Of linear sRGB, at full severity (Machado, Oliveira and Fernandes, 2009)."""
METHODS = (
    "sci",
    "sci_ring",
    "scan_context",
    "scan_context_all",
    "m2dp",
    "pointnetvlad",
    "afl",
    "pfl",
    "sad",
)
LOSSES = {"loss": np.array([3.0, 2.0, 2.5]), "held_out_loss": np.array([3.5, 2.5, 2.7])}
IMAGES = np.random.default_rng(0).uniform(0, 20, (50, 40, 120)).astype(np.float32)
TRAINING = matches.Training(IMAGES, TRAIN_PLACES, TRAIN_XY_M)
SIZES = {
    ("sci", by, name): [np.array([0.5, 0.6]), np.array([0.7])]
    for by in ("cells", "distance")
    for name in (AUC.name, FAR.name)
}
ORACLE = {"cells": (0.8, 0.9), "distance": (1.0, 1.0)}
FIGURES: dict[str, Callable[[], Figure | None]] = {
    "precision_recall": lambda: curves.precision_recall(BOTH, "cells"),
    "year": lambda: curves.year(BOTH, "2012-01-15"),
    "recall_at": lambda: curves.recall_at(BOTH),
    "novelty": lambda: rejection.histograms(ONE, "cells"),
    "rejection": lambda: rejection.rejection(ONE),
    "reliability": lambda: rejection.diagram(ONE),
    "matches": lambda: matches.matches(matches.choose(ONE), TRAINING, lambda _: IMAGES),
    "map": lambda: maps.outcome_map(ONE[0], TRAIN_XY_M),
    "montage": lambda: maps.montage(ONE, TRAIN_XY_M),
    "history": lambda: curves.history(LOSSES, 1, "sci"),
    "cells": lambda: robustness.cells(SIZES, (5.0, 10.0), ORACLE, "The side of a cell"),
    "dots": lambda: robustness.dots(COMPARED, (AUC, KEPT, FAR, OFF), TURNED, "Turned"),
    "sequences": lambda: robustness.sequences(
        COMPARED, dict.fromkeys(COMPARED.sequences, "a"), "Stress"
    ),
    "levels": lambda: robustness.levels(BUILT, "Walls", "walls"),
    "ways": lambda: robustness.ways(COMPARED, TURNED, ["sci_ring"], "Ways"),
}


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_the_same_file_each_time_is_honest_about_simulation_and_names_its_protocol(
    name: str, tmp_path: Path
) -> None:
    shown = words(saved_alike(FIGURES[name], tmp_path))
    assert name in ("matches", "history") or re.search("by (cells|distance)", " ".join(shown))


def test_simulated_stands_above_the_heading_of_a_narrow_figure(tmp_path: Path) -> None:
    wide = figure(7.0, 2.0, "heading")
    narrow = figure(3.0, 2.0, "heading")
    for fig in (wide, narrow):
        fig.add_subplot()
        save(fig, tmp_path / "a.svg", True)
    tops = [[text.get_position()[1] for text in fig.texts] for fig in (wide, narrow)]
    assert tops == [pytest.approx([0.98, 0.98]), pytest.approx([0.98 - 0.17 / 2, 0.98])]


def test_a_figure_is_saved_as_svg_alone(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.pdf: a figure is saved as \.svg"):
        save(curves.history(LOSSES, 1, "sci"), tmp_path / "a.pdf", False)


def test_the_methods_of_the_papers_have_different_colours() -> None:
    assert len({colour(method) for method in METHODS}) == len(METHODS)
    assert len({marker(method) for method in METHODS}) == len(METHODS)


def test_colours_stay_apart_to_a_colour_blind_reader_and_can_be_text() -> None:
    srgb = np.array([[int(one[i : i + 2], 16) / 255 for i in (1, 3, 5)] for one in PALETTE])
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    assert (1.05 / (linear @ LUMINANCE + 0.05)).min() >= 4.5  # WCAG 2.2, against white
    xyz = np.clip(linear @ DEUTERANOPIA.T, 0, 1) @ XYZ.T / (XYZ @ np.ones(3))
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116).T
    lab = np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)
    assert pdist(lab).min() >= 20


def test_a_variant_has_its_methods_colour_darker_and_another_dash() -> None:
    looks = look(["sci-4way", "m2dp", "sci"])
    assert list(looks) == ["sci-4way", "m2dp", "sci"]
    assert looks["sci"] == {"color": colour("sci"), "ls": "-"}
    assert looks["m2dp"] == {"color": colour("m2dp"), "ls": "-"}
    assert looks["sci-4way"]["color"] == "#001A36"  # 0.4 of 00, 40 and 87
    assert looks["sci-4way"]["ls"] != "-"
    assert colour("sci-4way") == colour("sci")


@pytest.mark.parametrize(
    ("number", "grid"),
    [(1, (1, 1)), (5, (1, 5)), (6, (2, 3)), (7, (2, 4)), (10, (2, 5)), (11, (3, 4))],
)
def test_panels_leave_few_cells_empty(number: int, grid: tuple[int, int]) -> None:
    assert balanced(number, 5) == grid


def test_an_axis_of_shares_begins_at_the_tenth_below_and_ends_above_one() -> None:
    assert share_limits([0.47, np.nan], 0.8) == pytest.approx((0.4 - 0.02 * 0.6, 1 + 0.03 * 0.6))
    assert share_limits([np.nan]) == pytest.approx((0.898, 1.003))


def test_names_at_the_end_stand_apart_below_the_top_and_at_the_last_value_there_is() -> None:
    # Four of them crowd at the top; 0.2 keeps its place, though its last value is missing; a line
    # of nothing has no name.
    axis = Figure().subplots()
    axis.set_ylim(0, 1)
    lines = [
        (str(end), "k", np.array([[0.0, end], [1.0, end]]))
        for end in (0.95, 0.98, 0.2, 1.0, 0.9, np.nan)
    ]
    lines[2][2][1, 1] = np.nan
    name_ends(axis, lines, gap=0.1)
    found = {text.get_text(): text.xy[1] for text in axis.texts}
    assert found == pytest.approx({"0.9": 0.7, "0.95": 0.8, "0.98": 0.9, "1.0": 1.0, "0.2": 0.2})


def test_a_long_name_is_folded() -> None:
    assert [folded(name) for name in ("sci", "scan_context_all", "pointnetvlad-4way")] == [
        *("sci", "scan_context\n_all", "pointnetvlad\n-4way")
    ]


@pytest.mark.parametrize(
    "draw", [lambda: curves.year([], "2012-01-15"), lambda: curves.precision_recall([], "cells")]
)
def test_a_figure_of_nothing_is_refused(draw: Callable[[], Figure]) -> None:
    with pytest.raises(InputError, match="at least one result"):
        draw()


def test_a_sequence_that_training_never_saw_can_be_drawn() -> None:
    assert not [
        line
        for line in curves.precision_recall([NOTHING], "cells").axes[0].lines
        if line.get_marker() == marker("sci")
    ]
    histogram = rejection.histograms([NOTHING], "cells")
    assert "AUROC –" in words(histogram)
    assert not histogram.axes[0].lines  # the threshold lies beyond all novelties
    assert not curves.recall_at([NOTHING]).axes[0].lines
    assert np.isnan(curves.year([NOTHING], "2012-01-15").axes[0].lines[0].get_ydata()).all()
    assert rejection.diagram([NOTHING]) is None
