"""Answers with poses: places, costs and novelties of a ranking led by what was registered, and the chance of a fix."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.grid import Grid
from pipeline.matching.places import Places
from pipeline.matching.ranking import Ranking
from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.posing.answers import OWN_KINDS, posed
from pipeline.posing.fix import Fix, poses
from pipeline.posing.verdict import Evidence, Verdict, features
from tests.methods.test_sci_ring import KINDS as RING_KINDS
from tests.posing.scene import hypothesis

FIXES = [
    Fix.of([hypothesis(25, 0.8, 0.01, yaw_deg=90), hypothesis(45, 0.3, 0.02)]),
    Fix(),
    Fix.of([hypothesis(95, 0.5, 0.1, yaw_deg=-45)]),
]
RANKING = Ranking(
    *(np.array([[1, 4, 2, 0]] * 3), np.array([[0.1, 0.2, 0.3, 0.4]] * 3, np.float32), np.arange(24.0).reshape(3, 4, 2)),
    *(np.array([[0.2], [0.9], [0.4]], np.float32), np.full(3, np.nan, np.float32)),
    *(np.array([[7, 8, 9, np.nan]] * 3, np.float32), ("entropy",)),
)
PLACES = Places(Grid(10.0, (0.0, 100.0), (-5.0, 5.0)), np.arange(9))
"""Ten metres a place along x; there are nine."""


def test_registered_places_lead_the_ranking() -> None:
    found = posed(RANKING, FIXES, PLACES, np.array([0.9, 0.0, 0.6]))
    assert found.places.tolist() == [[2, 4, 1, 0], [1, 4, 2, 0], [-1, 1, 4, 2]]
    assert found.xy_m[0, :2] == pytest.approx(np.array([[25, 0], [45, 0]]))
    assert found.xy_m[1].tolist() == RANKING.xy_m[1].tolist()
    assert (np.diff(found.costs, axis=1) >= 0).all()
    assert found.costs[0, :2] == pytest.approx(np.array([0.01, 0.02]))
    headings_deg = [[90, 0, 7, np.nan], [7, 8, 9, np.nan], [-45, 7, 8, 9]]
    assert found.heading_deg == pytest.approx(np.array(headings_deg), nan_ok=True)
    assert found.kinds == (*OWN_KINDS, "entropy")
    assert found.novelty == pytest.approx(np.array([[0.1, 0.2, 0.2], [1.0, 1.0, 0.9], [0.4, 0.5, 0.4]]))
    assert found.confidence == pytest.approx(np.array([0.9, 0.0, 0.6]))


def test_a_place_that_is_named_twice_is_answered_once() -> None:
    found = posed(replace(RANKING, places=np.array([[1, 1, 2, 2]] * 3)), FIXES, PLACES, np.array([0.9, 0.0, 0.6]))
    assert found.places[0].tolist() == [2, 4, 1, -1]
    assert found.costs[0, 3] == np.inf
    assert np.isnan(found.xy_m[0, 3]).all()
    assert np.isnan(found.heading_deg[0, 3])


def test_no_novelty_of_the_ring_is_called_as_one_of_a_fix() -> None:
    """Thresholds are looked up by their kinds."""
    assert set(OWN_KINDS).isdisjoint(RING_KINDS)


def test_a_query_without_a_pose_has_none() -> None:
    assert np.isfinite(poses(FIXES)).all(axis=(1, 2)).tolist() == [True, False, True]
    assert features(FIXES) == pytest.approx(np.array([[0.8, 1, -2], [0, 0, 0], [0.5, 1, -1]]))


def evidence(n: int = 60) -> Evidence:
    """Right fixes overlap by .7 or so, wrong ones by .3; with their surroundings left out all are wrong."""
    rng = np.random.default_rng(0)
    overlap = np.r_[rng.normal(0.7, 0.08, n), rng.normal(0.3, 0.08, n)]
    return Evidence(np.column_stack([overlap, overlap - 0.2, np.full(2 * n, -2.0), rng.random(2 * n)]), np.arange(2 * n) < n)


def test_the_chance_of_a_fix_follows_what_speaks_for_it() -> None:
    verdict = Verdict(evidence(), unseen_share=0.2)
    asked = np.array([[0.8, 0.6, -2, 0.5], [0.5, 0.3, -2, 0.5], [0.2, 0.0, -2, 0.5], [0.0, 0.0, 0.0, 0.5]])
    chance = verdict.chance(asked)
    assert (np.diff(chance) < 0).all()
    assert chance[0] > 0.95
    assert chance[3] == 0.0


def test_a_promise_is_kept_even_if_one_more_were_wrong_or_nothing_is_accepted() -> None:
    known = evidence(200)
    verdict, novelty = Verdict(known, unseen_share=0.2), 1 - known.features[:, 0]
    thresholds = [verdict.threshold(novelty, promise) for promise in (0.9, 0.95, 0.99)]
    assert thresholds == sorted(thresholds, reverse=True)
    for promise, threshold in zip((0.9, 0.95, 0.99), thresholds, strict=True):
        accepted = (novelty < threshold) * verdict.weight
        assert accepted @ known.right >= promise * (accepted.sum() + 1)
    assert verdict.threshold(novelty, 0.999) == ACCEPT_NOTHING  # 999 right ones would be needed


@pytest.mark.parametrize("n", [0, 60])
def test_evidence_without_a_right_fix_accepts_nothing(n: int) -> None:
    known = evidence(n)
    hopeless = Verdict(Evidence(known.features, np.zeros(2 * n, bool)), 0.2)
    assert hopeless.threshold(1 - known.features[:, 0], 0.9) == ACCEPT_NOTHING
    assert hopeless.chance(np.ones((3, 4))).tolist() == [0, 0, 0]


def test_where_all_held_out_fixes_were_right_a_query_without_a_pose_is_not() -> None:
    known = evidence(10)
    sure = Verdict(Evidence(known.features, np.ones(20, bool)), 0.2)
    asked = np.array([[0.8, 0.6, -2, 0.5], [0.0, 0.0, 0.0, 0.5]])
    assert sure.chance(asked).tolist() == [1, 0]
    assert sure.chances.of(FIXES).tolist() == [1, 0, 1]
    assert np.isfinite(sure.chances.offset)  # a site's json holds no infinity
