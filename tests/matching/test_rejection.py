"""Rejection: the threshold of a wanted precision, from what a model says of its held-out queries."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.errors import ConfigError, InputError
from pipeline.matching.ranking import Ranking
from pipeline.matching.rejection import ACCEPT_NOTHING, Evidence, Rejection, threshold_for

# Four held-out queries, the third misplaced: how new they look as they are, and with their surroundings forgotten.
EVIDENCE = Evidence(
    np.array([True, True, False, True]),
    {"entropy": np.array([0.1, 0.2, 0.3, 0.4]), "energy": np.array([-9.0, -8.0, -7.0, -6.0])},
    {"entropy": np.array([0.25, 0.5, 0.6, 0.7]), "energy": np.array([-10.0, -10.0, -10.0, -10.0])},
)
RANKING = Ranking(
    np.zeros((2, 1), np.int64),
    np.zeros((2, 1), np.float32),
    np.zeros((2, 1, 2)),
    np.array([[0.1, -9.0], [0.2, -8.0]], np.float32),
    np.full(2, np.nan, np.float32),
    np.full((2, 1), np.nan, np.float32),
    ("entropy", "energy"),
)


def test_a_threshold_keeps_the_wanted_precision_among_seen_and_unseen() -> None:
    # Half of the queries unseen, in order of entropy: right .1, right .2, unseen .25, wrong .3, right .4, ...: precisions
    # 1, 1, 2/3, 2/4, 3/5, 3/6. Two thirds are kept up to .25, one half up to .5.
    for wanted, last in ((0.9, 0.2), (0.66, 0.25), (0.5, 0.5)):
        (threshold,) = Rejection("own", wanted, 0.5).thresholds(EVIDENCE.arrays(), ("entropy",))
        assert last < threshold < last + 1e-6
    # With no unseen query to expect, the precisions are 1, 1, 2/3, 3/4.
    (threshold,) = Rejection("own", 0.75, 0.0).thresholds(EVIDENCE.arrays(), ("entropy",))
    assert threshold > 0.4
    # Energy takes the unseen for the most familiar.
    assert Rejection("own", 0.9, 0.5).thresholds(EVIDENCE.arrays(), ("entropy", "energy"))[1] == ACCEPT_NOTHING


def test_evidence_survives_being_part_of_a_model_and_one_without_is_refused() -> None:
    back = Evidence.of({"net/weight": np.zeros(3), **EVIDENCE.arrays()})
    np.testing.assert_array_equal(back.right, EVIDENCE.right)
    for mine, theirs in ((back.seen, EVIDENCE.seen), (back.unseen, EVIDENCE.unseen)):
        assert mine.keys() == theirs.keys()
        for kind in mine:
            np.testing.assert_allclose(mine[kind], theirs[kind], rtol=1e-6)
    with pytest.raises(InputError, match="held_out/right"):
        Evidence.of({"net/weight": np.zeros(3)})


def test_the_wanted_kind_of_novelty_comes_first() -> None:
    ordered = Rejection("energy").order(RANKING)
    assert ordered.kinds == ("energy", "entropy")
    np.testing.assert_array_equal(ordered.novelty, RANKING.novelty[:, ::-1])
    assert Rejection().order(RANKING) is RANKING
    changed = {field.name for field in fields(RANKING) if getattr(ordered, field.name) is not getattr(RANKING, field.name)}
    assert changed == {"novelty", "kinds"}


@pytest.mark.parametrize(
    ("settings_", "said"),
    [
        ({"novelty": "distance"}, "rejection.novelty=distance: expected own or one of entropy, energy"),
        ({"wanted_precision": 1.5}, "rejection.wanted_precision=1.5: expected a share from 0 to 1"),
        ({"unseen_share": -0.1}, "rejection.unseen_share=-0.1"),
        ({"wanted_precision": "much"}, "rejection.wanted_precision=much: expected a number"),
    ],
)
def test_a_wrong_setting_is_one_line(settings_: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Rejection(**settings_).order(RANKING)  # type: ignore[arg-type]


def chosen(precision: float, novelty: list[float], right: list[int], weight: list[float] | None = None) -> float:
    return threshold_for(precision, np.array(novelty), np.array(right, bool), np.array(weight or [1.0] * len(right)))


@pytest.mark.parametrize(
    ("precision", "accepted"),
    [
        (1.0, 2),  # right, right
        (0.7, 4),  # right, right, wrong, right: 3 of 4
        (0.6, 5),  # 3 of 5
        (0.5, 6),  # 3 of 6
        (0.0, 6),
    ],
)
def test_the_largest_threshold_that_keeps_the_precision_is_chosen(precision: float, accepted: int) -> None:
    novelty, right = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [1, 1, 0, 1, 0, 0]
    threshold = chosen(precision, novelty, right)
    assert (np.array(novelty) < threshold).sum() == accepted


def test_precision_may_dip_and_recover_and_equal_novelties_are_accepted_together_in_any_order() -> None:
    # wrong, then three right: 0, 1/2, 2/3, 3/4 of those accepted.
    assert chosen(0.75, [0.1, 0.2, 0.3, 0.4], [0, 1, 1, 1]) > 0.4
    assert chosen(0.76, [0.1, 0.2, 0.3, 0.4], [0, 1, 1, 1]) == ACCEPT_NOTHING
    # Equal novelties: at 0.2 there are a right one and a wrong one, in any order: accepting one accepts both, 2 of 3.
    for right in ([1, 1, 0], [1, 0, 1]):
        assert 0.1 < chosen(0.9, [0.1, 0.2, 0.2], right) <= 0.2
        assert chosen(0.66, [0.1, 0.2, 0.2], right) > 0.2
    assert chosen(0.95, [0.3, 0.4], [0, 1]) == ACCEPT_NOTHING
    assert chosen(0.95, [-7.0, -7.0], [0, 1]) == ACCEPT_NOTHING
    assert chosen(0.95, [], []) == ACCEPT_NOTHING
    assert chosen(0.7, [0.4, 0.1, 0.3, 0.2], [0, 1, 0, 1]) == chosen(0.7, [0.1, 0.2, 0.3, 0.4], [1, 1, 0, 0])


def test_a_query_counts_as_often_as_it_weighs() -> None:
    # Accepting all: 0.8 right of 0.8 + 0.2, a precision of 0.8.
    assert chosen(0.8, [0.1, 0.2], [1, 0], [0.8, 0.2]) > 0.2
    assert chosen(0.81, [0.1, 0.2], [1, 0], [0.8, 0.2]) <= 0.2
    # Unweighted it would be 0.5.
    assert chosen(0.8, [0.1, 0.2], [1, 0]) <= 0.2


@given(
    st.lists(st.tuples(st.sampled_from([0.0, 0.25, 0.5, 0.75, 1.0]), st.booleans()), min_size=1, max_size=12), st.floats(0.05, 1)
)
@settings(max_examples=60, deadline=None)
def test_no_larger_threshold_keeps_the_precision(queries: list[tuple[float, bool]], precision: float) -> None:
    novelty, right = np.array([n for n, _ in queries]), np.array([r for _, r in queries])
    threshold = threshold_for(precision, novelty, right, np.ones(len(right)))
    accepted = novelty < threshold
    assert not accepted.any() or right[accepted].mean() >= precision
    for larger in np.unique(novelty[~accepted]):
        assert right[novelty <= larger].mean() < precision
