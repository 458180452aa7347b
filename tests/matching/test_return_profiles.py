"""Re-ranking by return profiles: hidden sectors say nothing, gone objects speak against a place.

Three places have four training views with random return profiles.
"""

import numpy as np
import pytest

from pipeline.matching.return_profiles import (
    AGREEMENT_NATS,
    GONE_WEIGHT,
    NO_RING,
    ReturnProfiles,
    reranked,
    return_profiles,
)

SECTORS = 120
RNG = np.random.default_rng(3)
SHAPES = RNG.integers(3, 30, (4, SECTORS)).astype(np.int16)
"""The return profiles of the training views."""
LEARNED = ReturnProfiles(
    SHAPES, np.array([0, 1, 2, 2]), np.array([0.0, 30.0, 60.0, 100.0], np.float32)
)
LEVEL = np.zeros((1, 3))
"""Scores of a network that finds all three places equally likely."""


def seen(view: int, turn: int) -> np.ndarray:
    """The return profile that a sensor sees at a training view, turned to the left by `turn`
    columns."""
    return np.roll(SHAPES[view : view + 1], -turn, axis=1)


def test_a_return_profile_is_the_first_ring_with_a_standing_object() -> None:
    heights = np.zeros((2, 5, 3))
    heights[0, [1, 3], 0] = 4.0, 9.0
    heights[0, 2, 1] = 1.5  # no more than grass
    heights[1, 4, 2] = 1.6
    assert return_profiles(heights).tolist() == [[1, NO_RING, NO_RING], [NO_RING, NO_RING, 4]]


@pytest.mark.parametrize(("view", "place"), [(0, 0), (1, 1), (2, 2), (3, 2)])
@pytest.mark.parametrize("turn", [-5, 0, 7])
def test_a_place_seen_again_is_first_and_tells_the_heading(
    view: int, place: int, turn: int
) -> None:
    yaw_deg = 3 * (float(LEARNED.columns[view]) + turn)
    network_deg = np.full((1, 3), yaw_deg + 4.0)  # the network is off by 4 degrees
    scores, headings = reranked(LEVEL, network_deg, seen(view, turn), LEARNED)
    assert scores[0].argmax() == place
    assert scores[0, place] == pytest.approx(AGREEMENT_NATS * SECTORS)
    assert (headings[0, place] - yaw_deg + 180) % 360 - 180 == pytest.approx(0, abs=1e-4)


def test_what_hides_a_place_costs_its_sectors_and_what_is_gone_costs_more() -> None:
    network_deg = np.zeros((1, 3))
    hidden = seen(0, 0).copy()
    gone = seen(0, 0).copy()
    hidden[0, :20] = 0
    gone[0, :20] = NO_RING
    assert reranked(LEVEL, network_deg, hidden, LEARNED)[0][0, 0] == pytest.approx(
        AGREEMENT_NATS * 100
    )
    assert reranked(LEVEL, network_deg, gone, LEARNED)[0][0, 0] == pytest.approx(
        AGREEMENT_NATS * (100 - GONE_WEIGHT * 20)
    )


def test_a_heading_far_off_is_not_found_and_a_forgotten_place_stays_forgotten() -> None:
    far = np.full((1, 3), 40.0)
    scores, _ = reranked(np.array([[0.0, -np.inf, 0.0]]), far, seen(0, 0), LEARNED)
    assert scores[0, 0] < AGREEMENT_NATS * SECTORS / 2
    assert scores[0, 1] == -np.inf


def test_only_the_first_places_are_compared() -> None:
    many = ReturnProfiles(np.tile(SHAPES[:1], (40, 1)), np.arange(40), np.zeros(40, np.float32))
    before = -np.arange(40.0)[None]
    after, headings = reranked(before, np.full((1, 40), 1.0), seen(0, 0), many)
    assert (after - before)[0].tolist() == pytest.approx(
        [AGREEMENT_NATS * SECTORS] * 25 + [0.0] * 15
    )
    assert headings[0].tolist() == pytest.approx([0.0] * 25 + [1.0] * 15)
