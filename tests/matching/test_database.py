"""The database of descriptor methods: rankings of its rows, and the evidence of its validation
blocks.

It has six rows 10 m apart along x, two of each place.
"""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.core.frames import pose
from pipeline.matching.database import Database, euclidean
from pipeline.matching.ranking import Rows
from pipeline.methods.m2dp import M2dp

XYZ = np.stack([10.0 * np.arange(6), np.zeros(6), np.zeros(6)], axis=1)
YAW = np.deg2rad([0, 0, 90, 90, 170, 170])
VIEWS = Rows(None, np.arange(6), pose(XYZ, np.stack([np.zeros(6), np.zeros(6), YAW], axis=1)))
PLACES = np.array([0, 0, 1, 1, 2, 2])
DESCRIPTORS = np.arange(6, dtype=np.float32)[:, None]
DATABASE = Database.learned(VIEWS, PLACES)


def test_neighbouring_rows_of_one_place_follow_each_other():
    ranking = DATABASE.nearest(DESCRIPTORS, np.array([[2.2]], np.float32), 3, distinct_places=False)
    assert ranking.places.tolist() == [[1, 1, 0]]
    assert ranking.xy_m[0, :, 0].tolist() == [20, 30, 10]
    np.testing.assert_allclose(ranking.costs, [[0.2, 0.8, 1.2]], atol=1e-6)
    np.testing.assert_allclose(ranking.novelty, [[0.2]], atol=1e-6)
    assert ranking.kinds == ("distance",)
    assert np.isnan(ranking.heading_deg).all()


def test_distinct_places_are_answered_once_and_missing_ones_cost_everything():
    ranking = DATABASE.nearest(
        DESCRIPTORS, np.array([[2.2], [5.0]], np.float32), 4, distinct_places=True
    )
    assert ranking.places.tolist() == [[1, 0, 2, -1], [2, 1, 0, -1]]
    assert ranking.xy_m[0, :3, 0].tolist() == [20, 10, 40]
    assert np.isinf(ranking.costs[:, 3]).all()
    assert np.isnan(ranking.xy_m[:, 3]).all()


def test_the_heading_of_an_answer_is_its_rows_and_the_turn_against_it():
    # Row 4 looks to 170°; turned by 30° more that is 200° = −160°.
    distances = np.zeros((1, 2), np.float32)
    rows = np.array([[4, 4]])
    turned_deg = np.array([[30.0, 5.0]])
    ranking = DATABASE.answer(distances, rows, 2, distinct_places=False, turned_deg=turned_deg)
    np.testing.assert_allclose(ranking.heading_deg, [[-160, 175]])


def test_validation_rows_are_looked_for_in_the_rest_and_again_without_their_surroundings():
    # Blocks of 10 m every 20 m hold rows 1, 3 and 5 (path + 10 m, modulo 20 m, below 10 m); of
    # their places each keeps a row.
    evidence = DATABASE.evidence(euclidean(DESCRIPTORS), VIEWS, M2dp(False, 20, 10, 15))
    # Row 1 is as near to 0 as to 2, row 3 to 2 as to 4: the first counts.
    assert evidence.right.tolist() == [True, True, True]
    assert evidence.seen["distance"].tolist() == [1, 1, 1]
    # Without the rows within 15 m: row 1 finds 4 at 3, row 3 finds 0 at 3, row 5 finds 2 at 3.
    assert evidence.unseen["distance"].tolist() == [3, 3, 3]


def test_a_path_too_short_for_blocks_holds_each_row_against_the_others():
    evidence = DATABASE.evidence(euclidean(DESCRIPTORS), VIEWS, M2dp(False, 1000, 1, 15))
    assert len(evidence.right) == 6
    assert evidence.seen["distance"].tolist() == [1] * 6


def test_what_a_model_holds_of_it_comes_back():
    again = Database.of({**DATABASE.arrays(), "descriptors": DESCRIPTORS})
    assert all(
        np.array_equal(getattr(again, name), getattr(DATABASE, name))
        for name in ("places", "xy_m", "yaw_deg")
    )


def test_every_training_view_needs_its_place():
    for places in (np.where(PLACES == 2, -1, PLACES), PLACES[:3]):
        with pytest.raises(InputError, match="known place"):
            Database.learned(VIEWS, places)
