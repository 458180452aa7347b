"""On a map what went wrong lies in front."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb

from pipeline.evaluation.evaluations import FALSE_NEGATIVE, FALSE_POSITIVE, TRUE_POSITIVE
from pipeline.report.figures import maps
from tests.report.figures.made import ONE, TRAIN_XY_M


@pytest.mark.parametrize("right", [TRUE_POSITIVE, FALSE_NEGATIVE])
@pytest.mark.parametrize("wrong_first", [True, False])
def test_a_wrong_answer_lies_above_a_right_one_at_the_same_place(
    right: int, wrong_first: bool
) -> None:
    e = ONE[0].evaluation
    order = slice(None, None, 1 if wrong_first else -1)
    outcome = np.array([FALSE_POSITIVE, right], np.int8)[order]
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
