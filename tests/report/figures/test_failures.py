"""Cards of poses whose verdict is wrong: which are chosen, and in which order."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from pipeline.report.figures.failures import misjudged

NOTHING = np.zeros(4, bool)


def result(sequence: str, **believed: list[bool]) -> Any:
    """A result of four answers, the last without a pose; novelties are .1, .2, .3 and 1."""
    masks = dict.fromkeys(("accepted_wrong", "refused", "refused_wrong"), NOTHING)
    masks |= {name: np.array(mask) for name, mask in believed.items()}
    evaluation = SimpleNamespace(
        acceptance=masks,
        pose_error_m=np.array([0.1, 5.0, 0.1, np.nan]),
        novelty=np.array([[0.1], [0.2], [0.3], [1.0]]),
    )
    return SimpleNamespace(sequence=sequence, evaluation=evaluation)


def test_believed_wrong_poses_come_first_then_right_ones_that_were_refused() -> None:
    monday = result("monday", accepted_wrong=[False, True, False, False])
    # the first and the third are right, of the last nothing can be right
    tuesday = result("tuesday", refused=[True, False, True, True])
    assert [
        (failure.result.sequence, failure.query, failure.accepted)
        for failure in misjudged([tuesday, monday])
    ] == [("monday", 1, True), ("tuesday", 2, False), ("tuesday", 0, False)]


def test_where_every_verdict_is_right_there_is_no_card() -> None:
    assert (
        misjudged(
            [
                result(
                    "monday",
                    refused=[False, True, False, True],
                    refused_wrong=[False, True, False, False],
                )
            ]
        )
        == []
    )
