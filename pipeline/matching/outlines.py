"""Re-ranks places by outlines: a network's scores and the query's outline in; new scores out.

An outline is the nearest standing thing in each direction (METHODS 8.1). Where the query sees
further than the training view did, something that stood there is gone, which speaks against the
place. Where it sees less far, something may have been put there since, which says nothing.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.frames import wrapped_deg

STANDS_M = 1.5
"""A bin whose highest point is higher holds something that stands."""
COMPARED = 25
"""Places of each query whose outlines are compared."""
TURNED_DEG = 24.0
"""How far a training view is turned, either way, from the heading that the network gave."""
GONE = 0.5
"""What a sector where the query sees further counts, against one that agrees."""
WORTH = 0.05
"""What an agreeing sector adds to a place's score, in nats.

This and GONE are among values that do equally well on altered held-out blocks of two simulated
campuses (docs/measured.md says what else was weighed).
"""
PREFIX = "outlines/"
"""Of the arrays' names in a model."""
NOTHING = 2**15 - 1
"""The ring of a sector where nothing stands."""


class Outlines(NamedTuple):
    """The outlines of the training views, in rising order of their places."""

    rings: NDArray[np.int16]
    """(view, sector) ring of the nearest thing that stands, or NOTHING."""
    places: NDArray[np.int64]
    """(view,) the place that each shows."""
    columns: NDArray[np.float32]
    """(view,) yaw, in columns of a view: one sector each."""

    @classmethod
    def of(cls, model: Mapping[str, NDArray[Any]]) -> Self:
        """The outlines that a model holds."""
        return cls(*(model[f"{PREFIX}{name}"] for name in cls._fields))

    @classmethod
    def is_in(cls, model: Mapping[str, NDArray[Any]]) -> bool:
        """Whether a model has outlines."""
        return f"{PREFIX}rings" in model

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Their arrays, as they are stored in a model."""
        return {f"{PREFIX}{name}": array for name, array in self._asdict().items()}


def outlines(heights_m: NDArray[np.floating]) -> NDArray[np.int16]:
    """Rings (n, sectors) of the nearest standing bin in each sector, or NOTHING.

    Of heights (n, rings, sectors).
    """
    stands = heights_m > STANDS_M
    return np.where(stands.any(axis=1), stands.argmax(axis=1), NOTHING).astype(np.int16)


def reranked(
    scores: NDArray[np.float64],
    heading_deg: NDArray[np.floating],
    query_rings: NDArray[np.int16],
    training: Outlines,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Scores and headings (n, places) once each query's first places are compared by outlines.

    `query_rings` (n, sectors) are the queries' outlines. A place's worth is that of its best
    training view at its best turn, which gives the heading.
    """
    view_starts = np.searchsorted(training.places, np.arange(scores.shape[1] + 1))
    first_places = np.argsort(-scores, axis=1, kind="stable")[:, :COMPARED]
    first_scores = np.take_along_axis(scores, first_places, axis=1)
    headings = np.array(heading_deg, np.float64)
    column_deg = 360 / query_rings.shape[1]
    columns = np.take_along_axis(headings, first_places, axis=1) / column_deg
    worth, best_columns = _compare(
        np.concatenate([query_rings, query_rings], axis=1),
        training.rings,
        training.columns,
        view_starts,
        first_places,
        columns,
        round(TURNED_DEG / column_deg),
    )
    new_scores = scores.copy()
    np.put_along_axis(new_scores, first_places, first_scores + WORTH * worth, axis=1)
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
    most_turns: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The worth (n, k) of places in sectors, and the query's heading (n, k) in columns there.

    `query_rings` (n, 2 · sectors) repeats each query's outline, so that a shift can turn it.
    The training views of a place are rows `view_starts[place]` to `view_starts[place + 1]`.
    `query_columns` (n, k) are the headings to begin with, in columns; they are varied by up to
    `most_turns` columns either way.
    """
    sectors = view_rings.shape[1]
    worth = np.full(places.shape, -np.inf)
    headings = query_columns.copy()
    for query in range(places.shape[0]):
        for rank in range(places.shape[1]):
            place = places[query, rank]
            for view in range(view_starts[place], view_starts[place + 1]):
                middle = round(query_columns[query, rank] - view_columns[view])
                for turn in range(middle - most_turns, middle + most_turns + 1):
                    shift = (-turn) % sectors
                    agree = 0.0
                    missing = 0.0
                    for sector in range(sectors):
                        view_ring = view_rings[view, sector]
                        query_ring = query_rings[query, sector + shift]
                        further = np.int32(query_ring) - np.int32(view_ring)
                        stands = (view_ring < NOTHING) | (query_ring < NOTHING)
                        agree += stands & (abs(further) <= 1)
                        missing += stands & (further > 1)
                    if agree - GONE * missing > worth[query, rank]:
                        worth[query, rank] = agree - GONE * missing
                        headings[query, rank] = view_columns[view] + turn
    return worth, headings
