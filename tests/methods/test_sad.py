"""Tests of SAD as a method: it answers with the sequence of normalised bird-views that differs
least, all at the robot's own heading."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.matching.patches import differences, normalised
from pipeline.matching.ranking import Localizer
from pipeline.matching.rejection import ACCEPT_NOTHING, NoveltyEvidence, Rejection
from pipeline.methods.sad import Sad
from pipeline.readers.kitti import read_velodyne
from tests.interrupted import same
from tests.matching.made import along as rows

N = 240


def street(rng: np.random.Generator) -> np.ndarray:
    """Bird-views (n, 4, 64, 64) of a street without end that moves by a pixel a row, and noise at
    the other headings."""
    ground = rng.random((N + 64, 64)) < 0.2
    headings = rng.integers(0, 256, (N, 4, 64, 64), dtype=np.uint8)
    headings[:, 0] = [255 * ground[i : i + 64][::-1] for i in range(N)]
    return headings


def another_day(headings: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A tenth of the pixels are anything, and all of it is darker."""
    other = np.where(
        rng.random(headings.shape) < 0.1, rng.integers(0, 256, headings.shape), headings
    )
    return (other * 0.5).astype(np.uint8)


STREET = street(np.random.default_rng(0))
PLACES = np.arange(N) // 20


def learned(images: np.ndarray, places: np.ndarray = PLACES, **settings: Any) -> Localizer:
    method = Sad(**settings)
    return method.localizer(method.learn(rows(images), places, Progress()))


def test_a_street_is_known_on_another_day_and_another_street_is_new() -> None:
    method = Sad(validation_every_m=40.0, validation_length_m=20.0)
    rng = np.random.default_rng(1)
    model = method.learn(rows(STREET), PLACES, Progress())
    evidence = NoveltyEvidence.of(model)
    assert evidence.right.mean() > 0.8
    assert (evidence.unseen["cost"] > evidence.seen["cost"])[evidence.right].all()
    # Six blocks, nine tenths right: at most .9 · 4.8 of 4.8 answers, and one more counted wrong,
    # are .745.
    ((threshold, _),) = Rejection(target_precision=0.7).thresholds(model, ("cost",))
    assert threshold > ACCEPT_NOTHING
    localize = method.localizer(model)
    known = localize(rows(another_day(STREET[50:150], rng)), 5)
    assert (known.places[:, 0] == PLACES[50:150]).mean() > 0.9
    np.testing.assert_array_less(np.abs(known.xy_m[:, 0, 0] - np.arange(50, 150)), 2)
    assert known.places.shape == (100, 5)
    assert np.isnan(known.heading_deg).all()
    new = localize(rows(street(rng)[:100]), 1)
    assert (known.novelty[:, 0] < threshold).mean() > 0.9
    assert (new.novelty[:, 0] >= threshold).mean() > 0.9


def test_a_view_turned_by_half_a_circle_is_another_image_and_one_alone_is_answered_by_its_own_differences() -> (
    None
):
    localize = learned(STREET)
    turned = localize(rows(STREET[50:150, :, ::-1, ::-1]), 1)
    assert (turned.places[:, 0] == PLACES[50:150]).mean() < 0.2
    assert turned.novelty[:, 0].min() > localize(rows(STREET[50:150]), 1).novelty[:, 0].max()
    ranking = learned(STREET, normalisation_rows=40)(rows(STREET[[100]]), 3)
    assert ranking.xy_m[0, 0, 0] == 100
    assert np.isfinite(ranking.novelty).all()


def test_only_the_first_heading_is_looked_at() -> None:
    blind = STREET.copy()
    blind[:, 1:] = 0
    assert same(*(Sad().learn(rows(images), PLACES, Progress()) for images in (STREET, blind)))


def test_of_several_reference_headings_the_nearest_is_reported() -> None:
    images = STREET.copy()
    images[:, 2] = images[:, 0, ::-1, ::-1]
    localize = learned(images, reference_headings=2)
    for quarters in (0, 2):
        ranking = localize(rows(np.roll(images[50:150], -quarters, axis=1)), 1)
        assert (ranking.places[:, 0] == PLACES[50:150]).mean() > 0.9
        assert (np.abs(ranking.heading_deg[:, 0]) == 90 * quarters).mean() > 0.9
    model = Sad(reference_headings=2).learn(rows(images), PLACES, Progress())
    assert model["images"].shape == (N, 2, 64, 64)
    assert np.array_equal(model["images"][:, 1], normalised(images[:, 2]))


def test_a_model_is_the_normalised_images_of_four_kilobytes_each() -> None:
    large = np.repeat(np.repeat(STREET[:30], 2, axis=2), 2, axis=3)  # 128 × 128 pixels
    model = Sad().learn(rows(large), PLACES[:30], Progress())
    assert model["images"].shape == (30, 1, 64, 64)
    assert model["images"].dtype == np.uint8
    np.testing.assert_array_equal(model["images"][:, 0], normalised(STREET[:30, 0]))
    small = Sad(side_px=32, patch_px=4).learn(rows(STREET[:30]), PLACES[:30], Progress())
    assert small["images"].shape == (30, 1, 32, 32)


def test_a_moved_model_knows_another_street_and_rejects_as_before() -> None:
    method = Sad()
    elsewhere = street(np.random.default_rng(2))
    model = method.learn(rows(STREET), PLACES, Progress())
    moved = method.moved(model, rows(elsewhere), np.arange(N))
    assert moved.keys() == model.keys()
    assert Rejection().thresholds(moved, ("cost", "ratio")) == Rejection().thresholds(
        model, ("cost", "ratio")
    )
    assert (
        method.localizer(moved)(rows(elsewhere[20:90]), 1).places[:, 0] == np.arange(20, 90)
    ).all()


def test_the_drive_home_is_known_from_a_view_that_is_the_same_from_behind() -> None:
    images = STREET[:80].copy()
    images[:, 0] = np.maximum(images[:, 0], images[:, 0, ::-1])
    localize = learned(images, np.arange(80), both_ways=True)
    assert (localize(rows(images[60:20:-1]), 1).places[:, 0] == np.arange(60, 20, -1)).mean() > 0.9


def test_real_scans_find_their_neighbours(real: Path) -> None:
    # Sixteen scans along 13 m of a street: every second is the reference, and each other one finds
    # a scan beside it.
    scans = [
        read_velodyne(path) for path in sorted((real / "kitti/sequences/00/velodyne").glob("*.bin"))
    ]
    images = np.zeros((16, 1, 64, 64), np.uint8)
    for image, scan in zip(images[:, 0], scans, strict=True):
        x, y, z = scan[:, :3].T.astype(float)
        there = (np.abs(x) < 15) & (np.abs(y) < 15) & (z > -1.4) & (z < 3)
        image[((15 - x[there]) / 30 * 64).astype(int), ((15 - y[there]) / 30 * 64).astype(int)] = (
            255
        )
    drive = learned(images[::2], np.arange(8), normalisation_rows=30)(rows(images[1::2]), 1).places[
        :, 0
    ]
    assert (np.abs(drive - (np.arange(8) + 0.5)) < 2).all()
    alone = differences(normalised(images[::2, 0]), normalised(images[1::2, 0])).argmin(axis=0)
    assert (np.abs(alone - (np.arange(8) + 0.5)) < 2).mean() > 0.7


def test_views_without_a_place_are_refused() -> None:
    with pytest.raises(InputError, match="known place"):
        Sad().learn(rows(STREET), PLACES - 1, Progress())
