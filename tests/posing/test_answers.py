"""Answers with poses: places, costs and novelties of a ranking led by what was registered, and the chance of a fix."""

import numpy as np
import pytest

from pipeline.matching.ranking import Ranking
from pipeline.matching.rejection import ACCEPT_NOTHING
from pipeline.posing.answers import OWN_KINDS, Signs, posed, poses
from pipeline.posing.fix import Fix, Hypothesis
from pipeline.posing.verdict import Evidence, Verdict
from tests.posing.scene import planar

FIXES = [
    Fix.of([Hypothesis(0, planar(25, 0, 90), 0.8, 0.9, 0.01), Hypothesis(3, planar(45, 0, 0), 0.3, 0.3, 0.02)]),
    Fix(),
    Fix.of([Hypothesis(1, planar(95, 0, -45), 0.5, 0.7, 0.01)]),
]
RANKING = Ranking(
    *(np.array([[1, 4, 2, 0]] * 3), np.array([[0.1, 0.2, 0.3, 0.4]] * 3, np.float32), np.arange(24.0).reshape(3, 4, 2)),
    *(np.array([[0.2], [0.9], [0.4]], np.float32), np.full(3, np.nan, np.float32), np.full(3, np.nan, np.float32), ("entropy",)),
)


def places(xy_m: np.ndarray) -> np.ndarray:
    """Ten metres a place; there are nine."""
    found = (xy_m[:, 0] // 10).astype(np.int64)
    return np.where(found < 9, found, -1)


def test_registered_places_lead_the_ranking() -> None:
    found = posed(RANKING, FIXES, places, np.array([0.9, 0.0, 0.6]))
    assert found.places.tolist() == [[2, 4, 1, 0], [1, 4, 2, 0], [-1, 1, 4, 2]]
    assert found.xy_m[0, :2] == pytest.approx(np.array([[25, 0], [45, 0]]))
    assert found.xy_m[1].tolist() == RANKING.xy_m[1].tolist()
    assert (np.diff(found.costs, axis=1) >= 0).all()
    assert found.heading_deg == pytest.approx(np.array([90, np.nan, -45]), nan_ok=True)
    assert found.kinds == (*OWN_KINDS, "entropy")
    assert found.novelty == pytest.approx(np.array([[0.1, 0.2, 0.2], [1.0, 1.0, 0.9], [0.4, 0.5, 0.4]]))
    assert found.confidence == pytest.approx(np.array([0.9, 0.0, 0.6]))


def test_a_query_without_a_pose_has_none() -> None:
    assert np.isfinite(poses(FIXES)).all(axis=(1, 2)).tolist() == [True, False, True]
    assert np.isfinite(Signs.of(FIXES, 5.0, RANKING).features()).all()


def evidence(n: int = 60) -> Evidence:
    """Right fixes overlap by .7 or so, wrong ones by .3; with their surroundings left out all are wrong."""
    rng = np.random.default_rng(0)
    overlap = np.r_[rng.normal(0.7, 0.08, n), rng.normal(0.3, 0.08, n)]
    features = np.column_stack([overlap, overlap - 0.2, np.full(2 * n, -2.0), rng.random(2 * n)])
    return Evidence(features, np.arange(2 * n) < n, n)


def test_the_chance_of_a_fix_follows_what_speaks_for_it() -> None:
    verdict = Verdict(evidence(), unseen_share=0.2)
    asked = np.array([[0.8, 0.6, -2, 0.5], [0.5, 0.3, -2, 0.5], [0.2, 0.0, -2, 0.5], [0.0, 0.0, 0.0, 0.5]])
    chance = verdict.chance(asked)
    assert (np.diff(chance) < 0).all()
    assert chance[0] > 0.95
    assert chance[3] == 0.0


def test_a_promise_is_kept_on_the_evidence_or_nothing_is_accepted() -> None:
    known = evidence()
    verdict, novelty = Verdict(known, unseen_share=0.2), 1 - known.features[:, 0]
    weight = known.weight(0.2)
    thresholds = verdict.thresholds(novelty, (0.95, 0.99, 0.999))
    assert thresholds == sorted(thresholds, reverse=True)
    for promise, threshold in zip((0.95, 0.99, 0.999), thresholds, strict=True):
        accepted = novelty < threshold
        assert np.average(known.right[accepted], weights=weight[accepted]) >= promise
    hopeless = Verdict(Evidence(known.features, np.zeros(120, bool), 60), 0.2)
    assert hopeless.thresholds(novelty, (0.95,)) == [ACCEPT_NOTHING]
    assert hopeless.chance(known.features).tolist() == known.features[:, 0].tolist()
