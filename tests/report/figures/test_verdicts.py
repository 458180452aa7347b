"""Figures of poses: every query is drawn once, right or wrong, and the promise is counted."""

from dataclasses import replace

import numpy as np

from pipeline.report.figures import maps, verdicts
from tests.report.figures.made import ONE, TRAIN_XY_M, words

ERROR_M = np.array([0.1, 0.2, 50.0, 1.0, 0.3, np.nan, 80.0])
POSED = [
    replace(
        one,
        evaluation=replace(
            one.evaluation,
            pose_error_m=ERROR_M,
            pose_error_deg=np.where(ERROR_M > 2, 90, 0.5),
            reject_pose_from=0.35,
        ),
    )
    for one in ONE
]
"""Novelties .1 .8 .2 .3 .05 .4 .9: accepted are the first and the third to the fifth, of which the
third is wrong."""


def test_errors_stand_over_the_novelty_and_the_promise_is_counted() -> None:
    fig = verdicts.verdicts(POSED)
    assert len(fig.axes) == 2
    right, wrong = (scatter.get_offsets() for scatter in fig.axes[0].collections)
    np.testing.assert_allclose(right, [[0.1, 0.1], [0.8, 0.2], [0.3, 1.0], [0.05, 0.3]], rtol=1e-6)
    np.testing.assert_allclose(wrong, [[0.2, 50.0], [0.4, verdicts.MOST_M], [0.9, 80.0]], rtol=1e-6)
    assert "1 of 4 accepted are wrong" in words(fig)
    assert POSED[0].posed
    assert not ONE[0].posed


def test_a_map_of_poses_counts_what_was_accepted_and_right() -> None:
    fig = maps.fix_map(POSED[0], TRAIN_XY_M)
    legend = [text.get_text() for text in fig.legends[0].get_texts()]
    assert legend == [
        "right 4, 3 accepted",
        "wrong 3, 1 accepted",
        "faint: rejected",
        "training path",
    ]
