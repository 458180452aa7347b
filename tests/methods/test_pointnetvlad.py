"""PointNetVLAD on a few made-up places: it learns, goes on where it was cut, and takes a user's weights."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from pipeline.errors import ConfigError, InputError
from pipeline.matching import holdout
from pipeline.matching.ranking import Model, Ranking, Rows
from pipeline.matching.rejection import Evidence, Rejection
from pipeline.methods.pointnetvlad import pointnetvlad
from pipeline.methods.pointnetvlad.pointnetvlad import PointNetVlad
from pipeline.running.progress import Progress
from tests.interrupted import PowerCut, same

PLACES, EACH, POINTS = 6, 6, 64
TRUTH = np.repeat(np.arange(PLACES), EACH)
SMALL = PointNetVlad(
    epochs=1, negatives=4, hard_negatives=2, positive_m=4, negative_m=8, train_points=48, learning_rate=0.001,
    precision="f32", threads=1, held_out_every_m=9, held_out_length_m=2, neighbour_m=7,
)  # fmt: skip


def rows(seed: int = 2, views: int = PLACES * EACH, clutter: float = 0.0) -> Rows:
    """PLACES scenes of three boxes each, seen EACH times with noise, a metre apart along x; a share of points is clutter:
    three boxes of each view's own."""
    centres = np.random.default_rng(0).uniform(-0.8, 0.8, (PLACES, 3, 3))
    rng = np.random.default_rng(seed)
    box = rng.integers(3, size=(views, POINTS))
    clouds = centres[TRUTH[:views, None], box] + rng.uniform(-0.15, 0.15, (views, POINTS, 3))
    own = rng.uniform(-0.8, 0.8, (views, 3, 3))[np.arange(views)[:, None], box]
    clouds = np.where(rng.random((views, POINTS, 1)) < clutter, own, clouds)
    poses = np.tile(np.eye(4), (views, 1, 1))
    poses[:, 0, 3] = np.arange(views)
    return Rows(clouds.clip(-1, 1).astype(np.float16), np.arange(views), poses)


