"""Re-ranks places by return profiles (METHODS 8.1): a network's scores and the query's return
profile in, new scores and headings out.

A return profile is the ring of the first standing object in each direction. If the query sees
farther than the training view did, an object is gone, which speaks against the place. If it sees
less far, an object may hide the view, which says nothing about the place.

The first places of each query are compared: each of their training views is turned a little either
way from the network's heading, and the best agreement is added to the place's score.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.frames import wrapped_deg

STANDS_M = 1.5
"""A bin of a Scan Context has a standing object if its highest point is above this."""
COMPARED_PLACES = 25
"""How many of a query's first places have their return profiles compared."""
MAX_TURN_DEG = 24.0
"""Largest turn of a training view, either way, from the network's heading."""
GONE_WEIGHT = 0.5
"""How much a sector in which the query sees farther counts against the place; an agreeing sector
counts 1 for it."""
AGREEMENT_NATS = 0.05
"""What an agreeing sector adds to a place's score, in nats.

GONE_WEIGHT and AGREEMENT_NATS lie in a range of values that do equally well on perturbed validation
blocks of two simulated campuses (docs/notes/choices.md lists the alternatives).
"""
PREFIX = "return_profiles/"
"""Prefix of the return profiles' arrays in a model."""
NO_RING = 2**15 - 1
"""The ring of a sector without a standing object, beyond every real ring."""


class ReturnProfiles(NamedTuple):
    """The return profiles of the training views, sorted by place."""

    rings: NDArray[np.int16]
    """(view, sector) the ring of the nearest standing object, or NO_RING."""
    places: NDArray[np.int64]
    """(view,) the place of each view."""
    columns: NDArray[np.float32]
    """(view,) the yaw of each view in the world, in columns: one column is one sector."""

    @classmethod
    def of(cls, model: Mapping[str, NDArray[Any]]) -> Self:
        """Read the return profiles that a model holds."""
        return cls(*(model[f"{PREFIX}{name}"] for name in cls._fields))

    @classmethod
    def is_in(cls, model: Mapping[str, NDArray[Any]]) -> bool:
        """Whether a model holds return profiles."""
        return f"{PREFIX}rings" in model

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of the return profiles, as they are stored in a model."""
        return {f"{PREFIX}{name}": array for name, array in self._asdict().items()}


def return_profiles(heights_m: NDArray[np.floating]) -> NDArray[np.int16]:
    """Return profiles (n, sectors) of Scan Contexts (n, rings, sectors) of heights in metres.

    A number is the ring of the nearest bin with a standing object in a sector, or NO_RING.
    """
    stands = heights_m > STANDS_M
    return np.where(stands.any(axis=1), stands.argmax(axis=1), NO_RING).astype(np.int16)


def reranked(
    scores: NDArray[np.float64],
    heading_deg: NDArray[np.floating],
    query_rings: NDArray[np.int16],
    training: ReturnProfiles,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the scores and headings (n, places) after comparing return profiles.

    `scores` and `heading_deg` (n, places) are the network's, `query_rings` (n, sectors) the
    queries' return profiles. The best training view of a place at its best turn gives the gain in
    score and the heading.
    """
    view_starts = np.searchsorted(training.places, np.arange(scores.shape[1] + 1))
    first_places = np.argsort(-scores, axis=1, kind="stable")[:, :COMPARED_PLACES]
    first_scores = np.take_along_axis(scores, first_places, axis=1)
    headings = np.array(heading_deg, np.float64)
    column_deg = 360 / query_rings.shape[1]
    columns = np.take_along_axis(headings, first_places, axis=1) / column_deg
    agreement, best_columns = _compare(
        np.concatenate([query_rings, query_rings], axis=1),
        training.rings,
        training.columns,
        view_starts,
        first_places,
        columns,
        max_turns=round(MAX_TURN_DEG / column_deg),
    )
    new_scores = scores.copy()
    np.put_along_axis(new_scores, first_places, first_scores + AGREEMENT_NATS * agreement, axis=1)
    np.put_along_axis(headings, first_places, wrapped_deg(best_columns * column_deg), axis=1)
    return new_scores, headings


@njit(cache=True, nogil=True, error_model="numpy")
def _compare(
    query_rings: NDArray[np.int16],
    view_rings: NDArray[np.int16],
    view_columns: NDArray[np.float32],
    view_starts: NDArray[np.int64],
    places: NDArray[np.int64],
    query_columns: NDArray[np.float64],
    max_turns: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the agreement of each query's return profile with its places (n, k), and the headings.

    The agreement (n, k) is the number of sectors that agree, minus GONE_WEIGHT times the number of
    sectors in which an object is gone. The headings (n, k) are in columns.

    `query_rings` (n, 2 · sectors) repeats each query's return profile, so that a slice is the
    turned return profile. The training views of a place are the rows from `view_starts[place]` to
    `view_starts[place + 1]`. The headings `query_columns` (n, k), in columns, are varied by up to
    `max_turns` either way.
    """
    sectors = view_rings.shape[1]
    agreement = np.full(places.shape, -np.inf)
    headings = query_columns.copy()
    for query in range(places.shape[0]):
        for rank in range(places.shape[1]):
            place = places[query, rank]
            for view in range(view_starts[place], view_starts[place + 1]):
                middle = round(query_columns[query, rank] - view_columns[view])
                for turn in range(middle - max_turns, middle + max_turns + 1):
                    # A query that is turned to the left by `turn` sees in the sector − turn what
                    # the view sees in a sector.
                    shift = (-turn) % sectors
                    agreeing = 0.0
                    gone = 0.0
                    for sector in range(sectors):
                        view_ring = view_rings[view, sector]
                        query_ring = query_rings[query, sector + shift]
                        # With NO_RING on one side only, the other side is much nearer.
                        rings_further = np.int32(query_ring) - np.int32(view_ring)
                        stands = (view_ring < NO_RING) | (query_ring < NO_RING)
                        agreeing += stands & (abs(rings_further) <= 1)
                        gone += stands & (rings_further > 1)
                    net = agreeing - GONE_WEIGHT * gone
                    if net > agreement[query, rank]:
                        agreement[query, rank] = net
                        headings[query, rank] = view_columns[view] + turn
    return agreement, headings
