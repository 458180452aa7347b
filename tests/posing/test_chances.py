"""Tests of the chances of hypotheses: they are shares by their signs, learned from queries whose
poses are known."""

import numpy as np
import pytest

from pipeline.posing.chances import SIGNS, USUAL, Chances, learned

SIGN = np.eye(len(SIGNS))
"""One of each sign, nothing else."""


def test_the_hypotheses_of_a_query_share_its_chance() -> None:
    """Scores of ln 2 and ln 1 against the 1 of none: 2, 1 and 1 of 4."""
    chances = Chances((np.log(2), *5 * (0.0,)), 0.0)
    assert chances.of(np.array([SIGN[0], 0 * SIGN[0]])) == pytest.approx([0.5, 0.25])
    assert chances.of(np.zeros((0, len(SIGNS)))).shape == (0,)


def drawn(n: int, seed: int = 0) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Queries of two hypotheses, of which the one with .2 more overlap is right; where both have
    little, neither is."""
    rng = np.random.default_rng(seed)
    signs = []
    right = []
    for row in range(n):
        good = 0.5 if row % 3 else 0.25
        overlap = np.array([good, good - 0.2]) + rng.normal(0, 0.03, 2)
        signs.append(overlap[:, None] * SIGN[0])
        right.append(np.array([row % 3 > 0, False]))
    return signs, right


def test_what_tells_right_from_wrong_is_learned_and_nothing_speaks_against() -> None:
    signs, right = drawn(300)
    result = learned(signs, right, np.ones(300), Chances(6 * (0.0,), 0.0))
    assert min(result.weights) >= 0
    assert result.weights[0] > 10
    chance = np.array([result.of(one).max() for one in signs])
    assert chance[1::3].min() > 0.5 > chance[::3].max()
    assert chance.mean() == pytest.approx(2 / 3, abs=0.03)  # as many as are right


def test_more_of_a_sign_is_never_worse_even_where_the_evidence_says_so() -> None:
    signs, right = drawn(60)
    turned = learned([-one for one in signs], right, np.ones(60), Chances(6 * (0.0,), 0.0))
    assert turned.weights[0] == 0


def test_without_evidence_chances_stay_what_they_were() -> None:
    assert learned([], [], np.zeros(0)) == USUAL
    assert learned([np.zeros((0, len(SIGNS)))], [np.zeros(0, bool)], np.ones(1)) == USUAL


def test_queries_that_count_nothing_teach_nothing() -> None:
    signs, right = drawn(60)
    assert np.allclose(learned(signs, right, np.zeros(60)).weights, USUAL.weights)
