"""A place's reference headings, and the distance of a code to the nearest of their codes (METHODS
5.4)."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError

PLACES = 128  # compared at once
ReferenceHeadings = Literal[1, 2, 4, 8]
"""How many of a place's headings are kept as reference, evenly around the circle from heading 0."""


def reference_headings(headings: int, kept: ReferenceHeadings) -> slice:
    """Which of a view's headings are a reference place's, heading 0 among them.

    `kept` even ones evenly around the circle, or all even ones where that cannot be: the odd ones
    stay for the queries of paper 2's protocol.
    """
    is_even = headings % (2 * kept) == 0 or kept == 1
    return slice(0, None, headings // kept if is_even else 2)


def nearest_heading(
    codes: NDArray[np.floating], queries: NDArray[np.floating]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Euclidean distances (n, m) of queries (m, d) to the nearest of each place's codes.

    Codes are (n, heading, d); also gives the nearest heading (n, m), of equally near ones the
    first. Raises InputError for codes of another width, or of more headings than 256.
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
    centre = vectors.sum(axis=0) / np.float32(
        max(len(vectors), 1)
    )  # shorter vectors lose fewer digits in their squares
    vectors -= centre
    lengths = np.vecdot(vectors, vectors)
    distances = np.empty((places, len(vectors)), np.float32)
    bins = np.zeros((places, len(vectors)), np.uint8)
    for start in range(0, places, PLACES):
        block = codes[start : start + PLACES].astype(np.float32)
        block -= centre
        squares = -2 * (block.reshape(-1, width) @ vectors.T).reshape(
            len(block), headings, len(vectors)
        )
        squares += np.vecdot(block, block)[..., None]
        nearest = squares[:, 0].copy()
        block_bins = bins[start : start + PLACES]
        for heading in range(1, headings):
            nearer = squares[:, heading] < nearest
            np.copyto(nearest, squares[:, heading], where=nearer)
            np.copyto(block_bins, np.uint8(heading), where=nearer)
        distances[start : start + PLACES] = np.sqrt(np.maximum(nearest + lengths, 0))
    return distances, bins
