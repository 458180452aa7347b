"""Maps of outcomes: right counts, right places, and what went wrong in front."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb

from pipeline.evaluation.judgement import FALSE_ALARM, HIT, MISS
from pipeline.report.figures import maps
from tests.report.figures.made import BOTH, ONE, TRAIN_XY_M, words


def test_a_map_counts_and_shows_each_outcome_where_the_query_was_and_its_scale_bar_is_as_long_as_it_says() -> (
    None
):
    fig = maps.outcome_map(ONE[0], TRAIN_XY_M)
    legend = [text.get_text() for text in fig.legends[0].get_texts()]
    counted = ["right 3, 2 accepted", "wrong 2, 2 accepted", "unseen 2, 1 accepted"]
    assert legend == [*counted, "faint: rejected", "training path"]
    shown = [
        (scatter.get_alpha(), scatter.get_offsets().tolist()) for scatter in fig.axes[0].collections
    ]
    faint = [(maps.REJECTED, [[10, 0]]), (maps.REJECTED, [[40, 120]]), (maps.REJECTED, [])]
    assert shown == [
        *faint,
        (1.0, [[0, 0], [40, 0]]),
        (1.0, [[40, 100]]),
        (1.0, [[20, 0], [30, 0]]),
    ]
    assert fig.axes[0].get_aspect() == 1.0
    # The box is 103 m wide; three tenths of it are 30.9 m, and the longest of 1, 2, 5 × 10ᵏ below
    # is 20 m.
    bar = fig.axes[0].lines[-1].get_xdata()
    assert "20 m" in words(fig)
    assert bar[1] - bar[0] == pytest.approx(20.0)


@pytest.mark.parametrize("right", [HIT, MISS])
@pytest.mark.parametrize("wrong_first", [True, False])
def test_a_wrong_answer_lies_above_a_right_one_at_the_same_place(
    right: int, wrong_first: bool
) -> None:
    e = ONE[0].evaluation
    order = slice(None, None, 1 if wrong_first else -1)
    outcome = np.array([FALSE_ALARM, right], np.int8)[order]
    rank = np.array([-1, 0])[order]
    cells = replace(e.cells, outcome=outcome, true_rank=rank, seen=np.ones(2, bool))
    same = replace(e, xy_m=np.full((2, 2), 50.0), judgements=(cells, e.distance))
    fig = maps.outcome_map(replace(ONE[0], evaluation=same), TRAIN_XY_M)
    fig.set_dpi(400)
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    x, y = fig.axes[0].transData.transform((50.0, 50.0)).astype(int)
    pixel = np.asarray(canvas.buffer_rgba())[-y, x, :3] / 255
    assert pixel == pytest.approx(np.array(to_rgb(maps.ANSWERS[maps.WRONG][1])), abs=0.02)


def test_several_models_have_a_row_of_maps_each() -> None:
    fig = maps.montage(BOTH[::-1], TRAIN_XY_M)
    named = [
        (axis.get_title(), [text.get_text() for text in axis.texts if text.get_rotation() == 90])
        for axis in fig.axes
    ]
    assert named == [
        ("2012-02-04, +20 d", ["m2dp"]),
        ("2012-03-17, +62 d", []),
        ("", ["sci"]),
        ("", []),
    ]
    assert [axis.get_subplotspec().rowspan.start for axis in fig.axes] == [0, 0, 1, 1]