@pytest.fixture(scope="module", autouse=True)
def small_network() -> Iterator[None]:
    """32 numbers of 8 clusters of 64 features: 300 thousand weights to write to a checkpoint instead of 20 million."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pointnetvlad, "Describer", partial(pointnetvlad.Describer, 64, 8, 32))
        yield


@pytest.fixture(scope="module")
def model() -> Model:
    return SMALL.learn(rows(), TRUTH, Progress())


@pytest.fixture(scope="module")
def ranking(model: Model) -> Ranking:
    return SMALL.localizer(model)(rows(3), 3)


def test_places_are_told_apart(ranking: Ranking, model: Model) -> None:
    assert (ranking.places[:, 0] == TRUTH).mean() > 0.9
    assert np.array_equal(ranking.novelty[:, 0], ranking.costs[:, 0])
    assert np.isnan(ranking.heading_deg).all()
    assert ranking.kinds == ("distance",)
    np.testing.assert_allclose(np.linalg.norm(model["descriptors"], axis=1), 1, atol=1e-5)


def test_training_makes_positives_nearer_than_negatives(model: Model) -> None:
    curves = [model[f"curves/{name}"] for name in ("loss", "accuracy", "held_out_loss", "held_out_accuracy")]
    assert all(np.isfinite(curve).all() and curve.shape == curves[0].shape for curve in curves)
    longer = replace(SMALL, epochs=6, hard_negatives=0, learning_rate=0.0003).learn(rows(clutter=0.7), TRUTH, Progress())
    assert longer["curves/loss"][-1] < 0.3 * longer["curves/loss"][0]
    assert longer["curves/accuracy"][0] < 0.8 < longer["curves/accuracy"][-1]
    assert longer["curves/held_out_loss"][-1] < 0.7 * longer["curves/held_out_loss"][0]


def test_the_database_holds_the_blocks_that_training_did_not_see(model: Model) -> None:
    held = holdout.blocks(rows().world_T_anchor, TRUTH, 9, 2)
    assert 0 < held.sum() == len(Evidence.of(model).right)
    assert len(model["descriptors"]) == PLACES * EACH
    spoilt = rows()
    spoilt.images[held] = 0.5
    other = SMALL.learn(spoilt, TRUTH, Progress(budget=0.01))
    clean = SMALL.learn(rows(), TRUTH, Progress(budget=0.01))
    assert all(np.array_equal(clean[name], other[name]) for name in clean if name.startswith("net/"))
    assert np.array_equal(clean["descriptors"][~held], other["descriptors"][~held])
    assert not np.array_equal(clean["descriptors"][held], other["descriptors"][held])
    assert len(Rejection().thresholds(model, ("distance",))) == 1


def test_the_same_seed_gives_the_same_bytes(model: Model) -> None:
    assert same(SMALL.learn(rows(), TRUTH, Progress()), model)
    assert not same(replace(SMALL, seed=1).learn(rows(), TRUTH, Progress()), model)


def test_an_interrupted_training_with_hard_negatives_goes_on_to_the_same_bytes(tmp_path: Path) -> None:
    longer = replace(SMALL, epochs=2)  # 28 queries a time, 2 a step: three rounds of 10 steps, the second and third with mining
    whole = longer.learn(rows(), TRUTH, Progress())
    assert len(whole["curves/loss"]) == 3
    with pytest.raises(KeyboardInterrupt):
        longer.learn(rows(), TRUTH, PowerCut(checkpoint=tmp_path / "half"))
    assert (tmp_path / "half").is_file()
    assert same(longer.learn(rows(), TRUTH, Progress(checkpoint=tmp_path / "half")), whole)


def test_a_model_can_be_used_as_weights(model: Model, tmp_path: Path) -> None:
    save_file({name: np.require(array, requirements="C") for name, array in model.items()}, tmp_path / "model.safetensors")
    taken = replace(SMALL, weights=str(tmp_path / "model.safetensors"), epochs=0).learn(rows(), TRUTH, Progress())
    learning = ("curves/", "best_epoch")
    assert {name for name in model if not name.startswith(learning)} == set(taken)
    assert all(np.array_equal(model[name], taken[name]) for name in taken)
    bare = {name.removeprefix("net/"): array for name, array in model.items() if name.startswith("net/")}
    bare = {name: np.require(array, requirements="C") for name, array in bare.items() if "num_batches_tracked" not in name}
    save_file(bare, tmp_path / "bare.safetensors")
    started = replace(SMALL, weights=str(tmp_path / "bare.safetensors"), epochs=0).learn(rows(), TRUTH, Progress())
    assert np.array_equal(started["descriptors"], model["descriptors"])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda net: net.pop("netvlad.centres"), r"netvlad\.centres is none, expected \(64, 8\)"),
        (lambda net: net.update({"pointnet.extra": np.ones(3, np.float32)}), r"pointnet\.extra is \(3,\), expected none"),
        (
            lambda net: net.update({"netvlad.centres": np.ones((8, 64), "f4")}),
            r"netvlad\.centres is \(8, 64\), expected \(64, 8\)",
        ),
    ],
)
def test_weights_of_another_network_are_a_config_error(
    model: Model, tmp_path: Path, spoil: Callable[[dict[str, np.ndarray]], object], said: str
) -> None:
    net = {
        name.removeprefix("net/"): np.require(array, requirements="C") for name, array in model.items() if name.startswith("net/")
    }
    spoil(net)
    save_file(net, tmp_path / "w.safetensors")
    assert load_file(tmp_path / "w.safetensors")
    with pytest.raises(ConfigError, match=rf"w\.safetensors: tensor {said}"):
        replace(SMALL, weights=str(tmp_path / "w.safetensors"), epochs=0).learn(rows(), TRUTH, Progress())


@pytest.mark.parametrize("content", [None, b"not a safetensors file"])
def test_weights_that_cannot_be_read_are_a_config_error(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "w.safetensors"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"w\.safetensors: (no|not a) [^;]*; correct method\.weights$"):
        replace(SMALL, weights=str(path)).learn(rows(), TRUTH, Progress())


def test_views_that_are_no_clouds_are_refused(model: Model) -> None:
    images = Rows(np.zeros((4, 40, 120), np.float32), np.arange(4), rows(views=4).world_T_anchor)
    with pytest.raises(InputError, match="clouds"):
        SMALL.localizer(model)(images, 1)


def test_clouds_can_be_turned_while_training(model: Model) -> None:
    turned = replace(SMALL, turn_deg=90.0).learn(rows(), TRUTH, Progress(budget=0.01))
    plain = SMALL.learn(rows(), TRUTH, Progress(budget=0.01))
    assert not np.array_equal(turned["curves/loss"], plain["curves/loss"])


def test_distinct_places_are_answered_once_each(model: Model) -> None:
    ranking = replace(SMALL, distinct_places=True).localizer(model)(rows(3), 3)
    assert all(len(set(places)) == 3 for places in ranking.places)
    assert SMALL.localizer(model)(rows(3, views=6), 2).places.shape == (6, 2)
