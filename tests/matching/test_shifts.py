"""Scan Context's distance, against the authors' numbers, a plain loop, and a real reverse loop."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.matching.database import Database
from pipeline.matching.ranking import Rows
from pipeline.matching.shift_kernels import pack_masks
from pipeline.matching.shifts import Spectra
from pipeline.readers.kitti import read_velodyne
from pipeline.views.scan_context import ScanContext

# METHODS 1.5 B, from the authors' Matlab; 3 rings, 4 sectors, B is A rolled by 1.
A = np.array([[1, 0, 3, 0], [2, 0, 0, 1], [0, 0, 1, 1]], np.float32)
B = np.roll(A, 1, axis=1)
C = np.array([[3, 1, 0, 2], [0, 1, 0, 0], [1, 1, 0, 5]], np.float32)
EMPTY = np.zeros_like(A)


def loop(query: NDArray[np.float32], other: NDArray[np.float32]) -> tuple[float, int]:
    """Distance and best shift of two Scan Contexts by the definition, in float64.

    The shift is −1 if none engages a column.
    """
    means = []
    for shift in range(query.shape[1]):
        cosines = []
        for a, b in zip(
            query.T.astype(float), np.roll(other, -shift, axis=1).T.astype(float), strict=True
        ):
            if a.any() and b.any():
                cosines.append(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
        means.append(np.mean(cosines) if cosines else -np.inf)
    return (1 - max(means), int(np.argmax(means))) if np.isfinite(means).any() else (1.0, -1)


def images(
    seed: int, density: float, engaged: float, shape: tuple[int, int, int] = (12, 10, 36)
) -> NDArray[np.float32]:
    """Random Scan Contexts of this shape, some of whose bins and columns are empty.

    `density` is the share of the bins that hold something, in the share `engaged` of the columns.
    Some heights are negative.
    """
    rng = np.random.default_rng(seed)
    is_full = (rng.random(shape) < density) & (rng.random((shape[0], 1, shape[2])) < engaged)
    made: NDArray[np.float32] = (rng.normal(2, 3, shape) * is_full).astype(np.float32)
    return made


def distance(query: NDArray[np.float32], other: NDArray[np.float32]) -> float:
    """The distance of two Scan Contexts (ring, sector)."""
    return float(Spectra.learned(other[None]).compare(query, np.array([0]))[0][0])


def test_distances_are_the_authors():
    assert B.tolist() == [[0, 1, 0, 3], [1, 2, 0, 0], [1, 0, 0, 1]]
    distances, turned_deg = Spectra.learned(np.stack([A, B, C, EMPTY])).compare(A, np.arange(4))
    np.testing.assert_allclose(distances, [0, 0, 0.0917517095, 1.0], atol=1e-9)
    assert turned_deg[:2].tolist() == [0, 90]
    assert np.isnan(turned_deg[3])
    np.testing.assert_allclose(
        [distance(C, A), distance(B, C), distance(C, B)], 0.0917517095, atol=1e-9
    )


@pytest.mark.parametrize(
    ("density", "engaged", "sectors"),
    [(1.0, 1.0, 36), (0.3, 0.6, 36), (0.05, 0.9, 36), (0.5, 0.06, 36), (0.3, 0.7, 15)],
    ids=["full", "sparse", "sparser", "few columns", "an odd number of columns"],
)
def test_all_shifts_by_spectra_equal_the_plain_loop(density: float, engaged: float, sectors: int):
    made = images(3, density, engaged, (12, 10, sectors))
    distances, turned_deg = Spectra.learned(made).compare(made[0], np.arange(len(made)))
    expected = [loop(made[0], other) for other in made]
    np.testing.assert_allclose(distances, [answer for answer, _ in expected], atol=1e-6)
    np.testing.assert_allclose(
        turned_deg, [360 / sectors * shift if shift >= 0 else np.nan for _, shift in expected]
    )


def test_a_shift_at_which_few_columns_meet_may_be_passed_over():
    # Half circles: unturned, two columns meet at cosines 1 and .6; turned by one, a single pair
    # meets at cosine 1.
    query = np.array([[1, 3, 0, 0], [0, 4, 0, 0]], np.float32)
    other = np.array([[1, 1, 0, 0], [0, 0, 0, 0]], np.float32)
    for least, expected, turn in (
        (0.0, 0.0, {90.0, 270.0}),
        (0.5, 0.0, {90.0, 270.0}),
        (0.6, 0.2, {0.0}),
    ):
        distances, turned_deg = Spectra.learned(other[None], least).compare(query, np.array([0]))
        np.testing.assert_allclose(distances, [expected], atol=1e-6)
        assert turned_deg[0] in turn


def test_rows_are_compared_in_the_given_order_however_many():
    made = images(7, 0.3, 0.7, (600, 4, 12))
    spectra = Spectra.learned(made)
    everything, _ = spectra.compare(made[0], np.arange(600))
    for rows in ([], [5], [599, 3, 3, 300, 8], np.arange(599, -1, -1)):
        some, _ = spectra.compare(made[0], np.array(rows, np.int64))
        assert some.tolist() == everything[np.array(rows, np.int64)].tolist()


@pytest.mark.parametrize("least", [0.0, 0.9], ids=["any overlap", "nearly all of the overlap"])
@pytest.mark.parametrize("engaged", [1.0, 0.7, 0.06], ids=["full", "sparse", "few columns"])
def test_the_likely_rows_hold_the_nearest_ones_and_are_few(engaged: float, least: float):
    made = images(10, 0.3, engaged, (2_000, 6, 72))
    made[1000:1020] = made[5]  # as near as each other
    spectra = Spectra.learned(made, least)
    everything = np.arange(2_000)
    groups = np.arange(2_000) // 7
    for query in (
        np.roll(made[5], 11, axis=1),
        made[3] + made[4],
        EMPTY[:1].repeat(6, 0).repeat(18, 1),
    ):
        distances, _ = spectra.compare(query, everything)
        order = np.argsort(distances, kind="stable")
        likely = spectra.likely(query, everything, 25)
        assert set(order[:25]) <= set(likely)
        assert np.all(np.diff(likely) > 0)  # in their order, by which equals are ranked
        firsts = order[np.sort(np.unique(groups[order], return_index=True)[1])][:25]
        assert set(firsts) <= set(spectra.likely(query, everything, 25, groups))
        if engaged == 1.0 and query.any():
            assert len(likely) < 100


def test_all_rows_are_likely_where_there_are_fewer_groups_than_wanted():
    made = images(11, 0.3, 0.7, (600, 4, 12))
    assert len(Spectra.learned(made).likely(made[0], np.arange(600), 3, np.arange(600) % 2)) == 600


@pytest.mark.parametrize("distinct", [False, True])
def test_a_ranking_is_that_of_all_rows(distinct: bool):
    made = images(12, 0.3, 0.7, (700, 5, 24))
    spectra = Spectra.learned(made[:-3])
    places = np.arange(697) // 3
    database = Database(places, np.stack([places, places], 1).astype(float), np.zeros(697))
    rows = np.broadcast_to(np.arange(697), (3, 697))
    ranking = spectra.rank(database, made[-3:], rows, 9, distinct)
    for i, query in enumerate(made[-3:]):
        distances, turned_deg = spectra.compare(query, np.arange(697))
        order = np.argsort(distances, kind="stable")
        wanted = (
            order[np.sort(np.unique(places[order], return_index=True)[1])][:9]
            if distinct
            else order[:9]
        )
        assert ranking.places[i].tolist() == places[wanted].tolist()
        assert ranking.costs[i].tolist() == distances[wanted].astype(np.float32).tolist()
        np.testing.assert_allclose(ranking.heading_deg[i] % 360, turned_deg[wanted] % 360)


@pytest.mark.parametrize("sectors", [3, 64, 65, 120, 200])
def test_bit_sets_hold_every_column(sectors: int):
    engaged = np.random.default_rng(0).random((5, sectors)) < 0.5
    words = pack_masks(engaged)
    assert words.shape == (5, -(-sectors // 64))
    assert [sum(int(word).bit_count() for word in row) for row in words] == engaged.sum(
        axis=1
    ).tolist()


def test_what_a_model_holds_of_it_comes_back_and_takes_twenty_kilobytes_a_scan():
    spectra = Spectra.learned(images(8, 0.3, 0.7))
    again = Spectra.of({**spectra.arrays(), "ring_keys": np.empty(0)})
    assert np.array_equal(again.columns, spectra.columns)
    assert np.array_equal(again.engaged, spectra.engaged)
    spectra = Spectra.learned(np.zeros((2, 40, 120), np.float32))
    assert sum(array.nbytes for array in spectra.arrays().values()) / 2 == 4 * (61 * 2 * 40 + 120)


@pytest.mark.parametrize("shape", [(2, 3, 5), (2, 4, 4), (2, 12)])
def test_views_of_another_shape_are_refused(shape: tuple[int, ...]):
    views = Rows(np.zeros(shape, np.float32), np.arange(2), np.tile(np.eye(4), (2, 1, 1)))
    with pytest.raises(InputError, match="3 rings × 4 sectors"):
        Spectra.learned(A[None]).read_heights(views)


def test_a_real_reverse_loop_is_recognised_at_its_turn(real: Path):
    """KITTI 08, scans 720 and 1500: 3.6 m apart and turned by 148.4°; heights and bins as the
    authors' Python makes them."""
    lift = np.array([0, 0, 2.0], np.float32)
    draw = ScanContext(voxel_m=0, min_points=1)
    there, back = (
        draw(read_velodyne(real / f"kitti/pairs/08/{scan}.bin") + lift)
        for scan in ("000720", "001500")
    )
    distances, turned_deg = Spectra.learned(there[None]).compare(back, np.array([0]))
    assert turned_deg[0] / 3 == 70
    assert distances[0] == pytest.approx(0.39, abs=0.005)
    np.testing.assert_allclose(distances[0], loop(back, there)[0], atol=1e-6)
    lengths = np.linalg.norm(there, axis=0) * np.linalg.norm(back, axis=0)
    assert np.mean(
        1 - (there * back).sum(axis=0)[lengths > 0] / lengths[lengths > 0]
    ) == pytest.approx(0.70, abs=0.01)
    # The camera's z axis looks forward, and its x axis to the right, so left is −x.
    forward = np.loadtxt(real / "kitti/poses/08.txt").reshape(-1, 3, 4)[[720, 1500], :, 2]
    yaw_deg = np.rad2deg(np.arctan2(-forward[:, 0], forward[:, 2]))
    assert abs((turned_deg[0] - (yaw_deg[1] - yaw_deg[0]) + 180) % 360 - 180) < 3
