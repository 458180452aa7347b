"""Exact search for the nearest descriptors by Euclidean distance, with faiss, for all methods."""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError


def nearest(
    database: NDArray[np.float32], queries: NDArray[np.float32], k: int
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Distances and rows (q, k) of the k nearest of a database (n, d) to each query (q, d).

    The nearest row comes first, and of equally near rows the lower one; if n is less than k, all n
    rows are returned. faiss computes distances through inner products, whose rounding depends on
    the number of queries, so the distances to the rows that it finds are computed again.
    """
    from faiss import knn

    if database.ndim != 2 or queries.ndim != 2 or database.shape[1] != queries.shape[1]:
        raise InputError(
            f"queries of shape {queries.shape}: expected (q, d) like the database's "
            f"{database.shape}"
        )
    k = min(k, len(database))
    if not k or not len(queries):
        return np.empty((len(queries), k), np.float32), np.empty((len(queries), k), np.int64)
    _, rows = knn(queries, database, k)
    rows.sort(axis=1)  # so that a stable sort by distance puts the lower one of equal rows first
    offsets = database[rows] - queries[:, None]
    squares = np.vecdot(offsets, offsets)
    order = squares.argsort(axis=1, kind="stable")
    distances = np.sqrt(np.take_along_axis(squares, order, axis=1))
    return distances, np.take_along_axis(rows, order, axis=1)


def first_of_each(groups: NDArray[np.int64], k: int) -> NDArray[np.int64]:
    """Columns (q, k) at which the first k distinct groups of each row of `groups` (q, m) begin.

    A row with fewer groups is filled up with −1.
    """
    # A stable sort brings the members of a group together, in their order.
    order = np.argsort(groups, axis=1, kind="stable")
    ordered = np.take_along_axis(groups, order, axis=1)
    is_first = np.ones(groups.shape, bool)
    np.put_along_axis(is_first, order[:, 1:], ordered[:, 1:] != ordered[:, :-1], axis=1)
    columns = np.full((len(groups), k), -1, np.int64)
    rank = np.cumsum(is_first, axis=1) - 1
    row, column = np.nonzero(is_first & (rank < k))
    columns[row, rank[row, column]] = column
    return columns
