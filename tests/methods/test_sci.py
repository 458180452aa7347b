"""SCI on a few made-up places: it learns them, forward and reversed, and says what it does not know."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import ConfigError, InputError
from pipeline.matching.ranking import Model, Ranking, Rows
from pipeline.matching.rejection import ACCEPT_NOTHING, Evidence, Rejection
from pipeline.methods.sci import Sci
from pipeline.running.progress import Progress
from tests.interrupted import PowerCut, same

KINDS = ("entropy", "tempered_entropy", "energy", "feature_distance")
PLACES, EACH, RINGS, SECTORS = 4, 12, 8, 24
SMALL = Sci(
    epochs=16, batch=16, dropout=0.2, held_out_every_m=10, held_out_length_m=3, neighbour_m=13, precision="f32", threads=1
)


def rows(seed: int, turn: int = 0, noise_m: float = 0.5, places: int = PLACES) -> Rows:
    """`places` scenes seen EACH times with noise, a metre apart along x, their columns rolled by `turn`."""
    scenes = np.random.default_rng(0).uniform(0, 15, (PLACES + 4, RINGS, SECTORS)) * (
        np.random.default_rng(1).random((PLACES + 4, RINGS, SECTORS)) < 0.5
    )
    images = np.repeat(scenes[:places], EACH, axis=0)
    images = images + np.random.default_rng(seed).normal(scale=noise_m, size=images.shape)
    poses = np.tile(np.eye(4), (len(images), 1, 1))
    poses[:, 0, 3] = np.arange(len(images))
    return Rows(np.roll(images, turn, axis=2).astype(np.float32), np.arange(len(images)), poses)


TRUTH = np.repeat(np.arange(PLACES), EACH)


@pytest.fixture(scope="module")
def model() -> Model:
    return SMALL.learn(rows(2), TRUTH, Progress())


@pytest.fixture(scope="module")
def ranking(model: Model) -> Ranking:
    return SMALL.localizer(model)(rows(3), k=3)


def test_places_are_learned(model: Model, ranking: Ranking) -> None:
    assert (ranking.places[:, 0] == TRUTH).mean() > 0.95
    assert model["curves/loss"][-1] < 0.3 * model["curves/loss"][0]
    assert model["curves/loss"].shape == (16,)


def test_a_reversed_view_is_known_after_two_way_training(model: Model) -> None:
    # n_way 2 turns each training image by half of the 24 columns; one-way training never saw that side.
    back = rows(3, turn=SECTORS // 2)
    assert (SMALL.localizer(model)(back, 1).places[:, 0] == TRUTH).mean() > 0.95
    one_way = replace(SMALL, n_way=1)
    once = one_way.learn(rows(2), TRUTH, Progress())
    assert (one_way.localizer(once)(rows(3), 1).places[:, 0] == TRUTH).mean() > 0.95
    assert (one_way.localizer(once)(back, 1).places[:, 0] == TRUTH).mean() < 0.7


def test_every_way_of_n_is_known() -> None:
    four = replace(SMALL, n_way=4)
    learned = four.learn(rows(2), TRUTH, Progress())
    for turn in (0, 6, 12, 18):
        assert (four.localizer(learned)(rows(3, turn), 1).places[:, 0] == TRUTH).mean() > 0.9


def test_answers_are_ranked_from_cheapest_to_dearest(ranking: Ranking) -> None:
    assert ranking.places.shape == ranking.costs.shape == (len(TRUTH), 3)
    assert ranking.xy_m.shape == (len(TRUTH), 3, 2)
    assert (np.diff(ranking.costs, axis=1) >= 0).all()
    assert ((ranking.costs >= 0) & (ranking.costs <= 1)).all()
    assert all(len(set(answer)) == 3 for answer in ranking.places.tolist())
    assert np.isnan(ranking.heading_deg).all()


def test_costs_of_all_places_are_one_minus_a_probability(model: Model) -> None:
    costs = SMALL.localizer(model)(rows(3), k=PLACES).costs
    np.testing.assert_allclose((1 - costs).sum(axis=1), 1, atol=1e-5)


def test_asking_for_more_places_than_there_are_gives_them_all(model: Model) -> None:
    found = SMALL.localizer(model)(rows(3), k=25)
    assert sorted(found.places[0].tolist()) == list(range(PLACES))


def test_an_answer_lies_at_the_mean_of_its_places_views(ranking: Ranking) -> None:
    # Place p holds x = 12 p … 12 p + 11, whose mean is 12 p + 5.5.
    np.testing.assert_allclose(ranking.xy_m[..., 0], 12 * ranking.places + 5.5)
    np.testing.assert_array_equal(ranking.xy_m[..., 1], 0)


def test_novelty_is_between_zero_and_one_and_higher_for_unknown_scenes(model: Model, ranking: Ranking) -> None:
    strange = rows(4, places=PLACES + 4)
    unknown = SMALL.localizer(model)(
        Rows(strange.images[len(TRUTH) :], strange.stamps_ns[len(TRUTH) :], strange.world_T_anchor[len(TRUTH) :]), 1
    )
    for novelty in (ranking.novelty, unknown.novelty):
        assert ((novelty[:, :2] >= 0) & (novelty[:, :2] <= 1)).all()
        assert ((novelty[:, 3] > -1e-6) & (novelty[:, 3] <= 2)).all()
    assert ranking.kinds == KINDS
    assert (np.median(unknown.novelty, axis=0) > np.median(ranking.novelty, axis=0)).all()


def test_confidence_is_the_highest_tempered_probability(model: Model) -> None:
    everything = SMALL.localizer(model)(rows(3), k=PLACES)
    odds = (1 - everything.costs.astype(np.float64)).clip(1e-12) ** (1 / float(model["temperature"]))
    np.testing.assert_allclose(everything.confidence, odds.max(axis=1) / odds.sum(axis=1), atol=1e-4)


def test_one_query_is_answered_as_in_a_crowd(model: Model, ranking: Ranking) -> None:
    crowd = rows(3)
    for row in (0, 30):
        alone = SMALL.localizer(model)(Rows(crowd.images[row : row + 1], crowd.stamps_ns[:1], crowd.world_T_anchor[:1]), 3)
        assert alone.places.tolist() == ranking.places[row : row + 1].tolist()
        np.testing.assert_allclose(alone.costs[0], ranking.costs[row], atol=1e-5)


def test_no_queries_have_no_answers(model: Model) -> None:
    none = SMALL.localizer(model)(Rows(np.empty((0, RINGS, SECTORS), np.float32), np.empty(0, np.int64), np.empty((0, 4, 4))), 3)
    assert len(none.places) == len(none.novelty) == len(none.costs) == 0


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(model: Model) -> None:
    assert same(SMALL.learn(rows(2), TRUTH, Progress()), model)
    assert not same(replace(SMALL, seed=1).learn(rows(2), TRUTH, Progress()), model)


def test_an_interrupted_training_goes_on_to_the_same_bytes(tmp_path: Path, model: Model) -> None:
    with pytest.raises(KeyboardInterrupt):
        SMALL.learn(rows(2), TRUTH, PowerCut(at=5, checkpoint=tmp_path / "half"))
    assert (tmp_path / "half").is_file()
    assert same(SMALL.learn(rows(2), TRUTH, Progress(checkpoint=tmp_path / "half")), model)


def test_the_best_epoch_has_the_lowest_held_out_loss(model: Model) -> None:
    assert int(model["best_epoch"].item()) == int(model["curves/held_out_loss"].argmin())


@pytest.mark.parametrize(("budget", "epochs"), [(0.25, 4), (0.001, 1)])
def test_a_budget_is_a_share_of_the_epochs(budget: float, epochs: int) -> None:
    assert len(SMALL.learn(rows(2), TRUTH, Progress(budget=budget))["curves/loss"]) == epochs


def test_a_path_too_short_for_blocks_is_learned_all_the_same() -> None:
    short = replace(SMALL, held_out_every_m=1000.0, epochs=2)
    assert len(short.learn(rows(2), TRUTH, Progress())["curves/loss"]) == 2


@pytest.mark.parametrize("n_way", [0, 5, 7, 48, -2])
def test_ways_that_do_not_divide_the_sectors_are_a_config_error(n_way: int) -> None:
    with pytest.raises(ConfigError, match=f"n_way={n_way}"):
        replace(SMALL, n_way=n_way).learn(rows(2), TRUTH, Progress())


def test_views_of_another_shape_are_refused(model: Model) -> None:
    other = rows(3)
    with pytest.raises(InputError, match="8 rings × 24 sectors"):
        SMALL.localizer(model)(Rows(other.images[:, :, :12], other.stamps_ns, other.world_T_anchor), 1)


def test_held_out_queries_look_newer_once_their_surroundings_are_forgotten(model: Model) -> None:
    evidence = Evidence.of(model)
    assert evidence.right.all()
    for kind in KINDS:
        # Places are 12 m long: all that is nearer than neighbour_m = 13 includes the whole of the query's own.
        assert (evidence.unseen[kind] > evidence.seen[kind]).mean() > 0.9
    for threshold in Rejection().thresholds(model, KINDS):
        assert threshold > ACCEPT_NOTHING


@pytest.mark.parametrize("colormap", ["jet", "grey"])
def test_grey_images_are_learned_too(colormap: str) -> None:
    learned = replace(SMALL, colormap=colormap, epochs=2).learn(rows(2), TRUTH, Progress())  # type: ignore[arg-type]
    assert learned["net/features.0.weight"].shape[1] == {"jet": 3, "grey": 1}[colormap]
