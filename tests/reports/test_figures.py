"""Figures: the same bytes each time, honest about simulation, naming their protocol, and showing what they were given."""

import hashlib
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text

from pipeline.errors import InputError
from pipeline.reports import examples, maps, matches, novelty, plots, rejection, reliability, response
from pipeline.reports.style import SIMULATED, balanced, colour, name_at_the_end, save
from pipeline.reports.year import year
from tests.reports.made import RESULTS, SWEEP, TRAIN_PLACES, TRAIN_XY_M, bounded, result

METHODS = ("sci", "sci_ring", "scan_context", "scan_context_all", "m2dp", "pointnetvlad", "afl", "pfl", "sad")
ONE = RESULTS[:2]
"""One method on two sequences."""
CURVES = {"loss": np.array([3.0, 2.0, 2.5]), "accuracy": np.array([0.1, 0.4, 0.5])}
CURVES |= {f"held_out_{name}": column for name, column in CURVES.items()}
IMAGES = np.random.default_rng(0).uniform(0, 20, (50, 40, 120)).astype(np.float32)
TRAINING = matches.Training(IMAGES, TRAIN_PLACES, TRAIN_XY_M)
FIGURES: dict[str, Callable[[bool], Figure]] = {
    "precision_recall": lambda simulated: plots.precision_recall(RESULTS, "cells", simulated),
    "year": lambda simulated: year(RESULTS, "2012-01-15", simulated),
    "recall_at": lambda simulated: plots.recall_at(RESULTS, simulated),
    "novelty": lambda simulated: novelty.histograms(ONE, "cells", simulated),
    "rejection": lambda simulated: rejection.rejection(ONE, simulated),
    "reliability": lambda simulated: reliability.diagram(ONE, simulated),
    "matches": lambda simulated: matches.matches(examples.choose(ONE), TRAINING, lambda _: IMAGES, simulated),
    "map": lambda simulated: maps.outcome_map(RESULTS[0], TRAIN_XY_M, simulated),
    "montage": lambda simulated: maps.montage(ONE, TRAIN_XY_M, simulated),
    "history": lambda simulated: plots.history(CURVES, 1, "sci", simulated),
    "sweep": lambda simulated: response.draw(SWEEP.jobs, SWEEP.swept(), simulated),
}


def words(fig: Figure) -> list[str]:
    return [text.get_text() for text in fig.findobj(Text)]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_the_same_file_each_time_it_is_made(name: str, tmp_path: Path) -> None:
    digests = {hashlib.sha256(save(FIGURES[name](True), tmp_path / f"{i}.svg").read_bytes()).hexdigest() for i in (0, 1)}
    assert len(digests) == 1
    assert not re.search(r"<dc:date>", (tmp_path / "0.svg").read_text())


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_of_simulated_data_says_so_and_only_then(name: str) -> None:
    assert SIMULATED in words(FIGURES[name](True))
    assert SIMULATED not in words(FIGURES[name](False))


@pytest.mark.parametrize("name", sorted(FIGURES.keys() - {"matches", "history"}))
def test_a_figure_of_results_names_the_protocol(name: str) -> None:
    assert re.search("by (cells|distance)", " ".join(words(FIGURES[name](False))))


def test_a_figure_is_saved_as_png_when_asked_and_as_nothing_unknown(tmp_path: Path) -> None:
    fig = FIGURES["history"](False)
    assert save(fig, tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match=r"a\.pdf"):
        save(fig, tmp_path / "a.pdf")


def test_the_methods_of_the_design_have_colours_of_their_own() -> None:
    assert len({colour(method) for method in METHODS}) == len(METHODS)


def test_a_method_has_one_colour_in_every_figure() -> None:
    for name in ("precision_recall", "year", "recall_at"):
        lines = {to_hex(line.get_color()).upper() for line in FIGURES[name](False).axes[0].lines}
        assert {colour("sci"), colour("m2dp")} <= lines


@pytest.mark.parametrize(("number", "grid"), [(1, (1, 1)), (5, (1, 5)), (6, (2, 3)), (7, (2, 4)), (10, (2, 5)), (11, (3, 4))])
def test_panels_leave_few_cells_empty(number: int, grid: tuple[int, int]) -> None:
    assert balanced(number, 5) == grid


def test_curves_have_a_panel_a_sequence_each_exact_area_and_one_legend() -> None:
    fig = FIGURES["precision_recall"](False)
    assert [axis.get_title() for axis in fig.axes] == ["2012-02-04, +20 d", "2012-03-17, +62 d"]
    assert {f"{one.number('cells', 'auc_exact_top1'):.3f}" for one in RESULTS} == {"0.731", "0.631"} <= set(words(fig))
    assert [text.get_text() for text in fig.legends[0].get_texts()] == ["sci", "m2dp"]


