"""Figures of poses: every query is drawn once, right or wrong, and the promise is counted."""

from dataclasses import replace

import numpy as np
import pytest

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
    np.testing.assert_allclose(
        wrong, [[0.2, 50.0], [0.4, verdicts.MOST_ERROR_M], [0.9, 80.0]], rtol=1e-6
    )
    assert "1 of 4 accepted are wrong" in words(fig)


def test_a_map_of_poses_counts_what_was_accepted_and_right() -> None:
    fig = maps.fix_map(POSED[0], TRAIN_XY_M)
    legend = [text.get_text() for text in fig.legends[0].get_texts()]
    assert legend == [
        "right 4, 3 accepted",
        "wrong 3, 1 accepted",
        "faint: rejected",
        "training path",
    ]


def test_verdicts_count_every_query_once_and_the_most_telling_belief_counts() -> None:
    """Doubts in the place .1 and in several .1 are believed below .2; the third query has only the
    latter, the sixth no pose."""
    doubts = np.array(
        [[0.1, 0.1], [0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.9, 0.9], [0.1, 0.1], [0.9, 0.1]]
    )
    evaluation = replace(
        POSED[0].evaluation,
        kinds=("fix", "place", "several"),
        novelty=np.column_stack([ONE[0].evaluation.novelty[:, 0], doubts]),
        beliefs={"place": 0.2, "several": 0.2},
        reject_pose_from=0.15,
    )
    assert evaluation.verdicts == {
        "accepted": 2,  # the first and the fifth, whose novelty is below .15
        "near": 1,
        "ambiguous": 2,
        "rejected": 1,
        "no_pose": 1,
    }
    assert ONE[0].evaluation.verdicts == {}


def test_the_chance_of_a_pose_stands_against_the_share_that_is_right() -> None:
    """Chances .9 .2 .8 .7 .95 .6 .1, of which the first, second, fourth and fifth are right. Those of
    .2 and .1 share a bin, as .2 is a little less in float32: it is .35 off, the others .6 .3 .8 .1
    and .05."""
    evaluation = POSED[0].evaluation
    assert evaluation.pose_ece == pytest.approx((2 * 0.35 + 0.6 + 0.3 + 0.8 + 0.1 + 0.05) / 7)
    numbers = {("distance", "pose_ece"): (evaluation.pose_ece, np.nan, np.nan)}
    fig = verdicts.chances([replace(one, numbers=numbers) for one in POSED])
    shown = fig.axes[0].collections[-1].get_offsets()
    bins = [[0.15, 0.5], [0.6, 0], [0.7, 1], [0.8, 0], [0.9, 1], [0.95, 1]]
    np.testing.assert_allclose(shown, bins, atol=1e-6)
    assert "ECE 0.364" in words(fig)
