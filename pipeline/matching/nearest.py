"""Nearest descriptors by Euclidean distance: faiss's exact search, the same for every method."""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError


def nearest(
    database: NDArray[np.float32], queries: NDArray[np.float32], k: int
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Distances and rows (q, k) of the k nearest of a database (n, d) to queries (q, d).

    Nearest first; all n where there are no more. Of equally near rows the first comes first,
    however many queries there are: faiss finds squared distances through inner products, so those
    of what it found are computed anew.
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
    rows.sort(axis=1)
    offsets = database[rows] - queries[:, None]
    squares = np.vecdot(offsets, offsets)
    order = squares.argsort(axis=1, kind="stable")
    query = np.arange(len(rows))[:, None]
    return np.sqrt(squares[query, order]), rows[query, order]


def first_of_each(groups: NDArray[np.int64], k: int) -> NDArray[np.int64]:
    """Columns (q, k) of the first member of the first k distinct groups of groups (q, m).

    −1 where a row has fewer groups.
    """
    order = np.argsort(groups, axis=1, kind="stable")
    ordered = np.take_along_axis(groups, order, axis=1)
    is_first = np.ones(groups.shape, bool)
    np.put_along_axis(is_first, order[:, 1:], ordered[:, 1:] != ordered[:, :-1], axis=1)
    columns = np.full((len(groups), k), -1, np.int64)
    rank = np.cumsum(is_first, axis=1) - 1
    row, column = np.nonzero(is_first & (rank < k))
    columns[row, rank[row, column]] = column
    return columns