def test_the_curve_passes_every_novelty_and_the_dot_is_the_models_threshold() -> None:
    # Accepted one by one as novelty rises: right, right, misplaced, misplaced, unseen, right, unseen; 5 are seen.
    precision, recall = plots.exact(RESULTS[0], "cells")
    assert precision == pytest.approx([1, 1, 1, 2 / 3, 2 / 4, 2 / 5, 3 / 6, 3 / 7])
    assert recall == pytest.approx([0, 1 / 5, 2 / 5, 2 / 4, 2 / 3, 2 / 3, 1, 1])
    dots = [line for line in FIGURES["precision_recall"](False).axes[0].lines if line.get_marker() == "o"]
    (dot,) = (line.get_xydata() for line in dots if to_hex(line.get_color()).upper() == colour("sci"))
    assert dot == pytest.approx(np.array([[2 / 3, 2 / 5]]))


def test_by_distance_a_misplaced_query_lowers_recall() -> None:
    # As above, but the second misplaced one is right, 6 m away; recall is of all five seen.
    precision, recall = plots.exact(RESULTS[0], "distance")
    assert precision == pytest.approx([1, 1, 1, 2 / 3, 3 / 4, 3 / 5, 4 / 6, 4 / 7])
    assert recall == pytest.approx([0, 1 / 5, 2 / 5, 2 / 5, 3 / 5, 3 / 5, 4 / 5, 4 / 5])


def test_the_year_places_each_sequence_at_its_days_and_names_the_oracle() -> None:
    fig = FIGURES["year"](False)
    assert [axis.get_ylabel() for axis in fig.axes] == ["AUC, top-1, by cells", "recall@1 by cells", "recall@1 by distance"]
    assert fig.axes[-1].get_xticks().tolist() == [20, 62]
    assert {"2012-02-04", "2012-03-17", "sci", "m2dp", "oracle recall@1"} <= set(words(fig))


def test_the_band_of_the_year_is_the_interval() -> None:
    given = [bounded(one, "cells", "auc_top1", low, 0.9) for one, low in zip(ONE, (0.1, 0.3), strict=True)]
    (band,) = year(given, "2012-01-15", False).axes[0].collections
    corners = {tuple(point) for point in band.get_paths()[0].vertices.round(6).tolist()}
    assert corners == {(20, 0.1), (20, 0.9), (62, 0.3), (62, 0.9)}


def test_recall_among_the_first_n_is_the_mean_over_faint_sequences() -> None:
    fig = FIGURES["recall_at"](False)
    assert [axis.get_title() for axis in fig.axes] == ["by cells", "by distance"]
    thick = [line for line in fig.axes[0].lines if line.get_linewidth() > 1]
    assert len(thick) == 2
    assert thick[0].get_ydata()[:2].tolist() == pytest.approx([0.6, 1.0])  # 3 of 5 seen, then the second answers of two more


def test_histograms_stack_right_and_misplaced_to_an_area_of_one() -> None:
    fig = FIGURES["novelty"](False)
    assert len(fig.axes) == 2
    right, both, unseen = fig.axes[0].patches
    width = np.diff(right.get_data().edges)[0]
    assert right.get_data().values.sum() * width == pytest.approx(3 / 5)
    assert both.get_data().values.sum() * width == pytest.approx(1.0)
    assert unseen.get_data().values.sum() * width == pytest.approx(1.0)
    assert "AUROC 0.900" in words(fig)
    assert fig.axes[0].lines[0].get_xdata()[0] == 0.5  # the model's threshold


def test_rejection_shows_each_kind_beside_the_other_and_the_wanted_precision() -> None:
    fig = FIGURES["rejection"](False)
    legend = [text.get_text() for text in fig.legends[0].get_texts()]
    assert legend == ["entropy (in use)", "energy", "wanted precision 0.9"]
    entropy, energy, wanted = fig.axes[0].lines
    assert entropy.get_ydata().tolist() == pytest.approx([2 / 5, 2 / 5])
    assert energy.get_ydata().tolist() == pytest.approx([3 / 5, 3 / 5])  # it accepts the five seen, three of them right
    assert (entropy.get_xdata() < energy.get_xdata()).all()
    assert wanted.get_ydata()[0] == 0.9


def test_reliability_pools_the_seen_queries_of_all_sequences() -> None:
    raw, scaled = reliability.pooled(ONE)
    assert (raw.name, scaled.name) == ("raw: 1 − cost", "temperature-scaled")
    assert raw.bins.count.sum() == scaled.bins.count.sum() == 10
    # Raw confidences .95 .25 .85 .75 .95, of which the first, second and last are right: |.95−1|·2 + .75 + .85 + .75 over 5.
    assert raw.ece == pytest.approx((0.1 + 0.75 + 0.85 + 0.75) / 5)
    assert f"ECE {raw.ece:.3f}" in words(FIGURES["reliability"](False))


def test_a_method_without_a_confidence_has_no_reliability() -> None:
    without = replace(ONE[0].evaluation, confidence=np.full(7, np.nan, np.float32))
    assert reliability.pooled([replace(ONE[0], evaluation=without)]) == []


