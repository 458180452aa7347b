"""Tests that a pose counts once, by its strongest accepted claim, and of its probability."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.evaluation.rows import evaluation_rows, table
from tests.report.figures.made import ONE, POSED


def test_verdicts_count_every_query_once_and_the_most_telling_claim_counts() -> None:
    """Error probabilities of .1, of the place and of several poses, are accepted below .2.

    The third query has only the latter, the sixth has no pose.
    """
    error_probabilities = np.array(
        [[0.1, 0.1], [0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.9, 0.9], [0.1, 0.1], [0.9, 0.1]]
    )
    evaluation = replace(
        POSED[0].evaluation,
        kinds=("fix", "place", "several"),
        novelty=np.column_stack([ONE[0].evaluation.novelty[:, 0], error_probabilities]),
        claims={"place": 0.2, "several": 0.2},
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


def test_the_probability_of_a_pose_stands_against_the_share_that_is_right() -> None:
    """Probabilities .9 .2 .8 .7 .95 .6 .1, of which the first, second, fourth and fifth are right.
    Those of .2 and .1 share a bin, as .2 is a little less in float32: it is .35 off, the others .6
    .3 .8 .1 and .05."""
    evaluation = POSED[0].evaluation
    rows = table(evaluation_rows(evaluation)).set_index("number")["value"]
    assert rows["pose_ece"] == pytest.approx((2 * 0.35 + 0.6 + 0.3 + 0.8 + 0.1 + 0.05) / 7)
