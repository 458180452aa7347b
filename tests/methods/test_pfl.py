"""Tests of PFL on a short made-up drive: it recognises places under noise and at other headings,
and takes another drive as its reference."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from pipeline.core.progress import Progress
from pipeline.matching.ranking import Model, Rows
from pipeline.matching.rejection import NoveltyEvidence, Rejection
from pipeline.methods.pfl.bigan import Encoder
from pipeline.methods.pfl.features import JUDGED_IMAGES
from pipeline.methods.pfl.game import OBJECTIVES
from pipeline.methods.pfl.pfl import Pfl
from tests.learning import Clears
from tests.matching.made import along

ROWS = 24
HEADINGS = 16
PLACES = np.repeat(np.arange(6), 4)
SMALL = Pfl(
    width=2,
    epochs=1,
    batch=16,
    learning_rate=0.002,
    generator_steps=1,
    precision="f32",
    threads=1,
    length=4,
    validation_every_m=24,
    validation_length_m=8,
    neighbour_m=5,
)
PROGRESS = Progress(budget=0.25)
"""16 rows of 16 headings in batches of 16 are 16 iterations: a quarter of them in two rounds of
2."""


def rows(seed: int = 1) -> Rows:
    """A place a row, 2 m apart: four pictures turned by quarters, each standing for four headings;
    noise in every image."""
    blobs = gaussian_filter(np.random.default_rng(0).normal(size=(ROWS, 64, 64)), (0, 4, 4))
    quarters = np.stack(
        [np.rot90(blobs > 0.05, -turns, (1, 2)) for turns in range(4)], axis=1
    ).repeat(4, axis=1)
    flipped = np.random.default_rng(seed).random(quarters.shape) < 0.02
    return along((255 * (quarters ^ flipped)).astype(np.uint8), 2.0)


@pytest.fixture(scope="module")
def model(seed: int) -> Model:
    return replace(SMALL, seed=seed).learn(rows(), PLACES, PROGRESS)


@pytest.mark.learning
def test_noisy_views_are_known_and_their_heading_reported(model: Model, clears: Clears) -> None:
    ranking = SMALL.localizer(model)(rows(2), 3)
    clears((ranking.places[:, 0] == PLACES).mean(), 0.8)
    assert np.abs(ranking.xy_m[:, 0, 0] - 2 * np.arange(ROWS)).mean() < 1
    assert ranking.kinds == ("cost", "ratio")
    # Headings 0 and 45 show the same picture here; the first of equals is reported for most.
    clears(np.isin(ranking.heading_deg[:, 0], [0, 45]).mean(), 0.8)


@pytest.mark.learning
@pytest.mark.parametrize(
    ("quarters", "reported"), [(1, (90, 135)), (2, (180, -135)), (3, (-90, -45))]
)
def test_a_turned_robot_is_known_and_reported(
    model: Model, quarters: int, reported: tuple[float, float], clears: Clears
) -> None:
    turned = replace(rows(2), images=np.roll(rows(2).images, -4 * quarters, axis=1))
    ranking = SMALL.localizer(model)(turned, 1)
    clears((ranking.places[:, 0] == PLACES).mean(), 0.8)
    clears(np.isin(ranking.heading_deg[:, 0], reported).mean(), 0.8)


def test_the_model_holds_eight_codes_of_a_kilobyte_a_place_its_pictures_and_all_curves(
    model: Model,
) -> None:
    assert model["codes"].shape == (ROWS, 8, 512)
    assert model["codes"].dtype == np.float16
    assert model["codes"][0, 0].nbytes == 1024
    names = {name.partition("/")[2] for name in model if name.startswith("curves/")}
    assert names == {
        "joint_discriminator",
        "joint_generator",
        "image_discriminator",
        "image_generator",
        "image_cycle",
        "code_cycle",
        "validation_accuracy",
        "validation_error",
        "black_error",
        "code_variance",
        "code_distance",
    }
    held = SMALL.validation(rows())
    assert 0 < held.sum() < ROWS
    assert np.array_equal(model["pictures/seen"], rows().images[held, 0])
    assert model["pictures/reconstructed"].shape == model["pictures/seen"].shape
    assert model["pictures/reconstructed"].dtype == np.uint8
    assert np.array_equal(
        SMALL.reconstructed(model, model["pictures/seen"]), model["pictures/reconstructed"]
    )
    assert len(NoveltyEvidence.of(model).right) > 0
    assert len(Rejection().thresholds(model, ("cost", "ratio"))) == 2
    encode = SMALL.encoder(model)
    images = rows().images[:5, 0]
    np.testing.assert_allclose(
        encode(images), np.concatenate([encode(image[None]) for image in images]), atol=1e-4
    )


def test_the_networks_do_not_see_validation_rows() -> None:
    """In one round, for validation rows choose which round is kept."""
    held = SMALL.validation(rows())
    spoilt = rows()
    spoilt.images[held] = 128
    model, other = (
        SMALL.learn(views, PLACES, Progress(budget=0.125)) for views in (rows(), spoilt)
    )
    assert len(model["curves/image_cycle"]) == 1
    assert all(
        np.array_equal(model[name], other[name]) for name in model if name.startswith("net/")
    )
    assert np.array_equal(model["codes"][~held], other["codes"][~held])
    assert not np.array_equal(model["codes"][held], other["codes"][held])


def test_views_of_other_number_types_and_none_at_all_are_answered(model: Model) -> None:
    rank = SMALL.localizer(model)
    floats = along(rows(2).images.astype(np.float32), 2.0)
    assert np.array_equal(rank(floats, 2).costs, rank(rows(2), 2).costs)
    assert [rank(rows(2).select(slice(n)), 2).places.shape for n in (0, 1)] == [(0, 2), (1, 2)]


def test_a_model_can_be_moved_to_another_drive(model: Model) -> None:
    elsewhere = rows(3)
    elsewhere.world_T_anchor[:, 0, 3] += 500
    moved = SMALL.moved(model, elsewhere, np.arange(ROWS))
    assert moved.keys() == model.keys()
    assert {name for name in model if not np.array_equal(model[name], moved[name])} == {
        "codes",
        "database/places",
        "database/xy_m",
    }
    # The network keeps its own width
    ranking = Pfl(length=4, precision="f32", threads=1).localizer(moved)(rows(4), 1)
    assert np.abs(ranking.xy_m[:, 0, 0] - 500 - 2 * np.arange(ROWS)).mean() < 1


def test_an_untrained_encoder_ranks_through_the_same_matching(model: Model) -> None:
    untrained = replace(SMALL, epochs=0)
    drawn = untrained.learn(rows(), PLACES, Progress())
    assert drawn.keys() >= {name for name in model if not name.startswith("curves/")}
    assert {len(drawn[name]) for name in drawn if name.startswith("curves/")} == {1}
    assert not np.array_equal(drawn["codes"], model["codes"])
    torch.manual_seed(0)
    weights = Encoder(SMALL.width).state_dict()["dense.weight"]
    assert np.array_equal(drawn["net/encoder.dense.weight"], weights.numpy())
    ranking = untrained.localizer(drawn)(rows(2), 3)
    assert ranking.places.shape == (ROWS, 3)
    assert np.isfinite(ranking.costs).all()
    assert len(np.unique(ranking.costs[:, 0])) > 1


def test_a_black_image_is_judged_on_the_images_that_the_reconstructions_are(model: Model) -> None:
    images = rows().images[SMALL.validation(rows())].reshape(-1, 64, 64)
    assert len(images) <= JUDGED_IMAGES
    black = np.square(images / 127.5).mean()
    np.testing.assert_allclose(model["curves/black_error"], black, rtol=1e-5)


def test_of_fewer_reference_headings_fewer_codes_are_kept(model: Model) -> None:
    views = rows(2)
    for kept, step in ((1, 8), (2, 4), (4, 2)):
        few = replace(SMALL, reference_headings=kept).moved(model, rows(), PLACES)
        assert np.array_equal(few["codes"], model["codes"][:, ::step])
        reported = SMALL.localizer(few)(views, 1).heading_deg
        assert set(np.unique(reported)) <= {-360 / kept * turn for turn in range(-8, 9)}


def test_the_objective_is_the_presets() -> None:
    assert replace(SMALL, objective="paper").terms() == OBJECTIVES["paper"]