def test_a_map_counts_and_draws_each_outcome_where_the_query_was() -> None:
    fig = FIGURES["map"](False)
    legend = [text.get_text() for text in fig.legends[0].get_texts()]
    assert legend == ["hit 2", "miss 1", "false alarm 3", "correct rejection 1", "training path"]
    drawn = [scatter.get_offsets().tolist() for scatter in fig.axes[0].collections]  # hit, correct rejection, miss, false alarm
    assert drawn == [[[0, 0], [40, 0]], [[40, 120]], [[10, 0]], [[20, 0], [30, 0], [40, 100]]]
    assert fig.axes[0].get_aspect() == 1.0


def test_a_map_s_scale_bar_is_as_long_as_it_says() -> None:
    # The box is 103 m wide; three tenths of it are 30.9 m, and the longest of 1, 2, 5 × 10ᵏ below is 20 m.
    fig = FIGURES["map"](False)
    bar = fig.axes[0].lines[-1].get_xdata()
    assert "20 m" in words(fig)
    assert bar[1] - bar[0] == pytest.approx(20.0)


def test_several_methods_have_a_row_of_maps_each() -> None:
    fig = maps.montage(RESULTS[::-1], TRAIN_XY_M, False)
    named = [(axis.get_title(), [text.get_text() for text in axis.texts if text.get_rotation() == 90]) for axis in fig.axes]
    assert named == [("2012-02-04, +20 d", ["m2dp"]), ("2012-03-17, +62 d", []), ("", ["sci"]), ("", [])]
    tops = [round(axis.get_subplotspec().rowspan.start) for axis in fig.axes]
    assert tops == [0, 0, 1, 1]


def test_a_single_kind_of_novelty_is_not_said_to_be_the_one_in_use() -> None:
    fig = rejection.rejection(RESULTS[2:], False)
    assert [text.get_text() for text in fig.legends[0].get_texts()] == ["distance", "wanted precision 0.9"]


def test_names_at_the_end_stand_apart_and_below_the_top() -> None:
    # Four of them crowd at the top, the fifth keeps its place.
    fig = Figure()
    axis = fig.subplots()
    axis.set_ylim(0, 1)
    name_at_the_end(axis, [(str(end), "k", np.array([[0.0, end]])) for end in (0.95, 0.98, 0.2, 1.0, 0.9)], gap=0.1)
    found = {text.get_text(): text.xy[1] for text in axis.texts}
    assert found == pytest.approx({"0.9": 0.7, "0.95": 0.8, "0.98": 0.9, "1.0": 1.0, "0.2": 0.2})


def test_the_history_of_other_curves_has_a_panel_each() -> None:
    fig = plots.history({"loss": np.array([3.0, 2.0]), "held_out_recall": np.array([0.5, 0.75])}, 1, "pointnetvlad", False)
    assert [axis.get_ylabel() for axis in fig.axes] == ["loss", "recall"]
    assert fig.axes[1].lines[0].get_ydata().tolist() == [0.5, 0.75]
    assert fig.axes[1].get_ylim() == (0, 1)


def test_the_history_marks_the_round_that_was_kept() -> None:
    fig = FIGURES["history"](False)
    assert "sci: kept after round 2 of 3" in words(fig)  # 0-based round 1 is the second
    assert [list(line.get_xdata()) for line in fig.axes[0].lines if line.get_marker() == "o"] == [[2]]
    unsaid = plots.history(CURVES, None, "sci", False)
    assert "sci: 3 rounds" in words(unsaid)
    assert [line.get_marker() for line in unsaid.axes[0].lines] == ["", ""]


@pytest.mark.parametrize("draw", [lambda: year([], "2012-01-15", False), lambda: plots.precision_recall([], "cells", False)])
def test_a_figure_of_nothing_is_refused(draw: Callable[[], Figure]) -> None:
    with pytest.raises(InputError, match="at least one result"):
        draw()


def test_a_sequence_that_training_never_saw_and_a_threshold_that_accepts_nothing_can_be_drawn() -> None:
    one = result()
    e = replace(one.evaluation, reject_from=(float(np.finfo(np.float64).min), 0.0))
    nobody = replace(
        e.cells, recall_at=np.full(25, np.nan), interval=np.full_like(e.cells.interval, np.nan), seen=np.zeros(7, bool)
    )
    blank = one.numbers | {"cells": dict.fromkeys(one.numbers["cells"], None)}
    empty = replace(one, evaluation=replace(e, cells=nobody), numbers=blank)
    assert "–" in words(plots.precision_recall([empty], "cells", False))
    assert "AUROC –" in words(novelty.histograms([empty], "cells", False))
    assert not novelty.histograms([empty], "cells", False).axes[0].lines  # the threshold lies beyond all novelties
    assert len(plots.recall_at([empty], False).axes[0].lines) == 0
    assert np.isnan(year([empty], "2012-01-15", False).axes[0].lines[0].get_ydata()).all()
    assert reliability.pooled([empty]) == []
