"""Answers to altered queries, judged as those to the queries that were driven."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pipeline.evaluation.robustness import Robustness, judge

from pipeline import schemas, store
from pipeline.alterations import Case
from pipeline.errors import ArtifactError
from pipeline.evaluation.judgement import summary
from pipeline.evaluation.protocols import Distance
from pipeline.views.altered import turns
from tests.evaluation.test_judgement import LABELS, RANKING, XY_M, drive, poses

TURNED = Case("turned", repeat=1)
LEFT_DEG = np.array([30.0, -90.0, 180.0, 0.0, 10.0])


def judged() -> Robustness:
    """As driven, and with every robot turned, whose told headings turn with it and whose first answers get worse."""
    driven = poses(XY_M)
    told_deg = 180 - (180 - RANKING.heading_deg - LEFT_DEG) % 360
    worse = replace(RANKING, places=RANKING.places[:, ::-1].copy(), heading_deg=told_deg.astype(np.float32))
    rankings = {Case(): RANKING, TURNED: worse}
    stood = [driven, driven @ turns(np.deg2rad(LEFT_DEG))]
    return judge(rankings, stood, (0.5, 4.5), LABELS, driven, 20, Distance(), "sci")


def test_as_driven_the_numbers_are_those_of_an_evaluation() -> None:
    one, numbers = judged(), summary(drive())
    for protocol in ("cells", "distance"):
        for name in ("recall_at_1", "auc_top1", "auroc", "median_error_m", "median_heading_error_deg", "recall_at_1_turned"):
            value = numbers[protocol][name]
            assert one.number(0, protocol, name) == pytest.approx(np.nan if value is None else value, nan_ok=True)


def test_a_case_has_answers_and_numbers_of_its_own() -> None:
    one = judged()
    # by cells three of the four seen are right as driven: 7, 8 and 3, the third at second rank; turned, the third alone
    assert (one.number(0, "cells", "recall_at_1"), one.number(1, "cells", "recall_at_1")) == (0.75, 0.25)
    assert one.right[:, 0].tolist() == [[True, True, False, True, False], [False, False, True, False, False]]
    assert one.answer[1].tolist() == [1, 1, 9, 1, 1]


def test_a_turned_robot_is_judged_by_its_own_heading() -> None:
    one = judged()
    np.testing.assert_allclose(one.turned_deg[1], [30, -90, 180, 0, 10], atol=1e-4)
    np.testing.assert_allclose(one.heading_error_deg[1], one.heading_error_deg[0], atol=1e-4)
    # against the nearest training pose the second is now turned by 180 − 90, the third by −45 + 180, the fourth by 46 as before;
    # of them the third alone is right
    assert one.number(1, "cells", "recall_at_1_turned") == pytest.approx(1 / 3)


def test_cases_are_found_by_what_was_done() -> None:
    cases = (Case(), Case("construction", 1.0), Case("construction", 2.0), Case("construction", 2.0, shadow=True))
    one = replace(judged(), cases=cases)
    assert one.of("construction") == [1, 2, 3]
    assert one.of("construction", 2.0) == [2, 3]
    assert one.of("construction", 2.0, shadow=True) == [3]


def test_it_comes_back_from_its_artifact(tmp_path: Path) -> None:
    one, path = judged(), tmp_path / "one.zarr"
    with store.write(path, schemas.ROBUSTNESS, **one.attrs()) as out:
        for name in schemas.ROBUSTNESS.columns:
            out.put(name, getattr(one, name))
    back = Robustness.read(store.read(path, schemas.ROBUSTNESS))
    assert (back.cases, back.days, back.model) == (one.cases, 20, "sci")
    np.testing.assert_array_equal(back.numbers, one.numbers)
    with store.write(path, schemas.ROBUSTNESS, **{**one.attrs(), "numbers": ["other"]}) as out:
        for name in schemas.ROBUSTNESS.columns:
            out.put(name, getattr(one, name))
    with pytest.raises(ArtifactError, match="its numbers are not today's"):
        Robustness.read(store.read(path, schemas.ROBUSTNESS))


def test_what_is_told_is_valid_json_and_names_its_case() -> None:
    first, turned = judged().told()
    assert turned["case"] == {"change": "turned", "level": TURNED.level, "repeat": 1, "shadow": False}
    assert first["cells"]["recall_at_1"] == 0.75
    nothing = replace(judged(), numbers=np.full_like(judged().numbers, np.nan)).told()
    assert set(nothing[0]["distance"].values()) == {None}
