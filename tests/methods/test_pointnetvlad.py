"""Tests of PointNetVLAD on a few made-up places: it learns them, and takes a user's weights."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.matching import holdout
from pipeline.matching.ranking import Model, Ranking, Rows
from pipeline.matching.rejection import NoveltyEvidence, Rejection
from pipeline.methods.pointnetvlad.pointnetvlad import PointNetVlad
from tests.interrupted import same
from tests.learning import Clears
from tests.matching.made import along

PLACES = 6
EACH = 6
POINTS = 64
GROUND_TRUTH = np.repeat(np.arange(PLACES), EACH)
SMALL = PointNetVlad(
    epochs=1,
    negatives=4,
    hard_negatives=2,
    positive_m=4,
    negative_m=8,
    train_points=48,
    learning_rate=0.001,
    precision="f32",
    threads=1,
    validation_every_m=9,
    validation_length_m=2,
    neighbour_m=7,
)


def rows(seed: int = 2, views: int = PLACES * EACH, clutter: float = 0.0) -> Rows:
    """PLACES scenes of three boxes each, seen EACH times with noise, a metre apart along x; a share
    of points is clutter: three boxes of each view's own."""
    centres = np.random.default_rng(0).uniform(-0.8, 0.8, (PLACES, 3, 3))
    rng = np.random.default_rng(seed)
    box = rng.integers(3, size=(views, POINTS))
    clouds = centres[GROUND_TRUTH[:views, None], box] + rng.uniform(-0.15, 0.15, (views, POINTS, 3))
    own = rng.uniform(-0.8, 0.8, (views, 3, 3))[np.arange(views)[:, None], box]
    clouds = np.where(rng.random((views, POINTS, 1)) < clutter, own, clouds)
    return along(clouds.clip(-1, 1).astype(np.float16))


@pytest.fixture(scope="module")
def model(seed: int) -> Model:
    return replace(SMALL, seed=seed).learn(rows(), GROUND_TRUTH, Progress())


@pytest.fixture(scope="module")
def ranking(model: Model) -> Ranking:
    return SMALL.localizer(model)(rows(3), 3)


@pytest.mark.learning
def test_places_are_distinguished(ranking: Ranking, model: Model, clears: Clears) -> None:
    clears((ranking.places[:, 0] == GROUND_TRUTH).mean(), 0.8)
    assert np.array_equal(ranking.novelty[:, 0], ranking.costs[:, 0])
    assert np.isnan(ranking.heading_deg).all()
    assert ranking.kinds == ("distance",)
    np.testing.assert_allclose(np.linalg.norm(model["descriptors"], axis=1), 1, atol=1e-5)


@pytest.mark.learning
def test_training_makes_positives_nearer_than_negatives(
    model: Model, seed: int, clears: Clears
) -> None:
    curves = [
        model[f"curves/{name}"]
        for name in ("loss", "accuracy", "validation_loss", "validation_accuracy")
    ]
    assert all(np.isfinite(curve).all() and curve.shape == curves[0].shape for curve in curves)
    slowly = replace(SMALL, epochs=8, hard_negatives=0, learning_rate=0.0003, seed=seed)
    longer = slowly.learn(rows(clutter=0.7), GROUND_TRUTH, Progress())
    clears(1 - longer["curves/loss"][-1] / longer["curves/loss"][0], 0.5)
    clears(longer["curves/accuracy"][-1] - longer["curves/accuracy"][0], 0.0)
    clears(1 - longer["curves/validation_loss"][-1] / longer["curves/validation_loss"][0], 0.1)


def test_the_database_holds_the_blocks_that_training_did_not_see_and_clouds_can_be_turned_while_training(
    model: Model,
) -> None:
    held = holdout.blocks(rows().world_T_anchor, GROUND_TRUTH, 9, 2)
    assert 0 < held.sum() == len(NoveltyEvidence.of(model).right)
    assert len(model["descriptors"]) == PLACES * EACH
    spoilt = rows()
    spoilt.images[held] = 0.5
    other = SMALL.learn(spoilt, GROUND_TRUTH, Progress(budget=0.01))
    clean = SMALL.learn(rows(), GROUND_TRUTH, Progress(budget=0.01))
    turned = replace(SMALL, turn_deg=90.0).learn(rows(), GROUND_TRUTH, Progress(budget=0.01))
    assert not np.array_equal(turned["curves/loss"], clean["curves/loss"])
    assert all(
        np.array_equal(clean[name], other[name]) for name in clean if name.startswith("net/")
    )
    assert np.array_equal(clean["descriptors"][~held], other["descriptors"][~held])
    assert not np.array_equal(clean["descriptors"][held], other["descriptors"][held])
    assert len(Rejection().thresholds(model, ("distance",))) == 1


def used(weights: Model, path: Path) -> Model:
    """The model that comes of these weights without training."""
    save_file({name: np.require(array, requirements="C") for name, array in weights.items()}, path)
    return replace(SMALL, weights=str(path), epochs=0).learn(rows(), GROUND_TRUTH, Progress())


def network(model: Model) -> dict[str, np.ndarray]:
    return {
        name.removeprefix("net/"): array for name, array in model.items() if name.startswith("net/")
    }


def test_a_model_can_be_used_as_weights(model: Model, tmp_path: Path) -> None:
    taken = used(model, tmp_path / "model.safetensors")
    assert same(
        taken,
        {
            name: array
            for name, array in model.items()
            if not name.startswith(("curves/", "best_epoch"))
        },
    )
    bare = {
        name: array for name, array in network(model).items() if "num_batches_tracked" not in name
    }
    assert np.array_equal(
        used(bare, tmp_path / "bare.safetensors")["descriptors"], model["descriptors"]
    )


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda net: net.pop("netvlad.centres"), r"netvlad\.centres is none, expected \(64, 8\)"),
        (
            lambda net: net.update({"pointnet.extra": np.ones(3, np.float32)}),
            r"pointnet\.extra is \(3,\), expected none",
        ),
        (
            lambda net: net.update({"netvlad.centres": np.ones((8, 64))}),
            r"netvlad\.centres is \(8, 64\), expected \(64, 8\)",
        ),
    ],
)
def test_weights_of_another_network_are_a_config_error(
    model: Model, tmp_path: Path, spoil: Callable[[dict[str, np.ndarray]], object], said: str
) -> None:
    net = network(model)
    spoil(net)
    with pytest.raises(ConfigError, match=rf"w\.safetensors: tensor {said}"):
        used(net, tmp_path / "w.safetensors")


@pytest.mark.parametrize("content", [None, b"not a safetensors file"])
def test_weights_that_cannot_be_read_are_a_config_error(
    tmp_path: Path, content: bytes | None
) -> None:
    path = tmp_path / "w.safetensors"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(
        ConfigError, match=r"w\.safetensors: (no|not a) [^;]*; correct method\.weights$"
    ):
        replace(SMALL, weights=str(path)).learn(rows(), GROUND_TRUTH, Progress())


def test_distinct_places_are_answered_once_each(model: Model) -> None:
    ranking = replace(SMALL, distinct_places=True).localizer(model)(rows(3), 3)
    assert all(len(set(places)) == 3 for places in ranking.places)
    assert SMALL.localizer(model)(rows(3, views=6), 2).places.shape == (6, 2)
