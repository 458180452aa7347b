"""Kinds of novelty of logits, with numbers worked out by hand."""

import numpy as np
import pytest

from pipeline.matching.novelties import normalised_entropy, novelties


def test_each_novelty_is_what_its_name_says() -> None:
    # Logits (ln 2, ln 1, ln 1): probabilities .5 .25 .25, entropy 1.5 bits of log2 3; energy −ln 4.
    # At temperature .5 the odds are squared: 4 1 1, so 2/3 1/6 1/6.
    entropy, tempered, energy, distance = novelties(
        np.log([[2.0, 1.0, 1.0]]), 0.5, np.array([0.9])
    ).values()
    np.testing.assert_allclose(entropy, 1.5 / np.log2(3))
    np.testing.assert_allclose(tempered, (2 / 3 * np.log2(1.5) + 1 / 3 * np.log2(6)) / np.log2(3))
    np.testing.assert_allclose(energy, -np.log(4))
    np.testing.assert_allclose(distance, 0.1)


@pytest.mark.parametrize(
    ("probability", "entropy"),
    [
        ((0.25,) * 4, 1.0),
        ((0, 1, 0, 0), 0.0),
        ((0.5, 0.25, 0.125, 0.125), 0.875),
        ((0.7, 0.2, 0.1), 0.729847),
        ((1,), 0.0),
    ],
)
def test_entropy_is_normalised_as_the_authors_do(
    probability: tuple[float, ...], entropy: float
) -> None:
    np.testing.assert_allclose(
        normalised_entropy(np.array([probability], float)), [entropy], atol=5e-7
    )
