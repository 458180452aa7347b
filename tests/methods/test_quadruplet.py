"""Tests of the lazy quadruplet loss, worked out by hand (METHODS 3.2), and of the clouds that it
compares."""

import numpy as np
import pytest
import torch

from pipeline.core.errors import InputError
from pipeline.methods.pointnetvlad.quadruplet import Tuples, lazy_quadruplet

LINE = np.column_stack([np.arange(300.0), np.zeros(300)])
"""A row a metre."""


def by_distance(
    best: float, apart: tuple[float, float], apart_star: tuple[float, float]
) -> torch.Tensor:
    """Descriptors (6, 4) of query, two positives, two negatives and n* with these squared
    distances."""
    star = torch.tensor([0, 0, 1.0, 0])
    made = [torch.zeros(4), torch.tensor([best**0.5, 0, 0, 0]), torch.tensor([2.0, 0, 0, 0])]
    for to_query, to_star in zip(apart, apart_star, strict=True):
        # x² + z² = to_query and x² + (z − 1)² = to_star: z = (to_query − to_star + 1) / 2, and x²
        # is what is left.
        z = (to_query - to_star + 1) / 2
        made.append(torch.tensor([0, (to_query - z * z) ** 0.5, z, 0]))
    return torch.stack([*made, star])


def test_the_loss_is_the_authors_a_mean_over_queries_and_counts_who_is_right() -> None:
    # Best positive .1; negatives .3 and 1 from the query, .25 and .9 from n*: max(0, .5 + .1 − .3)
    # + max(0, .2 + .1 − .25) = .35.
    tuples = by_distance(0.1, (0.3, 1.0), (0.25, 0.9))[None]
    loss, right = lazy_quadruplet(tuples, 2, 0.5, 0.2)
    assert float(loss) == pytest.approx(0.35, abs=1e-6)
    assert int(right) == 1
    good = by_distance(0.1, (0.3, 1.0), (0.25, 0.9))
    bad = by_distance(0.4, (0.3, 1.0), (0.25, 0.9))
    loss, right = lazy_quadruplet(torch.stack([good, bad]), 2, 0.5, 0.2)
    # The second: .5 + .4 − .3 = .6 and .2 + .4 − .25 = .35, so .95; (.35 + .95) / 2 = .65. Its
    # positive is not the nearest.
    assert float(loss) == pytest.approx(0.65, abs=1e-6)
    assert int(right) == 1
    assert (
        float(lazy_quadruplet(by_distance(0.0, (0.6, 1.0), (0.5, 0.9))[None], 2, 0.5, 0.2)[0]) == 0
    )


def drawn(
    tuples: Tuples, query: int, seed: int = 0, descriptors: np.ndarray | None = None
) -> tuple[np.ndarray, ...]:
    rows = tuples.draw(query, np.random.default_rng(seed), descriptors)
    return rows[:1], rows[1:3], rows[3:-1], rows[-1:]


def test_positives_are_near_negatives_far_and_the_fourth_cloud_near_none() -> None:
    tuples = Tuples(LINE, 10, 50, positives=2, negatives=6, hard=3)
    for seed, query in enumerate((0, 100, 299)):
        first, near, far, star = drawn(tuples, query, seed)
        assert first == query
        assert len(set(near)) == 2
        assert (np.abs(near - query) <= 10).all()
        assert query not in near
        assert len(set(far)) == 6
        assert (np.abs(far - query) > 50).all()
        assert (np.abs(np.append(far, query) - star) > 10).all()


def test_the_hardest_negatives_come_first_once_descriptors_tell() -> None:
    tuples = Tuples(LINE, 10, 50, positives=2, negatives=6, hard=3)
    descriptors = np.zeros((300, 2), np.float32)
    descriptors[:, 0] = -1
    descriptors[[0, 200, 210, 220]] = [[1, 0], [0.9, 0.1], [0.95, 0.1], [0.8, 0.1]]
    descriptors[30] = [1, 0]  # nearer than 50 m: never a negative
    _, _, far, _ = drawn(tuples, 0, descriptors=descriptors)
    assert far[:3].tolist() == [210, 200, 220]
    assert len(set(far)) == 6
    assert 30 not in far


def test_draws_follow_from_the_random_state() -> None:
    tuples = Tuples(LINE, 10, 50, 2, 6, 3)
    assert np.array_equal(np.concatenate(drawn(tuples, 7, 1)), np.concatenate(drawn(tuples, 7, 1)))
    assert not np.array_equal(
        np.concatenate(drawn(tuples, 7, 1)), np.concatenate(drawn(tuples, 7, 2))
    )


def test_a_small_world_takes_its_far_half_for_negatives_and_the_loneliest_row_for_the_fourth() -> (
    None
):
    # 20 m: from row 0 the furthest lies 19 m away, so beyond 9.5 m is negative and nearer is
    # positive.
    tuples = Tuples(LINE[:20], 10, 50, positives=2, negatives=18, hard=3)
    _, near, far, star = drawn(tuples, 0)
    assert (near <= 9).all()
    assert set(far) == set(range(10, 20))  # all ten, some of them twice
    assert star == 5  # 5 m from row 0 and from row 10; no row is further from both


def test_rows_without_a_positive_are_no_queries() -> None:
    xy = np.array([[0, 0], [1, 0], [100, 0], [200, 0.0]])
    assert Tuples(xy, 10, 50, 2, 2, 0).queries().tolist() == [0, 1]


@pytest.mark.parametrize("xy_m", [np.zeros((5, 2)), 30 * LINE[:5], np.zeros((1, 2))])
def test_rows_that_cannot_be_compared_are_refused(xy_m: np.ndarray) -> None:
    with pytest.raises(InputError):
        Tuples(xy_m, 10, 50, 2, 2, 0).queries()
