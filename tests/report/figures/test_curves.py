"""Curves, the year, novelty, rejection and reliability show what they are given."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex

from pipeline.report.figures import curves, rejection
from pipeline.report.figures.style import colour
from pipeline.studies.colours import marker
from tests.report.figures.made import BOTH, ONE, bounded, words


def test_curves_have_a_panel_a_sequence_one_legend_and_a_dot_at_the_models_threshold() -> None:
    fig = curves.precision_recall(BOTH, "cells")
    assert [axis.get_title() for axis in fig.axes] == ["2012-02-04, +20 d", "2012-03-17, +62 d"]
    assert [text.get_text() for text in fig.legends[0].get_texts()] == ["sci", "m2dp"]
    dots = [line for line in fig.axes[0].lines if line.get_marker() == marker("sci")]
    (dot,) = (
        line.get_xydata() for line in dots if to_hex(line.get_color()).upper() == colour("sci")
    )
    assert dot == pytest.approx(np.array([[2 / 3, 2 / 5]]))


def test_the_exact_curve_passes_every_novelty_and_by_distance_a_misplaced_query_lowers_recall() -> (
    None
):
    # Accepted one by one as novelty rises: right, right, misplaced, misplaced, unseen, right,
    # unseen; 5 are seen.
    precision, recall = ONE[0].evaluation.exact_curve("cells")
    assert precision == pytest.approx([1, 1, 1, 2 / 3, 2 / 4, 2 / 5, 3 / 6, 3 / 7])
    assert recall == pytest.approx([0, 1 / 5, 2 / 5, 2 / 4, 2 / 3, 2 / 3, 1, 1])
    # By distance the second misplaced one is right, 6 m away; recall is of all five seen.
    precision, recall = ONE[0].evaluation.exact_curve("distance")
    assert precision == pytest.approx([1, 1, 1, 2 / 3, 3 / 4, 3 / 5, 4 / 6, 4 / 7])
    assert recall == pytest.approx([0, 1 / 5, 2 / 5, 2 / 5, 3 / 5, 3 / 5, 4 / 5, 4 / 5])


def test_recall_among_the_first_n_is_the_mean_over_faint_sequences() -> None:
    fig = curves.recall_at(BOTH)
    assert [axis.get_title() for axis in fig.axes] == ["by cells", "by distance"]
    thick = [line for line in fig.axes[0].lines if line.get_linewidth() > 1]
    assert len(thick) == 2
    assert thick[0].get_ydata()[:2].tolist() == pytest.approx(
        [0.6, 1.0]
    )  # 3 of 5 seen, then the second answers of two more


def test_the_history_has_a_panel_a_curve_and_marks_the_round_that_was_kept() -> None:
    losses = {"loss": np.array([3.0, 2.0, 2.5]), "held_out_recall": np.array([0.1, 0.4, 0.5])}
    fig = curves.history(losses, 1, "sci")
    assert "sci: kept after round 2 of 3" in words(fig)  # round 1, counted from 0, is the second
    assert [axis.get_ylabel() for axis in fig.axes] == ["loss", "recall"]
    assert fig.axes[1].get_ylim() == (0, 1)
    assert [
        line.get_xydata().tolist() for line in fig.axes[1].lines if line.get_marker() == "o"
    ] == [[[2, 0.4]]]
    unknown = curves.history(losses, None, "sci")
    assert "sci: 3 rounds" in words(unknown)
    assert [line.get_marker() for line in unknown.axes[0].lines] == [""]


def test_the_year_places_each_sequence_at_its_days_with_its_interval_as_a_band_and_names_the_oracle() -> (
    None
):
    fig = curves.year(
        [bounded(one, low, 0.9) for one, low in zip(ONE, (0.1, 0.3), strict=True)], "2012-01-15"
    )
    assert [axis.get_ylabel() for axis in fig.axes] == [
        "AUC top-1 by cells",
        "recall@1 by cells",
        "recall@1 by distance",
    ]
    areas = curves.year(ONE, "2012-01-15", curves.FIGURE_8)
    assert [axis.get_ylabel() for axis in areas.axes] == [
        "AUC top-1 by cells",
        "AUC top-5 by cells",
        "AUC top-25 by cells",
    ]
    assert fig.axes[-1].get_xticks().tolist() == [20, 62]
    assert {"2012-02-04", "2012-03-17", "sci", "oracle recall@1"} <= set(words(fig))
    (band,) = fig.axes[0].collections
    corners = {tuple(point) for point in band.get_paths()[0].vertices.round(6).tolist()}
    assert corners == {(20, 0.1), (20, 0.9), (62, 0.3), (62, 0.9)}


def test_histograms_stack_right_and_misplaced_to_an_area_of_one() -> None:
    fig = rejection.histograms(ONE, "cells")
    right, both, unseen = fig.axes[0].patches
    width = np.diff(right.get_data().edges)[0]
    areas = [step.get_data().values.sum() * width for step in (right, both, unseen)]
    assert areas == pytest.approx([3 / 5, 1.0, 1.0])
    assert "AUROC 0.900" in words(fig)
    assert fig.axes[0].lines[0].get_xdata()[0] == 0.5  # the model's threshold


def test_rejection_shows_each_kind_beside_the_other_and_the_wanted_precision() -> None:
    fig = rejection.rejection(ONE)
    assert [text.get_text() for text in fig.legends[0].get_texts()] == [
        "entropy (in use)",
        "energy",
        "wanted precision 0.9",
    ]
    entropy, energy, wanted = fig.axes[0].lines
    assert entropy.get_ydata().tolist() == pytest.approx([2 / 5, 2 / 5])
    assert energy.get_ydata().tolist() == pytest.approx(
        [3 / 5, 3 / 5]
    )  # it accepts the five seen, three of them right
    assert (entropy.get_xdata() < energy.get_xdata()).all()
    assert wanted.get_ydata()[0] == 0.9
    single = [replace(one, evaluation=replace(one.evaluation, kinds=("distance",))) for one in ONE]
    assert rejection.rejection(single).legends[0].get_texts()[0].get_text() == "distance"


def test_reliability_pools_the_seen_queries_of_all_sequences() -> None:
    (name, bins, error), (other, scaled, _) = rejection.confidences(ONE)
    assert (name, other) == ("raw: 1 − cost", "temperature-scaled")
    assert bins.count.sum() == scaled.count.sum() == 10
    # Raw confidences .95 .25 .85 .75 .95, of which the first, second and last are right: |.95−1|·2
    # + .75 + .85 + .75 over 5.
    assert error == pytest.approx((0.1 + 0.75 + 0.85 + 0.75) / 5)
    fig = rejection.diagram(ONE)
    assert fig is not None
    assert f"ECE {error:.3f}" in words(fig)
    without = replace(ONE[0].evaluation, confidence=np.full(7, np.nan, np.float32))
    assert rejection.confidences([replace(ONE[0], evaluation=without)]) == []
