"""Rejection: thresholds that keep a target precision, chosen on the evidence of validation queries.

The precisions in the comments are worked out by hand: right ones over accepted ones, with one more
counted as wrong.
"""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.core.errors import ConfigError, InputError
from pipeline.matching.ranking import Ranking
from pipeline.matching.rejection import (
    ACCEPT_NOTHING,
    LEAST_BLOCKS,
    NoveltyEvidence,
    Rejection,
    Threshold,
    reachable_threshold,
    threshold_for,
)

# Four validation queries, each in a block of its own, the third misplaced. For both kinds of
# novelty, how new they look as they are, and then with the places around them left out.
EVIDENCE = NoveltyEvidence(
    np.array([True, True, False, True]),
    {"entropy": np.array([0.1, 0.2, 0.3, 0.4]), "energy": np.array([-9.0, -8.0, -7.0, -6.0])},
    {"entropy": np.array([0.25, 0.5, 0.6, 0.7]), "energy": np.array([-10.0, -10.0, -10.0, -10.0])},
    np.arange(4),
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


def test_a_threshold_reaches_the_target_precision_among_seen_and_unseen() -> None:
    # Half of the queries unseen, each counting half, in order of entropy: right .1, right .2,
    # unseen .25, wrong .3, right .4, unseen .5, .6, .7. One more counted wrong, kept are .5/1.5,
    # 1/2, 1/2.5, 1/3, 1.5/3.5, 1.5/4, 1.5/4.5, 1.5/5.
    for wanted, ends, kept in ((0.5, 0.225, 1 / 2), (0.4, 0.45, 1.5 / 3.5), (0.37, 0.55, 1.5 / 4)):
        (threshold,) = Rejection("own", wanted, 0.5).thresholds(EVIDENCE.arrays(), ("entropy",))
        assert threshold == pytest.approx((ends, kept), rel=1e-6)
    # With no unseen query to expect, they are 1/2, 2/3, 2/4, 3/5 of the seen; the unseen up to .7
    # then break nothing.
    (threshold,) = Rejection("own", 0.6, 0.0).thresholds(EVIDENCE.arrays(), ("entropy",))
    assert threshold == pytest.approx((0.7, 0.6), rel=1e-6)
    # Energy takes the unseen for the most familiar, and four blocks are too few to offer less than
    # wanted.
    entropy, energy = Rejection("own", 0.9, 0.5).thresholds(
        EVIDENCE.arrays(), ("entropy", "energy")
    )
    assert entropy.reject_from == energy.reject_from == ACCEPT_NOTHING
    assert np.isnan([entropy.validation_precision, energy.validation_precision]).all()


def test_evidence_survives_being_part_of_a_model_and_one_without_is_refused() -> None:
    back = NoveltyEvidence.of({"net/weight": np.zeros(3), **EVIDENCE.arrays()})
    np.testing.assert_array_equal(back.right, EVIDENCE.right)
    for mine, theirs in ((back.seen, EVIDENCE.seen), (back.unseen, EVIDENCE.unseen)):
        assert mine.keys() == theirs.keys()
        for kind in mine:
            np.testing.assert_allclose(mine[kind], theirs[kind], rtol=1e-6)
    assert (back.block.tolist(), back.blocks) == ([0, 1, 2, 3], 4)
    with pytest.raises(InputError, match="validation/right"):
        NoveltyEvidence.of({"net/weight": np.zeros(3)})
    earlier = {
        name: array for name, array in EVIDENCE.arrays().items() if name != "validation/block"
    }
    with pytest.raises(
        InputError,
        match="the model has no validation/block: an earlier version made it; train it again",
    ):
        NoveltyEvidence.of(earlier)


def test_blocks_of_several_days_stay_distinct() -> None:
    assert NoveltyEvidence.joined([EVIDENCE, EVIDENCE]).block.tolist() == [0, 1, 2, 3, 4, 5, 6, 7]


def test_queries_of_one_block_share_a_weight_of_one() -> None:
    # Twenty right answers, none unseen to expect: each a block keep 20 of 21, ten in each of two
    # blocks 2 of 3.
    novelty = {"entropy": np.arange(20) / 100}
    alone = NoveltyEvidence(np.ones(20, bool), novelty, {"entropy": np.ones(20)}, np.arange(20))
    together = NoveltyEvidence(
        np.ones(20, bool), novelty, {"entropy": np.ones(20)}, np.repeat([0, 1], 10)
    )
    (kept,) = Rejection("own", 0.9, 0.0).thresholds(alone.arrays(), ("entropy",))
    assert kept.validation_precision == pytest.approx(20 / 21)
    (nothing,) = Rejection("own", 0.9, 0.0).thresholds(together.arrays(), ("entropy",))
    assert nothing.reject_from == ACCEPT_NOTHING
    (less,) = Rejection("own", 0.66, 0.0).thresholds(together.arrays(), ("entropy",))
    assert less.validation_precision == pytest.approx(2 / 3)
    # A block of two queries counts as one of one: right, then wrong and right in one block, keep
    # 1/2, 1/2.5, 1.5/3.
    uneven = NoveltyEvidence(
        np.array([1, 0, 1], bool),
        {"e": np.array([1.0, 2, 3])},
        {"e": np.full(3, 9.0)},
        np.array([0, 1, 1]),
    )
    assert uneven.threshold("e", 0.0, 0.5) == pytest.approx((np.nextafter(9, 10), 0.5))


def reached(
    wanted: float,
    right: list[int],
    blocks: list[int] | None = None,
    novelty: list[float] | None = None,
) -> Threshold:
    """The threshold for queries of which some are `right`.

    Unless they are given, their novelties are 0, 1, 2, …, and each is in a block of its own.
    """
    n = np.arange(len(right))
    given = n.astype(float) if novelty is None else np.array(novelty)
    return reachable_threshold(
        wanted,
        given,
        np.array(right, bool),
        np.ones(len(n)),
        n if blocks is None else np.array(blocks),
    )


def test_a_threshold_stands_midway_to_the_next_novelty_and_just_above_the_last() -> None:
    # Nine right of nine and one more counted wrong are 9 of 10; the tenth, wrong, would make 9 of
    # 11.
    novelty = [*range(9), 11.0]
    assert reached(0.9, [1] * 9 + [0], novelty=novelty) == pytest.approx((9.5, 0.9))
    assert reached(0.9, [1] * 8 + [0] * 2).reject_from != pytest.approx(7.5)  # 8 of 9 are .889
    assert reached(0.9, [1] * 9) == pytest.approx((np.nextafter(8, 9), 0.9))
    # What is infinitely new is accepted by no threshold, and is no end of a gap.
    assert reached(0.9, [1] * 9 + [0], novelty=[*range(9), np.inf]) == pytest.approx(
        (np.nextafter(8, 9), 0.9)
    )


def test_where_the_target_precision_is_missed_the_highest_is_reached() -> None:
    # Twelve, the third and the last wrong: of the first eleven 9 are right, 9 of 12, more than 8 of
    # 11 or 9 of 13.
    assert LEAST_BLOCKS == 10
    assert reached(0.9, [1, 1, 0, 1, 1, 0, 1, 1, 1, 1, 1, 0]) == pytest.approx((10.5, 0.75))
    # 10 of 12 are .8333...: reported as .833, since .834 would claim more than is reached.
    assert reached(0.9, [1, 1, 0, 1, 1, 1, 1, 1, 1, 1, 1, 0]).validation_precision == 0.833
    # 8 of 9 would be more, but of eight blocks: the first ten keep 8 of 11.
    assert reached(0.9, [1] * 8 + [0] * 4) == pytest.approx((9.5, 0.727))


def test_too_few_blocks_or_none_right_offer_nothing() -> None:
    for none in (
        reached(0.9, [1, 1, 0, 1, 1, 1, 1, 1, 1]),  # 8 of 10, but of nine blocks
        reached(0.95, [1, 1, 0] + [1] * 17, blocks=[*range(9), *[8] * 11]),  # 19 of 21, but of nine
        reached(0.91, [0] * 12),
        reached(0.9, []),
    ):
        assert none.reject_from == ACCEPT_NOTHING
        assert np.isnan(none.validation_precision)


def test_a_line_gives_the_precision_if_it_misses_the_target() -> None:
    rejection = Rejection("own", 0.9, 0.0)
    novelty = {"e": np.arange(12.0)}

    def said(right: list[int]) -> str:
        n = len(right)
        evidence = NoveltyEvidence(
            np.array(right, bool), {"e": novelty["e"][:n]}, {"e": np.full(n, 99.0)}, np.arange(n)
        )
        (threshold,) = rejection.thresholds(evidence.arrays(), ("e",))
        return rejection.summary(evidence.arrays(), threshold, 7)

    assert said([1] * 12) == "7 rejected"
    assert (
        said([1] * 8 + [0] * 4)
        == "7 rejected; keeps 0.727 of the wanted 0.9 on 12 validation blocks"
    )
    nothing = (
        "all rejected: no threshold keeps the wanted 0.9 on validation blocks, or is right on 10 of "
        "them (there are 6)"
    )
    assert said([1] * 6) == nothing


def test_the_wanted_kind_of_novelty_comes_first() -> None:
    ordered = Rejection("energy").order(RANKING)
    assert ordered.kinds == ("energy", "entropy")
    np.testing.assert_array_equal(ordered.novelty, RANKING.novelty[:, ::-1])
    assert Rejection().order(RANKING) is RANKING
    changed = {
        field.name
        for field in fields(RANKING)
        if getattr(ordered, field.name) is not getattr(RANKING, field.name)
    }
    assert changed == {"novelty", "kinds"}


@pytest.mark.parametrize(
    ("settings_", "said"),
    [
        (
            {"novelty": "distance"},
            "rejection.novelty=distance: expected own or one of entropy, energy",
        ),
        ({"target_precision": 1.5}, "rejection.target_precision=1.5: expected a share from 0 to 1"),
        ({"unseen_share": -0.1}, "rejection.unseen_share=-0.1"),
        ({"target_precision": "much"}, "rejection.target_precision=much: expected a number"),
    ],
)
def test_a_wrong_setting_is_one_line(settings_: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Rejection(**settings_).order(RANKING)  # type: ignore[arg-type]


def chosen(
    precision: float, novelty: list[float], right: list[int], weight: list[float] | None = None
) -> float:
    """`threshold_for` of lists; all queries weigh the same unless weights are given."""
    return threshold_for(
        precision, np.array(novelty), np.array(right, bool), np.array(weight or [1.0] * len(right))
    )


def test_precision_may_dip_and_recover_and_equal_novelties_are_accepted_together_in_any_order() -> (
    None
):
    # wrong, then three right: 0, 1/2, 2/3, 3/4 of those accepted.
    assert chosen(0.75, [0.1, 0.2, 0.3, 0.4], [0, 1, 1, 1]) > 0.4
    assert chosen(0.76, [0.1, 0.2, 0.3, 0.4], [0, 1, 1, 1]) == ACCEPT_NOTHING
    # Equal novelties: at 0.2 there are a right one and a wrong one, in any order: accepting one
    # accepts both, 2 of 3.
    for right in ([1, 1, 0], [1, 0, 1]):
        assert 0.1 < chosen(0.9, [0.1, 0.2, 0.2], right) <= 0.2
        assert chosen(0.66, [0.1, 0.2, 0.2], right) > 0.2
    assert chosen(0.95, [0.3, 0.4], [0, 1]) == ACCEPT_NOTHING
    assert chosen(0.95, [-7.0, -7.0], [0, 1]) == ACCEPT_NOTHING
    assert chosen(0.95, [], []) == ACCEPT_NOTHING
    assert chosen(0.7, [0.4, 0.1, 0.3, 0.2], [0, 1, 0, 1]) == chosen(
        0.7, [0.1, 0.2, 0.3, 0.4], [1, 1, 0, 0]
    )


def test_a_query_counts_as_often_as_it_weighs() -> None:
    # Accepting all: 0.8 right of 0.8 + 0.2, a precision of 0.8.
    assert chosen(0.8, [0.1, 0.2], [1, 0], [0.8, 0.2]) > 0.2
    assert chosen(0.81, [0.1, 0.2], [1, 0], [0.8, 0.2]) <= 0.2
    # Unweighted it would be 0.5.
    assert chosen(0.8, [0.1, 0.2], [1, 0]) <= 0.2


NOVELTIES = st.sampled_from([0.0, 0.25, 0.5, 0.75, 1.0])
QUERIES = st.lists(st.tuples(NOVELTIES, st.booleans()), min_size=1, max_size=12)


@given(QUERIES, st.floats(0.05, 1))
@settings(max_examples=60)
def test_the_given_precision_is_reached_and_by_no_larger_threshold(
    queries: list[tuple[float, bool]], wanted: float
) -> None:
    novelty = np.array([n for n, _ in queries])
    right = np.array([r for _, r in queries])
    threshold = reached(wanted, right, novelty=novelty)  # type: ignore[arg-type]
    accepted = novelty < threshold.reject_from
    if not accepted.any():
        assert np.isnan(threshold.validation_precision)
        return
    kept = right[accepted].sum() / (accepted.sum() + 1)
    assert threshold.validation_precision - 1e-8 <= kept <= threshold.validation_precision + 0.0011
    bound = wanted if threshold.validation_precision >= wanted else kept
    for larger in np.unique(novelty[~accepted]):
        assert right[novelty <= larger].sum() / ((novelty <= larger).sum() + 1) < bound + 1e-9


@given(QUERIES, st.floats(0.05, 1))
@settings(max_examples=60)
def test_no_larger_threshold_reaches_the_precision(
    queries: list[tuple[float, bool]], precision: float
) -> None:
    novelty = np.array([n for n, _ in queries])
    right = np.array([r for _, r in queries])
    threshold = threshold_for(precision, novelty, right, np.ones(len(right)))
    accepted = novelty < threshold
    assert not accepted.any() or right[accepted].mean() >= precision
    for larger in np.unique(novelty[~accepted]):
        assert right[novelty <= larger].mean() < precision
