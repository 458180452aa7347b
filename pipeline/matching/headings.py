"""Distances of queries to places that are known at several headings (METHODS 5.4).

The codes of paper 2's networks depend on the heading, so a place keeps one code for each of its
reference headings. A query's distance to the place is the distance to the nearest of these codes,
whose heading is the query's.
"""

from collections.abc import Iterable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError

PLACES = 128
"""How many places are compared at once, so that the distances to all their codes fit into memory.
"""
ReferenceHeadings = Literal[1, 2, 4, 8]
"""How many of a place's headings are kept as reference, evenly around the circle from heading 0."""


def reference_headings(headings: int, kept: ReferenceHeadings) -> slice:
    """Return which of a view's `headings` a reference place keeps: `kept` of them, evenly spaced.

    Paper 2's protocol uses the odd-numbered headings for queries, so references are even-numbered.
    If `kept` even-numbered headings cannot be evenly spaced, all of them are references.
    """
    can_be_even = headings % (2 * kept) == 0 or kept == 1
    step = headings // kept if can_be_even else 2
    return slice(0, None, step)


def nearest_heading(
    codes: NDArray[np.floating], queries: NDArray[np.floating]
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Euclidean distances (n, m) of m queries to n places, and the nearest headings (n, m).

    `codes` (n, heading, d) are the places' codes at their headings, `queries` (m, d) the queries'
    codes. The distance is the one to the place's nearest code, the first of equally near codes.
    Raises InputError for codes of different widths, or for more than 256 headings.
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
    query_vectors = queries.astype(np.float32)
    # About their mean the vectors are shorter, and their squares lose fewer digits.
    centre = query_vectors.sum(axis=0) / np.float32(max(len(query_vectors), 1))
    query_vectors -= centre
    query_squares = np.vecdot(query_vectors, query_vectors)
    distances = np.empty((places, len(query_vectors)), np.float32)
    nearest_headings = np.empty((places, len(query_vectors)), np.uint8)
    for start in range(0, places, PLACES):
        block = codes[start : start + PLACES].astype(np.float32)
        block -= centre
        # |code − query|² = |code|² − 2 code · query + |query|²; the last term is the same for all
        # codes and is added at the end.
        squares = -2 * (block.reshape(-1, width) @ query_vectors.T).reshape(
            len(block), headings, len(query_vectors)
        )
        squares += np.vecdot(block, block)[..., None]
        rows = slice(start, start + PLACES)
        least_squares, nearest_headings[rows] = least_by_heading(squares.swapaxes(0, 1))
        distances[rows] = np.sqrt(np.maximum(least_squares + query_squares, 0))
    return distances, nearest_headings


def least_by_heading(
    by_heading: Iterable[NDArray[np.float32]],
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """The least of the numbers (n, m) of all headings, and the first heading that has it."""
    headings = enumerate(by_heading)
    _, first = next(headings)
    least_numbers = first.copy()
    nearest_headings = np.zeros(first.shape, np.uint8)
    for heading, numbers in headings:
        is_nearer = numbers < least_numbers
        np.copyto(least_numbers, numbers, where=is_nearer)
        np.copyto(nearest_headings, np.uint8(heading), where=is_nearer)
    return least_numbers, nearest_headings
