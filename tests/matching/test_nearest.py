"""The exact search for the nearest descriptors, and the first of each group of them."""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.matching.nearest import first_of_each, nearest

LINE = np.array([[0.0], [1.0], [3.0], [3.0], [7.0]], np.float32)


def test_the_nearest_come_first_and_of_equally_near_ones_the_first_row():
    distances, rows = nearest(LINE, np.array([[2.0], [7.0]], np.float32), 4)
    assert rows.tolist() == [[1, 2, 3, 0], [4, 2, 3, 1]]
    assert distances.tolist() == [[1, 1, 1, 2], [0, 4, 4, 6]]
    assert nearest(LINE, LINE[:1], 25)[1].shape == (1, 5)
    assert nearest(LINE, np.empty((0, 1), np.float32), 3)[1].shape == (0, 3)


@pytest.mark.parametrize("n_queries", [1, 3, 400])
def test_a_query_is_answered_alone_as_in_a_crowd(n_queries: int):
    """faiss sums the distances of many queries in another way than those of one."""
    rng = np.random.default_rng(0)
    database = (100 + rng.normal(size=(500, 64)) * 0.01).astype(np.float32)
    queries = database[rng.integers(0, 500, 400)] + np.float32(1e-4)
    together, rows = nearest(database, queries[:n_queries], 1)
    alone = [nearest(database, query[None], 1) for query in queries[:n_queries]]
    assert rows.tolist() == [row.tolist()[0] for _, row in alone]
    np.testing.assert_allclose(
        together, np.concatenate([distance for distance, _ in alone]), rtol=1e-6
    )


def test_descriptors_of_another_length_are_refused():
    with pytest.raises(InputError, match=r"\(1, 2\)"):
        nearest(LINE, np.zeros((1, 2), np.float32), 1)


def test_each_place_is_taken_at_its_first_row():
    groups = np.array([[5, 5, 2, 5, 9], [1, 1, 1, 1, 1]])
    assert first_of_each(groups, 3).tolist() == [[0, 2, 4], [0, -1, -1]]
    assert first_of_each(groups, 2).tolist() == [[0, 2], [0, -1]]
