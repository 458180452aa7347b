"""Tests of the paired comparison of two methods on the same queries."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.core.schemas import Labels
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.evaluations import Evaluation
from pipeline.evaluation.judge import judge
from pipeline.evaluation.paired import COMPARED, compare, holm, kept_share
from pipeline.evaluation.protocols import Distance
from pipeline.matching.ranking import Ranking
from tests.evaluation.made import standing

METRES = 600
XY_M = np.stack([np.arange(METRES, dtype=float), np.zeros(METRES)], axis=1)
BOOTSTRAP = Bootstrap(block_m=20.0, resamples=199)
FEW = Bootstrap(resamples=2)


def method(
    right: np.ndarray, novelty: np.ndarray | None = None, bootstrap: Bootstrap = FEW
) -> Evaluation:
    """A query a metre, seen but for the last sixth; a wrong answer lies a kilometre off."""
    seen = np.arange(METRES) < 500
    nothing = np.full(METRES, np.nan, np.float32)
    is_right = right & seen
    novelty = np.where(seen, 0.25, 0.75) if novelty is None else novelty
    xy_m = (XY_M + np.where(is_right, 1.0, 1000.0)[:, None] * (1, 0))[:, None]
    places = np.where(is_right, 0, 5)[:, None]
    column = novelty.astype(np.float32)[:, None]
    ranking = Ranking(
        places,
        np.zeros((METRES, 1), np.float32),
        xy_m,
        column,
        nothing,
        nothing[:, None],
        ("distance",),
    )
    label_columns = (
        np.where(seen, 0, -1),
        np.arange(6),
        np.zeros(METRES, int),
        np.where(seen, 1.0, 99.0),
        np.zeros(METRES),
        1,
        20.0,
        (0.0, 600.0),
        (-10.0, 10.0),
    )
    return judge(ranking, (0.5,), Labels(*label_columns), standing(XY_M), Distance(), bootstrap)


def runs(share: float, seed: int) -> np.ndarray:
    """Which queries are right: this share, in runs of 10 m."""
    return np.repeat(np.random.default_rng(seed).random(METRES // 10) < share, 10)


HARD = runs(0.6, 0)
MOST = np.arange(METRES) % 10 > 0


@pytest.mark.parametrize("protocol", ["cells", "distance"])
def test_differences_and_who_alone_is_right_by_hand(protocol: str) -> None:
    first, second = np.zeros((2, METRES), bool)
    first[:300] = True
    second[100:350] = True  # 100 right by the first alone, 50 by the second alone, of 500 seen
    result = compare(method(first), method(second), protocol, BOOTSTRAP)
    assert result.differences[COMPARED.index("recall_at_1")].estimate.value == pytest.approx(
        50 / 500
    )
    assert (result.only_this, result.only_reference) == (100, 50)


def test_a_small_but_steady_gain_on_a_hard_path_is_found_where_the_intervals_overlap() -> None:
    # Both fail in the same streets; one also where the metre is a multiple of 10: some .06 lost in
    # every block.
    better = method(HARD)
    worse = method(HARD & MOST)
    (value, low, high), p = compare(better, worse, "cells", BOOTSTRAP).differences[0]
    assert p == pytest.approx(2 / 200)  # no resample has it the other way round
    assert 0 < low < value < high
    best, worst = (
        method(right, bootstrap=BOOTSTRAP).number("cells", "recall_at_1")
        for right in (HARD, HARD & MOST)
    )
    assert best.low < worst.high


def test_p_is_twice_the_smaller_share_of_resamples_and_never_zero() -> None:
    this = method(HARD)
    other = method(runs(0.6, 1))
    (_, *interval), p = compare(this, other, "cells", BOOTSTRAP).differences[0]

    def recall(evaluation: Evaluation, weight: np.ndarray) -> np.ndarray:
        return np.asarray(
            weight @ (evaluation.cells.true_rank == 0) / (weight @ evaluation.cells.seen)
        )

    (spread,) = BOOTSTRAP.resampled_values(
        lambda weight: (recall(this, weight) - recall(other, weight))[None], XY_M
    )
    assert p == pytest.approx(
        min(1.0, 2 * (1 + min((spread <= 0).sum(), (spread >= 0).sum())) / 200)
    )
    assert interval == pytest.approx(np.percentile(spread, (2.5, 97.5)).tolist())


@pytest.mark.parametrize(("stretches", "least"), [(4, 0.125), (5, 0.0625), (8, 2 / 256)])
def test_p_is_never_less_than_a_sign_test_of_so_few_blocks_can_reach(
    stretches: int, least: float
) -> None:
    always = np.ones(METRES, bool)
    never = np.zeros(METRES, bool)
    # All 500 seen metres, of which the first method alone places every one
    block_m = 500 / stretches
    assert compare(method(always), method(never), "cells", Bootstrap(block_m=block_m)).differences[
        0
    ].p == pytest.approx(least)


def test_the_same_answers_differ_surely_in_nothing_and_a_path_of_one_block_has_no_interval() -> (
    None
):
    result = compare(method(HARD), method(HARD), "distance", BOOTSTRAP)
    assert result.differences == (((0.0, 0.0, 0.0), 1.0),) * 2
    assert (result.only_this, result.only_reference) == (0, 0)
    result = compare(method(HARD), method(~HARD), "cells", Bootstrap(block_m=5000.0)).differences[0]
    assert np.isnan([*result.estimate[1:], result.p]).all()


def test_the_area_is_compared_too() -> None:
    # The same answers, but one looks as new at seen queries as at unseen ones.
    blind = compare(method(HARD, np.full(METRES, 0.5)), method(HARD), "cells", BOOTSTRAP)
    recall, area = (difference.estimate for difference in blind.differences)
    assert recall.value == 0.0
    assert area.value < 0
    assert area.high < 0


def test_either_way_round_is_the_same_test() -> None:
    this = method(HARD)
    other = method(runs(0.7, 1))
    forwards = compare(this, other, "cells", BOOTSTRAP)
    backwards = compare(other, this, "cells", BOOTSTRAP)
    for one, two in zip(forwards.differences, backwards.differences, strict=True):
        assert one.estimate.value == -two.estimate.value
        low, high = two.estimate[1:]
        assert one.estimate[1:] == pytest.approx((-high, -low))
        assert one.p == two.p
    assert (forwards.only_this, forwards.only_reference) == (
        backwards.only_reference,
        backwards.only_this,
    )


def test_probability_is_called_a_difference_as_often_as_the_level_says() -> None:
    # Pairs of methods that are equally good, each failing in runs of 10 m of its own: some 5 % of p
    # below .05.
    seeds = range(0, 120, 2)
    p = [
        compare(method(runs(0.6, i)), method(runs(0.6, i + 1)), "cells", BOOTSTRAP).differences[0].p
        for i in seeds
    ]
    assert np.mean(np.array(p) < 0.05) <= 0.15


def test_other_queries_are_refused() -> None:
    this = method(HARD)
    with pytest.raises(InputError, match="same queries"):
        compare(this, replace(this, xy_m=this.xy_m + 1), "cells", BOOTSTRAP)
    with pytest.raises(InputError, match="same queries"):
        compare(
            this,
            replace(this, judgements=(replace(this.cells, seen=~this.cells.seen), this.distance)),
            "cells",
            BOOTSTRAP,
        )


def test_holm_multiplies_the_least_by_the_number_of_tests_and_never_falls_and_nan_is_no_test() -> (
    None
):
    # Ascending .01 .02 .03 .2 become .04, .06, .06 (.03 · 2 is no less), .2; of two, .6 · 2 is cut
    # at 1.
    np.testing.assert_allclose(holm(np.array([0.02, 0.01, 0.2, 0.03])), [0.06, 0.04, 0.2, 0.06])
    np.testing.assert_allclose(holm(np.array([0.6, 0.7])), [1.0, 1.0])
    np.testing.assert_allclose(holm(np.array([np.nan, 0.02, 0.04])), [np.nan, 0.04, 0.04])
    assert holm(np.empty(0)).shape == (0,)


def test_the_share_kept_of_perturbed_queries_is_drawn_with_those_unperturbed() -> None:
    # All known queries come first, so the area is that of precision 1: the share right. Half of
    # what was right before is right still, in every block, so that no resample moves the share.
    right = np.arange(METRES) % 2 == 0
    driven = method(right, bootstrap=BOOTSTRAP)
    perturbed = method(np.arange(METRES) % 4 == 0, bootstrap=BOOTSTRAP)
    assert kept_share(driven, driven, "cells", BOOTSTRAP) == pytest.approx((1.0, 1.0, 1.0))
    value, low, high = kept_share(perturbed, driven, "cells", BOOTSTRAP)
    areas = [each.number("cells", "auc_exact_top1")[0] for each in (perturbed, driven)]
    assert value == pytest.approx(areas[0] / areas[1])
    assert low < value < high or low == pytest.approx(high)
    assert high - low < 0.1
    lost = kept_share(driven, method(np.zeros(METRES, bool)), "cells", BOOTSTRAP)
    assert np.isnan(lost).all()
