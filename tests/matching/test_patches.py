"""Normalised patches and sums of absolute differences, against the official code's numbers and
plain numpy.
"""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.matching.patches import differences, normalised, resized


def test_the_official_code_s_patches() -> None:
    image = ((37 * np.arange(256)) % 251).reshape(16, 16, order="F").astype(np.uint8)
    patches = normalised(image[None])
    np.testing.assert_array_equal(patches[0, :8, 0], [125, 126, 126, 127, 127, 128, 128, 125])
    assert patches.sum(dtype=int) == 32509


def test_each_patch_has_its_own_mean_and_spread_so_brightness_and_contrast_do_not_count() -> None:
    images = np.random.default_rng(0).integers(0, 256, (3, 24, 16), dtype=np.uint8)
    patches = images.reshape(3, 3, 8, 2, 8).astype(float)
    above = patches - patches.mean(axis=(2, 4), keepdims=True)
    expected = 127 + np.rint(above / patches.std(axis=(2, 4), ddof=1, keepdims=True))
    np.testing.assert_array_equal(normalised(images).reshape(patches.shape), expected)
    assert (normalised(np.full((1, 8, 8), 255, np.uint8)) == 127).all()
    image = np.random.default_rng(0).integers(0, 100, (1, 8, 8), dtype=np.uint8)
    np.testing.assert_array_equal(normalised(image), normalised(2 * image + 50))


def test_halves_are_rounded_away_from_the_mean() -> None:
    # About 9: five pairs of ±1, one of ±5, four of 0. The squares sum to 60, so a standard
    # deviation is √(60 / 15) = 2.
    patch = np.array([8, 10] * 5 + [4, 14] + [9] * 4, np.uint8).reshape(1, 4, 4)
    np.testing.assert_array_equal(
        normalised(patch, 4).ravel(), [126, 128] * 5 + [124, 130] + [127] * 4
    )


def test_the_official_code_s_differences_and_none_wraps_around() -> None:
    references = np.array([[1, 3], [2, 4]], np.uint8)
    queries = np.array([[0, 1], [5, 1], [2, 9]], np.uint8)
    np.testing.assert_array_equal(differences(references, queries), [[1.5, 3, 3.5], [2.5, 3, 2.5]])
    rng = np.random.default_rng(0)
    references, queries = (rng.integers(0, 256, (n, 9, 7), dtype=np.uint8) for n in (5, 130))
    expected = np.abs(references[:, None].astype(float) - queries).sum(axis=(2, 3)) / 5
    np.testing.assert_allclose(differences(references, queries), expected, rtol=1e-7)
    assert (
        differences(np.zeros((1, 64, 64), np.uint8), np.full((1, 64, 64), 255, np.uint8))
        == 255 * 4096
    )
    assert differences(references, queries[:0]).shape == (5, 0)


def test_a_new_side_is_the_mean_of_what_a_pixel_covers() -> None:
    image = np.arange(36, dtype=np.uint8).reshape(1, 6, 6)
    np.testing.assert_array_equal(resized(image, 6), image)
    np.testing.assert_array_equal(
        resized(image, 3), np.rint(image.reshape(1, 3, 2, 3, 2).mean(axis=(2, 4)))
    )
    # A pixel of 1.5 covers pixel 0 and half of pixel 1, along both sides: (0 + 1/2) / 1.5 = 1/3,
    # rows 6 times that.
    assert resized(image, 4)[0, 0, 0] == np.rint(7 / 3)
    assert (resized(np.full((2, 3, 3), 255, np.uint8), 64) == 255).all()


def test_images_that_do_not_fit_are_refused() -> None:
    with pytest.raises(
        InputError, match=r"\(1, 12, 8\): expected \(n, height, width\) in whole patches of 8"
    ):
        normalised(np.zeros((1, 12, 8), np.uint8))
    with pytest.raises(InputError, match=r"\(8, 8\): expected \(16, 16\) like the references"):
        differences(np.zeros((2, 16, 16), np.uint8), np.zeros((2, 8, 8), np.uint8))
