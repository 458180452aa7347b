"""Which queries are shown beside their answers, and which images beside them (Fig. 7)."""

from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.evaluation.evaluations import FALSE_POSITIVE, TRUE_POSITIVE
from pipeline.report.figures.matches import APART_M, Example, TrainingViews, choose, degrees
from tests.report.figures.made import ONE, TRAIN_PLACES, TRAIN_XY_M


def along(novelty: np.ndarray, days: int = 20, outcome: int = FALSE_POSITIVE) -> Any:
    """A result of seen queries every 10 m of a straight path, all 200 m off or all right."""
    n = len(novelty)
    base = ONE[0].evaluation
    rank = np.full(n, 0 if outcome == TRUE_POSITIVE else -1)
    judged = {
        "seen": np.ones(n, bool),
        "unseen": np.zeros(n, bool),
        "outcome": np.full(n, outcome, np.int8),
        "true_rank": rank,
    }
    wide = replace(
        base,
        judgements=(replace(base.cells, **judged), replace(base.distance, **judged)),
        novelty=novelty.astype(np.float32)[:, None],
        xy_m=np.stack([10.0 * np.arange(n), np.zeros(n)], axis=1),
        turn_deg=np.zeros(n),
    )
    return replace(ONE[0], days=days, sequence=f"day {days}", evaluation=wide)


def shown(examples: list[Example], verdict: str) -> list[tuple[int, int]]:
    return [
        (example.result.days, example.query) for example in examples if example.verdict == verdict
    ]


def test_the_wrong_examples_are_of_least_novelty_and_no_neighbours() -> None:
    # Novelties rise along the path, so the four surest are queries 0 1 2 3; 40 m apart are 0 4 8
    # 12.
    assert shown(choose([along(np.linspace(0.1, 0.4, 30))]), "misplaced") == [
        (20, 0),
        (20, 4),
        (20, 8),
        (20, 12),
    ]


def test_the_wrong_examples_come_from_all_sequences_and_one_spot_is_shown_once() -> None:
    first = along(np.full(6, 0.3))
    second = along(np.full(6, 0.3), days=62)
    second.evaluation.novelty[2] = 0.1
    assert shown(choose([second, first]), "misplaced") == [
        (62, 2)
    ]  # every other lies within 40 m of it
    surest, *others = choose(
        [along(np.linspace(0.2, 0.5, 40), days=62), along(np.linspace(0.1, 0.9, 40))]
    )
    assert (surest.result.days, surest.query, len(others)) == (20, 0, 3)
    for i, one in enumerate(others):
        assert all(
            np.linalg.norm(one.xy_m - other.xy_m) >= APART_M for other in [surest, *others[:i]]
        )


def test_right_examples_are_spread_over_the_year_and_one_is_turned() -> None:
    drives = [
        along(np.array([0.3, 0.1, 0.2]), days, TRUE_POSITIVE) for days in (10, 20, 30, 40, 50)
    ]
    drives[1].evaluation.turn_deg[1] = -170.0
    drives[3].evaluation.turn_deg[0] = 120.0
    # Of three true positives the middle novelty is the third's; they lie within 40 m, so the same
    # spot is shown where there is no other.
    assert shown(choose(drives), "right") == [(10, 2), (30, 2), (50, 2), (20, 1)]


def test_a_query_in_the_next_cell_and_an_accepted_unseen_one_are_named_as_such() -> None:
    examples = choose(ONE[:1])
    assert [(example.verdict, example.query) for example in examples] == [
        *(("right", 0), ("right", 4), ("next cell", 3), ("misplaced", 2), ("unseen", 5))
    ]
    assert (
        examples[0].caption()
        == "right, accepted\n2012-02-04, +20 d\nnovelty 0.100, 1.0 m off\nheading +0° to training"
    )
    assert (
        examples[3].caption()
        == "misplaced, accepted\n2012-02-04, +20 d\nnovelty 0.200, 200 m off\nheading +0° to training"
    )
    assert [degrees(angle) for angle in (-177.4, -0.3, 90)] == ["−177°", "+0°", "+90°"]


def test_an_answer_is_shown_by_the_submap_of_its_place_that_lies_there_and_the_ground_truth_by_the_nearest() -> (
    None
):
    training = TrainingViews(None, TRAIN_PLACES, TRAIN_XY_M)
    assert training.answered(3, TRAIN_XY_M[15:20].mean(axis=0)) == 17  # submaps 15 to 19
    assert [training.answered(3, TRAIN_XY_M[row]) for row in (18, 40)] == [18, 19]
    assert training.answered(-1, TRAIN_XY_M[40]) == 40  # a pose in a cell where training never went
    assert training.nearest(np.array([20.0, 50.0])) == 10  # at 10 · 100/49 = 20.4 m
