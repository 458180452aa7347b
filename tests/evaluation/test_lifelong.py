"""Tests of recall, forgetting and transfer after each step of learning, worked out by hand."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core import store
from pipeline.core.schemas import Lifelong
from pipeline.evaluation.lifelong import Course, cost_rows, lifelong_rows

RIGHT = np.array([[1, 1, 0, 1, 0, 0], [1, 0, 1, 1, 0, 1], [0, 1, 1, 0, 1, 0]], bool)
KNOWN_FROM = np.array([0, 0, 0, 1, 2, -1])
DAY = np.array([0, 0, 1, 1, 1, 0])
"""Three steps and six queries on two days; the place of the last query is never known."""
COURSE = Course(
    RIGHT,
    KNOWN_FROM,
    DAY,
    ("first", "second"),
    ("a", "b", "c"),
    np.array([[1, 1], [0, 1], [0, 0]], bool),
)


def artifact(path: Path, order: str, steps: list[str]) -> store.Artifact:
    """An artifact: by distance, the third query is right after every step, the first never."""
    error_m = np.where(RIGHT, 15.0, 15.1)
    error_m[:, 2] = 3.0
    error_m[:, 0] = 99.0
    attrs: dict[str, Any] = {
        "correct_m": 15.0,
        "order": order,
        "strategy": "incremental",
        "steps": steps,
        "queried": ["first", "second"],
    }
    attrs |= {
        "places": [3, 4, 5],
        "bytes": [10, 20, 30],
        "counts": [{}, {"queried": 9, "pseudo_labelled": 8}, {"queried": 7, "pseudo_labelled": 0}],
    }
    attrs |= {"learned_ns": [1, 3, 5], "queried_ns": [2, 4]}
    columns = {
        "right": RIGHT,
        "error_m": error_m,
        "known_from": KNOWN_FROM,
        "day": DAY,
        "xy_m": np.zeros((6, 2)),
    }
    columns |= {"place_xy_m": np.zeros((5, 2)), "newest_ns": np.arange(1, 6)}
    with store.draft(path, Lifelong, **attrs) as draft:
        for name, column in columns.items():
            draft.put(name, column)
    return store.read(path, Lifelong)


def test_recall_is_of_the_queries_whose_place_is_known_by_the_step() -> None:
    assert COURSE.matrix.tolist() == [[1.0, 0.0], [0.5, 1.0], [0.5, pytest.approx(2 / 3)]]
    assert COURSE.recall(2, 1, known_by=0) == 1.0  # the third query alone
    assert [COURSE.mean_recall(step) for step in range(3)] == pytest.approx([0.5, 0.75, 7 / 12])
    # Never known: not counted
    assert [COURSE.recall_of_all(step) for step in range(3)] == pytest.approx([3 / 5, 3 / 5, 3 / 5])


def test_forgetting_is_the_most_that_was_lost_of_what_was_known_then() -> None:
    """First day: 1 → .5 → .5, so .5 and .5 are lost.

    Second day, the third query: 0 → 1 → 1, −1 is lost; the fourth besides: 1 after the second step
    and .5 after the third: .5 is lost since then, the most.
    """
    assert [COURSE.forgetting(step) for step in range(3)] == pytest.approx(
        [0.0, (0.5 - 1.0) / 2, (0.5 + 0.5) / 2]
    )


def test_transfer_is_what_was_gained_on_days_still_to_come(tmp_path: Path) -> None:
    """Of the queries known from the first step, only the third is of the second day: it is wrong
    after the first step and right after the others."""
    assert [COURSE.transfer(step) for step in (0, 1)] == [0.0, 1.0]
    assert np.isnan(COURSE.transfer(2))  # no day is still to come
    days = Course.of(artifact(tmp_path / "days.zarr", "days", ["a", "b", "c"]), "cells")
    assert days.later.tolist() == COURSE.later.tolist()
    assert not Course.of(
        artifact(tmp_path / "parts.zarr", "streets", ["a", "b", "c"]), "cells"
    ).later.any()


def test_a_group_without_a_known_place_counts_nowhere() -> None:
    late = Course(
        RIGHT[:2],
        np.array([0, 0, 1, 1, -1, -1]),
        np.array([0, 0, 1, 1, 2, 2]),
        ("x", "y", "z"),
        ("a", "b"),
        np.zeros((2, 3), bool),
    )
    assert np.isnan(late.matrix).tolist() == [[False, True, True], [False, False, True]]
    assert late.mean_recall(0) == 1.0
    assert late.mean_recall(1) == pytest.approx(0.75)
    assert late.forgetting(1) == pytest.approx(0.5)  # of the first group alone
    nothing = Course(RIGHT[:2], np.full(6, -1), DAY, ("x", "y"), ("a", "b"), COURSE.later)
    assert np.isnan([nothing.mean_recall(1), nothing.forgetting(1)]).all()


def test_streets_are_queried_part_by_part(tmp_path: Path) -> None:
    parts = Course.of(artifact(tmp_path / "a.zarr", "streets", ["1/3", "2/3", "3/3"]), "cells")
    assert parts.groups == ("1/3", "2/3", "3/3")
    assert np.array_equal(
        parts.matrix, [[2 / 3, np.nan, np.nan], [2 / 3, 1, np.nan], [2 / 3, 0, 1]], equal_nan=True
    )
    assert parts.forgetting(2) == pytest.approx((0.0 + 1.0) / 2)  # the third part is new


def test_an_answer_is_right_by_distance_nearer_than_15_m(tmp_path: Path) -> None:
    near = Course.of(artifact(tmp_path / "a.zarr", "days", ["a", "b", "c"]), "distance")
    assert near.right[:, 0].tolist() == [False] * 3
    assert near.right[:, 2].tolist() == [True] * 3
    assert np.array_equal(near.right[:, [1, 3, 4]], RIGHT[:, [1, 3, 4]])


def test_rows_say_step_group_and_protocol(tmp_path: Path) -> None:
    rows = list(lifelong_rows(artifact(tmp_path / "a.zarr", "days", ["a", "b", "c"])))
    assert {(one["ask"], one["of"]) for one in rows} == {("course", "days incremental")}
    values = {
        (one["number"], one["protocol"], one["at"], one.get("sequence", "")): one["value"]
        for one in rows
    }
    assert len(values) == len(rows)
    assert values["recall_at_1", "cells", 2.0, "second"] == pytest.approx(2 / 3)
    assert values["forgetting", "cells", 2.0, ""] == pytest.approx(0.5)
    # The second, third and fourth
    assert values["recall_of_all", "distance", 0.0, ""] == pytest.approx(3 / 5)
    assert values["places", "", 1.0, "b"] == 4
    assert values["bytes", "", 2.0, "c"] == 30
    assert values["pseudo_labelled", "", 1.0, "b"] == 8
    assert ("pseudo_labelled", "", 0.0, "a") not in values
    assert {one["at"] for one in rows} == {0.0, 1.0, 2.0}


def test_costs_are_beside_the_numbers_of_their_step() -> None:
    course = {
        "place": {"method": "m", "seed": 1},
        "order": "days",
        "strategy": "fine_tuned",
        "steps": ["a", "b"],
        "cpu_s": [0.5, 7.0],
    }
    rows = list(cost_rows(course))
    assert [(one["sequence"], one["at"], one["number"], one["value"]) for one in rows] == [
        ("a", 0.0, "cpu_s", 0.5),
        ("b", 1.0, "cpu_s", 7.0),
    ]
    assert {(one["method"], one["seed"], one["of"]) for one in rows} == {
        ("m", 1, "days fine_tuned")
    }
    with pytest.raises(ValueError, match="shorter"):
        list(cost_rows({**course, "cpu_s": [0.5]}))
