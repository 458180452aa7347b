"""Re-ranks the first places by their outline, the nearest standing thing in each direction.

METHODS 8.1. What stood there and is gone speaks against a place; what hides it says nothing, for it
may be new.
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
"""Places of each query."""
TURNED_DEG = 24.0
"""How far a training view is turned, either way, from the heading that the network gave."""
GONE = 0.5
WORTH = 0.05
"""What a sector that sees through counts against one that agrees, and what an agreeing sector adds
to a place's score, in nats: among values that are level on altered held-out blocks of two simulated
campuses (docs/measured.md says what else was weighed)."""
PREFIX = "outlines/"
NOTHING = 2**15 - 1


class Outlines(NamedTuple):
    """Those of the training views, by rising place."""

    rings: NDArray[np.int16]  # (view, sector) ring of the nearest thing that stands, or NOTHING
    places: NDArray[np.int64]  # (view,)
    columns: NDArray[np.float32]  # (view,) yaw in columns

    @classmethod
    def of(cls, model: Mapping[str, NDArray[Any]]) -> Self:
        """Those in a model."""
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
    seen: NDArray[np.int16],
    learned: Outlines,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Scores and headings (n, places) once each query's first places are compared by outlines.

    `seen` (n, sectors) are the queries' outlines. A place's worth is that of its best training view
    at its best turn, which gives the heading.
    """
    starts = np.searchsorted(learned.places, np.arange(scores.shape[1] + 1))
    first_places = np.argsort(-scores, axis=1, kind="stable")[:, :COMPARED]
    column_deg = 360 / seen.shape[1]
    columns = (
        np.take_along_axis(np.asarray(heading_deg, np.float64), first_places, axis=1) / column_deg
    )
    turned = round(TURNED_DEG / column_deg)
    sectors = np.concatenate([seen, seen], axis=1)
    worth, column = _compare(
        sectors, learned.rings, learned.columns, starts, first_places, columns, turned
    )
    scores = scores.copy()
    headings = np.array(heading_deg, np.float64)
    np.put_along_axis(
        scores,
        first_places,
        np.take_along_axis(scores, first_places, axis=1) + WORTH * worth,
        axis=1,
    )
    np.put_along_axis(headings, first_places, wrapped_deg(column * column_deg), axis=1)
    return scores, headings


@njit(cache=True, nogil=True, error_model="numpy")
def _compare(
    seen: NDArray[np.int16],
    rings: NDArray[np.int16],
    columns: NDArray[np.float32],
    starts: NDArray[np.int64],
    places: NDArray[np.int64],
    columns_found: NDArray[np.float64],
    turned: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The worth (n, k) of places in sectors, and the query's heading (n, k) in columns there.

    `seen` (n, 2 · sectors) repeats each query's outline; `columns_found` (n, k) are the headings to
    look around, in columns.
    """
    sectors = rings.shape[1]
    worth = np.full(places.shape, -np.inf)
    headings = columns_found.copy()
    for query in range(places.shape[0]):
        for rank in range(places.shape[1]):
            place = places[query, rank]
            for view in range(starts[place], starts[place + 1]):
                middle = round(columns_found[query, rank] - columns[view])
                for turn in range(middle - turned, middle + turned + 1):
                    shift = (-turn) % sectors
                    agree = 0.0
                    missing = 0.0
                    for sector in range(sectors):
                        learned_ring = rings[view, sector]
                        seen_ring = seen[query, sector + shift]
                        off = np.int32(seen_ring) - np.int32(learned_ring)
                        stands = (learned_ring < NOTHING) | (seen_ring < NOTHING)
                        agree += stands & (abs(off) <= 1)
                        missing += stands & (off > 1)
                    if agree - GONE * missing > worth[query, rank]:
                        worth[query, rank] = agree - GONE * missing
                        headings[query, rank] = columns[view] + turn
    return worth, headings
