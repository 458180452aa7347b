"""Tests of the distance of queries to changes of the world, and of results in its bands."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.events import NUMBERS, Bands, distances, judge_by_band, nearest_m
from pipeline.formats.changes import Change
from tests.evaluation.made import BOOTSTRAP, evaluation

BUILT = Change("construction", 10, 120, 3.0, 4.0)
GONE = Change("demolition", 60, 60, 100.0, 0.0)
TREE = Change("tree", 5, 5, 0.0, 0.0)
PATH_M = np.array([[0.0, 0.0], [100.0, 30.0]])
KINDS = ("construction", "demolition")


def test_the_distance_is_to_the_nearest_change() -> None:
    assert nearest_m(PATH_M, [BUILT, GONE]).tolist() == [5.0, 30.0]
    assert nearest_m(PATH_M, []).tolist() == [np.inf, np.inf]


def test_what_shows_in_later_sequences_alone_is_to_come_unless_something_that_shows_is_nearer() -> (
    None
):
    result = distances(
        {"early": PATH_M, "late": PATH_M},
        {"early": [TREE, BUILT], "late": [TREE, BUILT, GONE]},
        KINDS,
    )
    shown, to_come = result["early"]
    assert shown == pytest.approx([5.0, np.hypot(97, 26)])
    assert np.isnan(to_come[0])  # 100 m from the demolition, but 5 m from the fence
    assert to_come[1] == 30.0
    shown, to_come = result["late"]
    assert shown.tolist() == [5.0, 30.0]
    assert np.isnan(to_come).all()
    # Trees count where they are among the kinds.
    shown, _ = distances({"a": PATH_M}, {"a": [TREE, BUILT]}, ("tree",))["a"]
    assert shown == pytest.approx([0.0, np.hypot(100, 30)])


def test_bands_end_at_their_edges() -> None:
    bands = Bands((25.0, 50.0))
    assert bands.names == ["0–25 m", "25–50 m", "over 50 m"]
    assert bands.band_of(np.array([0.0, 25.0, 25.1, 50.0, np.inf, np.nan])).tolist() == [
        0,
        0,
        1,
        1,
        2,
        -1,
    ]


@pytest.mark.parametrize("edges_m", [(50.0, 25.0), (0.0, 25.0), (25.0, 25.0), ()])
def test_edges_rise_from_above_0(edges_m: tuple[float, ...]) -> None:
    with pytest.raises(ConfigError, match=r"bands\.edges_m="):
        Bands(edges_m)


def test_each_band_counts_its_own_queries_over_all_sequences_and_an_empty_one_has_no_numbers() -> (
    None
):
    # By cells the seven are: right, right, wrong, wrong, right, unseen, unseen, at novelty .1 .8 .2
    # .3 .05 .4 .9. The first three are near, the fourth left out, the rest far; the second sequence
    # is all far.
    near = np.array([1.0, 1, 1, np.nan, 99, 99, 99])
    far = np.full(7, 99.0)
    one = judge_by_band(
        [evaluation(), evaluation(62)], [near, far], Bands((25.0,)), "cells", BOOTSTRAP
    )
    assert one.seen.tolist() == [3, 6]
    assert one.unseen.tolist() == [0, 4]
    recall, oracle, area = one.values[:, :, 0].T
    assert recall == pytest.approx([2 / 3, 4 / 6])
    # the oracle is wrong at the fourth query alone
    assert oracle == pytest.approx([1, 5 / 6])
    # Near, as the threshold rises past .1, .2, .8, (recall, precision): (1/3, 1) with two seen
    # rejected, (1/2, 1/2), (1, 2/3); from (0, 1) on the area is 1/3 + 1/8 + 7/24
    assert area[0] == pytest.approx(0.75)
    one = judge_by_band([evaluation()], [np.full(7, 99.0)], Bands((25.0,)), "distance", BOOTSTRAP)
    assert np.isnan(one.values[0]).all()
    assert (one.seen[0], one.unseen[0]) == (0, 0)


def test_the_threshold_passes_the_novelties_of_all_sequences_together() -> None:
    # The same queries twice, the second time all newer by 10: then every unseen query of the first
    # comes before a right answer of the second, so the area is less than that of one sequence,
    # though each alone has the same.
    one = evaluation()
    other = evaluation(62)
    newer = replace(other, novelty=other.novelty + 10)
    nowhere = np.full(7, 99.0)
    at = NUMBERS.index("auc_exact_top1")
    alone, twice, apart = (
        judge_by_band(each, [nowhere] * len(each), Bands((25.0,)), "cells", BOOTSTRAP).values[
            1, at, 0
        ]
        for each in ([one], [one, other], [one, newer])
    )
    assert twice == pytest.approx(alone)
    assert apart < alone - 0.01


def test_no_block_of_the_path_holds_queries_of_two_sequences() -> None:
    # One block a sequence: the first all right, the second all wrong. Drawn are 2, 1 or 0 of the
    # first, so recall runs from 0 to 1. Were both one block, as their common start would have it,
    # there would be no interval at all.
    base = evaluation()
    right, wrong = (
        replace(base, judgements=(replace(base.cells, true_rank=rank), base.distance))
        for rank in (np.zeros(7, int), np.full(7, -1))
    )
    rule = Bootstrap(block_m=1000.0, resamples=200)
    result = judge_by_band(
        [right, wrong], [np.zeros(7), np.zeros(7)], Bands((25.0,)), "cells", rule
    ).values[0, 0]
    assert result == pytest.approx([0.5, 0.0, 1.0])
