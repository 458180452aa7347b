"""The localiser after each day: incremental, frozen and joint models, on scenes 2 m apart."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core import store
from pipeline.core.errors import ConfigError
from pipeline.core.grid import Grid
from pipeline.core.progress import Progress
from pipeline.core.schemas import Lifelong
from pipeline.lifelong.steps import line, record, streets, supervised
from pipeline.lifelong.strategies import Frozen, Incremental, Joint
from pipeline.matching.places import Places
from pipeline.matching.ranking import Rows
from pipeline.studies.expansion import courses_of_model
from pipeline.studies.proposal import courses, with_further_days
from pipeline.studies.study import StudyMethod
from tests.methods.test_scan_context import EACH, FIFTY, PLACES, rows
from tests.studies.made import study as made_study

CELL_M = 2.0 * EACH  # four views a cell
GRID = Grid(CELL_M, (-1.0, -1.0 + CELL_M * PLACES), (-5.0, 5.0))
NO_PLACES = Places(GRID, np.empty(0, np.int64))


def part(seed: int, first: int, last: int) -> Rows:
    """The scenes from `first` to `last`."""
    return rows(seed).select(slice(first * EACH, last * EACH))


DAYS = {"first": part(1, 0, 12), "second": part(2, 8, 18)}
QUERIED = {"between": part(3, 0, 12), "later": part(4, 6, 24)}


def recorded(strategy: object) -> Lifelong:
    """The record of a model that learns DAYS by a strategy, and is queried with QUERIED."""
    steps = supervised(FIFTY, strategy, DAYS, NO_PLACES, None, Progress())
    lifelong, cpu_s = record(steps, QUERIED, lambda line: None, "days", "incremental", 15.0)
    assert len(cpu_s) == len(lifelong.steps)
    return lifelong


def shares(found: Lifelong) -> list[list[float]]:
    """The share of right answers to queries known by the end, by step and queried day."""
    known = found.known_from >= 0
    day = found.day
    return [
        [round(float(step[known & (day == one)].mean()), 2) for one in (0, 1)]
        for step in found.right
    ]


def test_a_frozen_database_stays_and_an_incremental_one_equals_the_joint_one() -> None:
    # Of the later day, scenes 6 to 11 are known after the first day, scenes 12 to 17 after the
    # second, and scenes 18 to 23 never.
    frozen, incremental, joint = (
        recorded(strategy) for strategy in (Frozen(), Incremental(), Joint())
    )
    assert shares(frozen) == [[1, 0.5], [1, 0.5]]
    assert shares(incremental) == shares(joint) == [[1, 0.5], [1, 1]]
    assert incremental.steps == ("first", "second")
    assert frozen.places == (12, 18)
    known_from = incremental.known_from[incremental.day == 1][::EACH].tolist()
    assert known_from == [0] * 6 + [1] * 6 + [-1] * 6
    assert incremental.bytes[1] > incremental.bytes[0] == frozen.bytes[1]


def test_the_record_fits_its_schema_and_its_line_says_what_came_out(tmp_path: Path) -> None:
    lifelong = recorded(Incremental())
    store.write(tmp_path / "incremental.zarr", lifelong)
    again = store.read(tmp_path / "incremental.zarr", Lifelong)
    assert again.steps == ("first", "second")
    assert again.attrs == lifelong.attrs
    # 48 queries of the first day and 24 of the second are known after the first step, 24 more
    # after the last: 72 / 96 = .75.
    assert line(lifelong) == (
        "2 steps to 18 places: of 96 queries in learned places 0.750 right after the first step, "
        "1.000 after the last"
    )


def test_the_training_day_is_learned_in_four_parts_of_equal_length() -> None:
    parts = streets("monday", part(1, 0, 10))
    assert [*parts] == ["monday 1/4", "monday 2/4", "monday 3/4", "monday 4/4"]
    # 40 views over 78 m: those at 0 to 18 m, at 20 to 38 m, and so on
    assert [len(views.stamps_ns) for views in parts.values()] == [10] * 4


def test_places_of_a_later_day_follow_the_known_ones_and_the_grid_is_extended() -> None:
    first = NO_PLACES.extended(np.array([[17.0, 0.0], [1.0, 0.0]]))  # cells 2 and 0
    assert first.cells.tolist() == [0, 2]
    # cell 1, and one four cells before the box of the grid
    later = first.extended(np.array([[9.0, 0.0], [-30.0, 0.0]]))
    assert later.at(
        np.array([[1.0, 0.0], [17.0, 0.0], [-30.0, 0.0], [9.0, 0.0], [60.0, 0.0]])
    ).tolist() == [0, 1, 2, 3, -1]
    assert later.grid.shape == (GRID.shape[0] + 5, 1)
    np.testing.assert_allclose(later.grid.centre(later.cells[:2]), GRID.centre(first.cells))


def test_a_study_learns_every_second_day_and_queries_the_others() -> None:
    study = made_study(tests=["a", "b", "c"])
    split = with_further_days(study, {}, "", "")
    assert (split.learned, split.tests) == (("a", "c"), ("b",))
    split = with_further_days(study, {}, "", "b")
    assert (split.learned, split.tests) == (("b",), ("a", "c"))
    with pytest.raises(ConfigError, match="learned=a: expected some of several test sequences"):
        with_further_days(made_study(tests=["a"]), {}, "", "")


def test_only_trained_methods_are_fine_tuned_and_only_studies_with_such_days_self_train() -> None:
    defaults = {
        "courses": {"days": ["incremental"]},
        "trained": {"days": ["incremental", "fine_tuned"], "self_training": ["self_trained"]},
    }
    assert courses(defaults, {}, has_self_training=True) == {"days": ("incremental",)}
    assert courses(defaults, {"replayed": 2}, has_self_training=False) == {
        "days": ("incremental", "fine_tuned")
    }
    found = courses_of_model(
        {"dataset": "campus", "grid": "10m", "model": "m"},
        made_study(tests=["b"], learned=["a"], self_training=["u"]),
        StudyMethod(
            "m", "v", "m.py", courses=courses(defaults, {"replayed": 2}, has_self_training=True)
        ),
    )
    assert {name: one["learned"] for name, one in found.items()} == {
        "campus-10m-m-days-incremental": "a",
        "campus-10m-m-days-fine_tuned": "a",
        "campus-10m-m-self_training-self_trained": "u",
    }
