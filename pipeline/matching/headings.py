"""A place's reference headings, and the distance of a code to the nearest of their codes (METHODS
5.4)."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError

PLACES = 128
"""Places compared at once."""
ReferenceHeadings = Literal[1, 2, 4, 8]
"""How many of a place's headings are kept as reference, evenly around the circle from heading 0."""


def reference_headings(headings: int, kept: ReferenceHeadings) -> slice:
    """Which of the `headings` that a view is drawn at are kept of a reference place.

    They are `kept` evenly around the circle from heading 0, all of even number; where that cannot
    be, all of even number. Those of odd number stay for the queries of paper 2's protocol.
    """
    can_be_even = headings % (2 * kept) == 0 or kept == 1
    return slice(0, None, headings // kept if can_be_even else 2)


def nearest_heading(
    codes: NDArray[np.floating], queries: NDArray[np.floating]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Euclidean distances (n, m) of m queries to n places, and the headings (n, m) they are to.

    A place has a code at each heading (n, heading, d); its distance is that of the code nearest to
    the query's (m, d), of equally near ones the first. Raises InputError for codes of another
    width, or of more headings than 256.
    """
    if (
        codes.ndim != 3
        or queries.ndim != 2
        or codes.shape[2] != queries.shape[1]
        or not 1 <= codes.shape[1] <= 256
    ):
        raise InputError(
            f"queries of shape {queries.shape}: expected (m, d) for codes (n, heading, d) of shape "
            f"{codes.shape}"
        )
    places, headings, width = codes.shape
    vectors = queries.astype(np.float32)
    # Around their mean vectors are shorter, and lose fewer digits in their squares.
    centre = vectors.sum(axis=0) / np.float32(max(len(vectors), 1))
    vectors -= centre
    squared_lengths = np.vecdot(vectors, vectors)
    distances = np.empty((places, len(vectors)), np.float32)
    nearest_headings = np.zeros((places, len(vectors)), np.uint8)
    for start in range(0, places, PLACES):
        block = codes[start : start + PLACES].astype(np.float32)
        block -= centre
        # |code − query|² but for |query|², which is the same for all codes
        squares = -2 * (block.reshape(-1, width) @ vectors.T).reshape(
            len(block), headings, len(vectors)
        )
        squares += np.vecdot(block, block)[..., None]
        least = squares[:, 0].copy()
        block_headings = nearest_headings[start : start + PLACES]
        for heading in range(1, headings):
            is_nearer = squares[:, heading] < least
            np.copyto(least, squares[:, heading], where=is_nearer)
            np.copyto(block_headings, np.uint8(heading), where=is_nearer)
        distances[start : start + PLACES] = np.sqrt(np.maximum(least + squared_lengths, 0))
    return distances, nearest_headings
