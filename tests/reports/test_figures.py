"""Figures: the same bytes each time, honest about simulation, and showing what they were given."""

import hashlib
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text

from pipeline.errors import InputError
from pipeline.evaluation.judgement import judge, summary
from pipeline.reports import maps, plots
from pipeline.reports.result import Result
from pipeline.reports.style import SIMULATED, colour, save

TRAIN_XY_M = np.stack([np.linspace(0, 100, 50), np.zeros(50)], axis=1)
METHODS = ("sci", "sci_ring", "scan_context", "m2dp", "pointnetvlad", "afl", "pfl", "sad")


def result(method: str = "sci", sequence: str = "2012-02-04", days: int = 20) -> Result:
    """Four queries 10 m apart: a hit, a miss, a false alarm and a correct rejection."""
    world_T_anchor = np.tile(np.eye(4), (4, 1, 1))
    world_T_anchor[:, 0, 3] = [0.0, 10.0, 20.0, 30.0]
    judgement = judge(
        places=np.array([[1], [2], [9], [4]]),
        answers_xy_m=np.zeros((4, 1, 2)),
        novelty=np.array([0.1, 0.8, 0.2, 0.9], np.float32),
        true_places=np.array([1, 2, 3, -1]),
        world_T_anchor=world_T_anchor,
        oracle=np.array([1, 2, 3, 4]),
        turn_deg=np.zeros(4),
        threshold=0.5,
    )
    return Result(method, sequence, summary(judgement, 0.5, days), judgement)


RESULTS = [result(), result(sequence="2012-03-17", days=62), result("m2dp"), result("m2dp", "2012-03-17", 62)]
LOSS = np.array([3.0, 2.0, 2.5])
FIGURES: dict[str, Callable[[bool], Figure]] = {
    "precision_recall": lambda simulated: plots.precision_recall(RESULTS, simulated),
    "year": lambda simulated: plots.year(RESULTS, "2012-01-15", simulated),
    "map": lambda simulated: maps.outcome_map(RESULTS[0], TRAIN_XY_M, simulated),
    "montage": lambda simulated: maps.montage(RESULTS[:2], TRAIN_XY_M, simulated),
    "history": lambda simulated: plots.history(LOSS, LOSS / 4, LOSS, LOSS / 4, 1, "sci", simulated),
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


def test_a_figure_is_saved_as_png_when_asked_and_as_nothing_unknown(tmp_path: Path) -> None:
    fig = FIGURES["history"](False)
    assert save(fig, tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match=r"a\.pdf"):
        save(fig, tmp_path / "a.pdf")


def test_the_methods_of_the_design_have_colours_of_their_own() -> None:
    assert len({colour(method) for method in METHODS}) == len(METHODS)


def test_a_method_has_one_colour_in_every_figure() -> None:
    for name in ("precision_recall", "year"):
        lines = {to_hex(line.get_color()).upper() for line in FIGURES[name](False).axes[0].lines}
        assert {colour("sci"), colour("m2dp")} <= lines


def test_curves_have_a_panel_a_sequence_and_name_each_method_with_its_area() -> None:
    fig = FIGURES["precision_recall"](False)
    assert [axis.get_title() for axis in fig.axes] == ["2012-02-04, +20 d", "2012-03-17, +62 d"]
    assert f"sci {RESULTS[0].judgement.auc[0]:.3f}" in words(fig)


def test_the_year_places_each_sequence_at_its_days_and_names_the_oracle() -> None:
    fig = FIGURES["year"](False)
    assert fig.axes[0].get_xticks().tolist() == [20, 62]
    assert {"2012-02-04", "2012-03-17", "sci", "m2dp", "oracle top-1"} <= set(words(fig))


def test_a_map_counts_and_draws_each_outcome_where_the_query_was() -> None:
    fig = FIGURES["map"](False)
    legend = [text.get_text() for text in fig.legends[0].get_texts()]
    assert legend == ["hit 1", "miss 1", "false alarm 1", "correct rejection 1", "training path"]
    drawn = [scatter.get_offsets().tolist() for scatter in fig.axes[0].collections]  # hit, correct rejection, miss, false alarm
    assert drawn == [[[0.0, 0.0]], [[30.0, 0.0]], [[10.0, 0.0]], [[20.0, 0.0]]]
    assert fig.axes[0].get_aspect() == 1.0


def test_a_map_s_scale_bar_is_as_long_as_it_says() -> None:
    # The box is 103 m wide; three tenths of it are 30.9 m, and the longest of 1, 2, 5 × 10ᵏ below is 20 m.
    fig = FIGURES["map"](False)
    bar = fig.axes[0].lines[-1].get_xdata()
    assert "20 m" in words(fig)
    assert bar[1] - bar[0] == pytest.approx(20.0)


def test_the_history_marks_the_epoch_that_was_kept() -> None:
    fig = FIGURES["history"](False)
    assert fig.axes[0].get_title(loc="left") == "sci: kept after epoch 2 of 3"  # 0-based epoch 1 is the second
    assert [list(line.get_xdata()) for line in fig.axes[0].lines if line.get_marker() == "o"] == [[2]]


def test_a_figure_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="at least one result"):
        plots.year([], "2012-01-15", False)
