"""Tests of answers with poses: the places, costs and novelties of a ranking in which registered
poses come first."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.grid import Grid
from pipeline.matching.places import Places
from pipeline.matching.ranking import Ranking
from pipeline.posing.answers import OWN_KINDS, PosedQuery, posed
from pipeline.posing.fix import ScanFix
from pipeline.posing.verdict import Judge
from tests.methods.test_sci_ring import KINDS as RING_KINDS
from tests.posing.scene import OVERLAPS, hypothesis

FIXES = [
    ScanFix.of([hypothesis(25, 0.8, yaw_deg=90), hypothesis(45, 0.3)], OVERLAPS),
    ScanFix(),
    ScanFix.of([hypothesis(95, 0.5, yaw_deg=-45)], OVERLAPS),
]
RANKING = Ranking(
    *(
        np.array([[1, 4, 2, 0]] * 3),
        np.array([[0.1, 0.2, 0.3, 0.4]] * 3, np.float32),
        np.arange(24.0).reshape(3, 4, 2),
    ),
    *(np.array([[0.2], [0.9], [0.4]], np.float32), np.full(3, np.nan, np.float32)),
    *(np.array([[7, 8, 9, np.nan]] * 3, np.float32), ("entropy",)),
)
PLACES = Places(Grid(10.0, (0.0, 100.0), (-5.0, 5.0)), np.arange(9))
"""Nine places of ten metres each along x."""


ERROR_PROBABILITIES = np.array([[0.1, 0.05, 0.01], [1.0, 1.0, 1.0], [0.4, 0.3, 0.4]])
"""(query, claim) that the pose is right, that the query is near it, that one of several is
right."""


def queries() -> list[PosedQuery]:
    """The fixes with these error probabilities."""
    judge = Judge(OVERLAPS, OVERLAPS)
    return [
        replace(PosedQuery.of(fix, judge), error_probabilities=row)
        for fix, row in zip(FIXES, ERROR_PROBABILITIES, strict=True)
    ]


def test_registered_places_come_first_in_the_ranking() -> None:
    result = posed(RANKING, queries(), PLACES)
    assert result.places.tolist() == [[2, 4, 1, 0], [1, 4, 2, 0], [-1, 1, 4, 2]]
    assert result.xy_m[0, :2] == pytest.approx(np.array([[25, 0], [45, 0]]))
    assert result.xy_m[1].tolist() == RANKING.xy_m[1].tolist()
    assert (np.diff(result.costs, axis=1) >= 0).all()
    odds = np.exp([3.0, -2.0])
    assert result.costs[0, :2] == pytest.approx(1 - odds / (1 + odds.sum()))
    headings_deg = [[90, 0, 7, np.nan], [7, 8, 9, np.nan], [-45, 7, 8, 9]]
    assert result.heading_deg == pytest.approx(np.array(headings_deg), nan_ok=True)
    assert result.kinds == (*OWN_KINDS, "entropy")
    assert result.novelty == pytest.approx(np.column_stack([ERROR_PROBABILITIES, [0.2, 0.9, 0.4]]))
    assert result.confidence == pytest.approx(1 - ERROR_PROBABILITIES[:, 0])


def test_a_place_that_is_named_twice_is_answered_once() -> None:
    result = posed(replace(RANKING, places=np.array([[1, 1, 2, 2]] * 3)), queries(), PLACES)
    assert result.places[0].tolist() == [2, 4, 1, -1]
    assert result.costs[0, 3] == np.inf
    assert np.isnan(result.xy_m[0, 3]).all()
    assert np.isnan(result.heading_deg[0, 3])


def test_no_novelty_of_the_ring_has_the_name_of_a_claim() -> None:
    """Thresholds are looked up by their kinds."""
    assert set(OWN_KINDS).isdisjoint(RING_KINDS)


def test_a_query_without_a_pose_has_none() -> None:
    assert [bool(np.isfinite(fix.pose).all()) for fix in FIXES] == [True, False, True]
    has_pose = [bool(np.isfinite(query.pose).all()) for query in queries()]
    assert has_pose == [True, False, True]
