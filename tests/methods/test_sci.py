"""Tests of SCI on a few made-up places: it learns them, forward and reversed, and tells which views
are new."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.matching.ranking import Model, Ranking, Rows
from pipeline.matching.rejection import ACCEPT_NOTHING, NoveltyEvidence, Rejection
from pipeline.methods.sci import Sci
from tests.learning import Clears
from tests.matching.made import along

KINDS = ("entropy", "tempered_entropy", "energy", "feature_distance")
PLACES = 4
EACH = 12
RINGS = 8
SECTORS = 24
SMALL = Sci(
    epochs=16,
    batch=16,
    dropout=0.2,
    validation_every_m=10,
    validation_length_m=3,
    neighbour_m=13,
    precision="f32",
    threads=1,
)


def rows(seed: int, turn: int = 0, noise_m: float = 0.5, places: int = PLACES) -> Rows:
    """`places` scenes seen EACH times with noise, a metre apart along x, their columns rolled by
    `turn`."""
    scenes = np.random.default_rng(0).uniform(0, 15, (PLACES + 4, RINGS, SECTORS)) * (
        np.random.default_rng(1).random((PLACES + 4, RINGS, SECTORS)) < 0.5
    )
    images = np.repeat(scenes[:places], EACH, axis=0)
    images = images + np.random.default_rng(seed).normal(scale=noise_m, size=images.shape)
    return along(np.roll(images, turn, axis=2).astype(np.float32))


GROUND_TRUTH = np.repeat(np.arange(PLACES), EACH)


@pytest.fixture(scope="module")
def model(seed: int) -> Model:
    return replace(SMALL, seed=seed).learn(rows(2), GROUND_TRUTH, Progress())


@pytest.fixture(scope="module")
def ranking(model: Model) -> Ranking:
    return SMALL.localizer(model)(rows(3), k=3)


def right(method: Sci, model: Model, views: Rows) -> float:
    """Share of the views whose first answer is their place."""
    return float((method.localizer(model)(views, 1).places[:, 0] == GROUND_TRUTH).mean())


@pytest.mark.learning
def test_places_are_learned(model: Model, clears: Clears) -> None:
    clears(right(SMALL, model, rows(3)), 0.8)
    clears(1 - model["curves/loss"][-1] / model["curves/loss"][0], 0.7)
    assert model["curves/loss"].shape == (16,)
    accuracy = model["curves/validation_accuracy"]
    # Of equals the last
    assert int(model["best_epoch"].item()) == np.flatnonzero(accuracy == accuracy.max())[-1]


@pytest.mark.learning
def test_a_reversed_view_is_known_after_two_way_training(
    model: Model, seed: int, clears: Clears
) -> None:
    # n_way 2 turns each training image by half of the 24 columns; one-way training never saw that
    # side.
    back = rows(3, turn=SECTORS // 2)
    clears(right(SMALL, model, back), 0.8)
    one_way = replace(SMALL, n_way=1, epochs=32, seed=seed)  # half the images an epoch
    once = one_way.learn(rows(2), GROUND_TRUTH, Progress())
    clears(right(one_way, once, rows(3)), 0.8)
    clears(1 - right(one_way, once, back), 0.2)


@pytest.mark.learning
def test_every_way_of_n_is_known(seed: int, clears: Clears) -> None:
    four = replace(SMALL, n_way=4, epochs=8, seed=seed)  # twice the images an epoch
    learned = four.learn(rows(2), GROUND_TRUTH, Progress())
    clears(min(right(four, learned, rows(3, turn)) for turn in (0, 6, 12, 18)), 0.8)


def test_answers_are_ranked_from_cheapest_to_dearest_and_lie_at_the_mean_of_their_places_views(
    ranking: Ranking,
) -> None:
    assert ranking.places.shape == ranking.costs.shape == (len(GROUND_TRUTH), 3)
    assert ranking.xy_m.shape == (len(GROUND_TRUTH), 3, 2)
    assert (np.diff(ranking.costs, axis=1) >= 0).all()
    assert ((ranking.costs >= 0) & (ranking.costs <= 1)).all()
    assert all(len(set(answer)) == 3 for answer in ranking.places.tolist())
    assert np.isnan(ranking.heading_deg).all()
    # Place p holds x = 12 p … 12 p + 11, whose mean is 12 p + 5.5.
    np.testing.assert_allclose(ranking.xy_m[..., 0], 12 * ranking.places + 5.5)
    np.testing.assert_array_equal(ranking.xy_m[..., 1], 0)


def test_more_places_than_there_are_is_all_of_them_and_costs_and_confidence_are_of_probabilities(
    model: Model,
) -> None:
    result = SMALL.localizer(model)(rows(3), k=25)
    assert sorted(result.places[0].tolist()) == list(range(PLACES))
    np.testing.assert_allclose((1 - result.costs).sum(axis=1), 1, atol=1e-5)
    odds = (1 - result.costs.astype(np.float64)).clip(1e-12) ** (1 / float(model["temperature"]))
    np.testing.assert_allclose(result.confidence, odds.max(axis=1) / odds.sum(axis=1), atol=1e-4)


def test_novelty_is_between_zero_and_one_and_higher_for_unknown_scenes(
    model: Model, ranking: Ranking
) -> None:
    unknown = SMALL.localizer(model)(
        rows(4, places=PLACES + 4).select(slice(len(GROUND_TRUTH), None)), 1
    )
    for novelty in (ranking.novelty, unknown.novelty):
        assert ((novelty[:, :2] >= 0) & (novelty[:, :2] <= 1)).all()
        assert ((novelty[:, 3] > -1e-6) & (novelty[:, 3] <= 2)).all()
    assert ranking.kinds == KINDS
    assert (np.median(unknown.novelty, axis=0) > np.median(ranking.novelty, axis=0)).all()


@pytest.mark.parametrize("n_way", [0, 5, 7, 48, -2])
def test_ways_that_do_not_divide_the_sectors_are_a_config_error(n_way: int) -> None:
    with pytest.raises(ConfigError, match=f"n_way={n_way}"):
        replace(SMALL, n_way=n_way).learn(rows(2), GROUND_TRUTH, Progress())


def test_validation_queries_look_newer_once_their_surroundings_are_forgotten(model: Model) -> None:
    evidence = NoveltyEvidence.of(model)
    assert evidence.right.all()
    for kind in KINDS:
        # Places are 12 m long: all that is nearer than neighbour_m = 13 includes the whole of the
        # query's own.
        assert (evidence.unseen[kind] > evidence.seen[kind]).mean() > 0.9
    for threshold, _ in Rejection(target_precision=0.5).thresholds(model, KINDS):
        assert threshold > ACCEPT_NOTHING
