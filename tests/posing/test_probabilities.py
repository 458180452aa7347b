"""Tests of the probabilities of hypotheses: a conditional logit, learned from queries whose true
poses are known."""

import numpy as np
import pytest

from pipeline.posing.probabilities import FEATURES, USUAL, HypothesisModel, learned

FEATURE = np.eye(len(FEATURES))
"""Hypotheses with a value of 1 in one feature each."""


def test_the_hypotheses_of_a_query_share_its_probability() -> None:
    """Scores of ln 2 and ln 1 against the 1 of none: 2, 1 and 1 of 4."""
    model = HypothesisModel((np.log(2), *5 * (0.0,)), 0.0)
    two = np.array([FEATURE[0], 0 * FEATURE[0]])
    assert model.probabilities(two) == pytest.approx([0.5, 0.25])
    assert model.probabilities(np.zeros((0, len(FEATURES)))).shape == (0,)


def drawn(n: int, seed: int = 0) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Queries of two hypotheses, of which the one with .2 more overlap is right; if both have
    little overlap, neither is right."""
    rng = np.random.default_rng(seed)
    features = []
    right = []
    for row in range(n):
        good = 0.5 if row % 3 else 0.25
        overlap = np.array([good, good - 0.2]) + rng.normal(0, 0.03, 2)
        features.append(overlap[:, None] * FEATURE[0])
        right.append(np.array([row % 3 > 0, False]))
    return features, right


def test_the_feature_that_tells_right_from_wrong_is_learned_and_no_weight_is_negative() -> None:
    features, right = drawn(300)
    result = learned(features, right, np.ones(300), HypothesisModel(6 * (0.0,), 0.0))
    assert min(result.weights) >= 0
    assert result.weights[0] > 10
    probability = np.array([result.probabilities(one).max() for one in features])
    assert probability[1::3].min() > 0.5 > probability[::3].max()
    assert probability.mean() == pytest.approx(2 / 3, abs=0.03)  # as many as are right


def test_more_of_a_feature_is_never_worse_even_where_the_evidence_says_so() -> None:
    features, right = drawn(60)
    negated = [-of_query for of_query in features]
    turned = learned(negated, right, np.ones(60), HypothesisModel(6 * (0.0,), 0.0))
    assert turned.weights[0] == 0


def test_without_evidence_probabilities_stay_what_they_were() -> None:
    assert learned([], [], np.zeros(0)) == USUAL
    assert learned([np.zeros((0, len(FEATURES)))], [np.zeros(0, bool)], np.ones(1)) == USUAL


def test_queries_that_count_nothing_teach_nothing() -> None:
    features, right = drawn(60)
    assert np.allclose(learned(features, right, np.zeros(60)).weights, USUAL.weights)
