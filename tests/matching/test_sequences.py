"""SequenceMethod: drives whose queries see rows of a training path, and how new they look.

A training row has a random look. Neighbours have nothing in common, so that a single query is
easily taken for another row, and a sequence is not.
"""

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.matching import sequences
from pipeline.matching.database import Database
from pipeline.matching.ranking import Ranking, Rows
from pipeline.matching.rejection import Rejection
from pipeline.matching.sequences import SequenceMethod
from tests.matching.made import along

ROWS = 120
LOOKS = np.random.default_rng(0).normal(size=(ROWS, 16))
"""(row, 16) the look of each training row."""


def path(n: int = ROWS, step_m: float = 2.0) -> Rows:
    """Rows every `step_m` along x, of a robot that looks to the left."""
    return along(np.empty((n, 0)), step_m, yaw_deg=90.0)


def database(n: int = ROWS) -> Database:
    """A database of `n` rows, each a place of its own."""
    return Database.learned(path(n), np.arange(n))


def differences(rows: np.ndarray, noise: float = 0.0, references: np.ndarray = LOOKS) -> np.ndarray:
    """Differences (reference, query) of queries that see these rows with some noise."""
    looks = LOOKS[rows] + np.random.default_rng(1).normal(0, noise, (len(rows), 16))
    return np.asarray(np.linalg.norm(references[:, None] - looks, axis=2), np.float32)


def ranked(rows: np.ndarray, k: int = 1, noise: float = 0.0, **settings: object) -> Ranking:
    """The ranking of a drive past these rows."""
    return SequenceMethod(**settings).ranked(database(), differences(rows, noise), k)  # type: ignore[arg-type]


def test_a_drive_is_followed_from_its_first_query_to_its_last() -> None:
    rows = np.arange(30, 80)
    ranking = ranked(rows, noise=0.3)
    np.testing.assert_array_equal(ranking.places[:, 0], rows)
    np.testing.assert_array_equal(ranking.xy_m[:, 0, 0], 2.0 * rows)
    assert np.isnan(ranking.heading_deg).all()
    assert (ranked(np.arange(ROWS)).places[:, 0] == np.arange(ROWS)).all()


def test_a_sequence_knows_what_one_view_does_not() -> None:
    rows = np.arange(30, 80)
    alone = differences(rows, noise=2.0).argmin(axis=0)
    assert (np.abs(alone - rows) <= 1).mean() < 0.6
    assert (np.abs(ranked(rows, noise=2.0).places[:, 0] - rows) <= 1).mean() > 0.95


@pytest.mark.parametrize("speed", [0.8, 1.2])
def test_a_slower_or_faster_drive_is_followed_within_its_speed_s_slip(speed: float) -> None:
    rows = 10 + (np.arange(60) * speed).astype(int)
    ranking = ranked(rows)
    # At any speed a run matches the row that is its middle at speed 1 (METHODS 6, step 5).
    assert np.abs(ranking.places[5:-5, 0] - rows[5:-5]).max() <= 2
    assert (
        ranking.novelty[5:-5, 0] < ranked(rows, slowest=1.0, fastest=1.0).novelty[5:-5, 0]
    ).all()


def test_a_drive_the_other_way_is_followed_if_the_settings_allow_it() -> None:
    rows = np.arange(80, 30, -1)
    ranking = ranked(rows, noise=0.3, both_ways=True)
    np.testing.assert_array_equal(ranking.places[:, 0], rows)
    assert (ranked(rows, noise=1.0).places[:, 0] == rows).mean() < 0.2
    forward = ranked(rows[::-1], noise=1.0)
    np.testing.assert_array_equal(
        ranked(rows[::-1], noise=1.0, both_ways=True).places, forward.places
    )


def test_fewer_queries_than_a_sequence_are_answered_by_what_there_is() -> None:
    for rows in (np.arange(50, 57), np.arange(50, 52)):
        np.testing.assert_array_equal(ranked(rows).places[:, 0], rows)
    alone = ranked(np.array([50]), k=3)
    assert alone.places[0, 0] == 50
    assert np.isfinite(alone.novelty).all()
    assert np.isfinite(alone.costs).all()
    assert (alone.costs > 0).all()  # it is not measured against its own least
    assert ranked(np.arange(0), k=3).places.shape == (0, 3)


@pytest.mark.parametrize("n", [1, 2, 4, 9])
def test_fewer_rows_than_a_sequence_still_answer(n: int) -> None:
    rows = np.arange(40) % n
    ranking = SequenceMethod(normalisation_rows=2).ranked(
        database(n), differences(rows, references=LOOKS[:n]), 1
    )
    assert (ranking.places >= 0).all()
    assert np.isfinite(ranking.costs).all()
    assert np.isfinite(ranking.novelty).all()
    slow = SequenceMethod(slowest=1.5, fastest=2.0).ranked(
        database(n), differences(rows, references=LOOKS[:n]), 1
    )
    assert (slow.places >= 0).all()


def test_a_shorter_sequence_s_cost_is_brought_to_the_whole_length() -> None:
    # One frame, whose match lies below the 30 others of its window: −30 / √31 at most, 11 times.
    flat = np.ones((ROWS, 1), np.float32)
    flat[50] = 0
    ranking = SequenceMethod().ranked(database(), flat, 2)
    assert ranking.novelty[0, 0] == pytest.approx(-11 * 30 / 31**0.5)
    assert ranking.costs[0, 0] == pytest.approx(0, abs=1e-4)
    assert ranking.costs[0, 1] > 11 * 30 / 31**0.5 - 11


def test_what_is_missing_of_k_rows_is_no_place() -> None:
    # Of 120 rows, 5 lie before the first run's middle and 3 behind the last one's, at the slowest
    # speed: METHODS' start + 5.
    ranking = ranked(np.arange(30, 80), k=ROWS + 9)
    assert ranking.places.shape == (50, ROWS)
    inner = ranking.places[10]
    assert (inner[:112] >= 0).all()
    assert set(inner[:112]) == set(range(5, 117))
    assert (inner[112:] == -1).all()
    assert np.isinf(ranking.costs[10, 112:]).all()
    assert np.isnan(ranking.xy_m[10, 112:]).all()
    assert (np.diff(ranking.costs[10, :112]) >= 0).all()
    # The first and the last query have windows 5 away; what the path's ends cut off of a run is no
    # row of the other end.
    assert set(ranking.places[0]) == {-1, *range(112)}
    assert set(ranking.places[-1]) == {-1, *range(10, 120)}


def test_the_heading_is_the_matched_row_s_and_the_turn_against_it() -> None:
    rows = np.arange(30, 80)
    turned_deg = np.arange(ROWS)[:, None] + 1000.0 * np.arange(50)
    ranking = SequenceMethod().ranked(database(), differences(rows), 2, turned_deg)
    expected = 90 + turned_deg[ranking.places, np.arange(50)[:, None]]
    np.testing.assert_allclose(ranking.heading_deg, 180 - (180 - expected) % 360)


def test_distinct_places_are_answered_once_each() -> None:
    known = Database.learned(path(), np.arange(ROWS) // 10)
    ranking = SequenceMethod(distinct_places=True).ranked(known, differences(np.arange(30, 80)), 5)
    assert (ranking.places[:, 0] == np.arange(30, 80) // 10).all()
    assert all(len(set(places)) == 5 for places in ranking.places)
    np.testing.assert_array_equal(ranking.xy_m[:, 0, 0], 2.0 * np.arange(30, 80))


def test_queries_get_the_same_answers_however_many_are_searched_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    at_once = ranked(np.arange(30, 80), k=4, noise=2.0, both_ways=True)
    monkeypatch.setattr(sequences, "QUERIES", 3)
    in_threes = ranked(np.arange(30, 80), k=4, noise=2.0, both_ways=True)
    for name in ("places", "costs", "novelty", "xy_m"):
        np.testing.assert_array_equal(getattr(in_threes, name), getattr(at_once, name))


def test_what_was_never_seen_is_new_by_both_kinds() -> None:
    seen = np.arange(30, 80)
    elsewhere = np.random.default_rng(2).normal(size=(50, 16))
    new = np.linalg.norm(LOOKS[:, None] - elsewhere, axis=2).astype(np.float32)
    known, unknown = (
        SequenceMethod().ranked(database(), matrix, 1) for matrix in (differences(seen, 1.0), new)
    )
    assert known.kinds == ("cost", "ratio")
    assert known.novelty.dtype == np.float32
    assert (known.novelty.max(axis=0) < unknown.novelty.min(axis=0)).all()
    by_ratio = SequenceMethod(novelty="ratio").ranked(database(), new, 1)
    assert by_ratio.kinds == ("ratio", "cost")
    np.testing.assert_array_equal(by_ratio.novelty, unknown.novelty[:, ::-1])
    assert ((unknown.novelty[:, 1] > 0) & (unknown.novelty[:, 1] <= 1)).all()


def test_a_query_s_cost_as_novelty_does_not_hang_on_what_else_is_ranked() -> None:
    matrix = differences(np.arange(30, 80), 1.0)
    odd = matrix.copy()
    # This column has the least contrast that can be, so all other costs rise.
    odd[:, -1] = 1 - np.eye(ROWS, dtype=np.float32)[60]
    one, other = (SequenceMethod().ranked(database(), each, 3) for each in (matrix, odd))
    np.testing.assert_array_equal(one.places[:30], other.places[:30])
    np.testing.assert_array_equal(one.novelty[:30, 0], other.novelty[:30, 0])
    rise = other.costs[:30] - one.costs[:30]
    assert (rise > 1).all()
    np.testing.assert_allclose(rise, rise[0, 0], atol=1e-3)


def test_the_author_s_score_is_reported_as_it_is() -> None:
    ranking = ranked(np.arange(30, 80), noise=2.5, subtract_minimum=False)
    costs = ranking.costs[:, 0].astype(float)
    assert (costs < 0).all()  # so that the score, 1 / cost, falls as the match gets better
    np.testing.assert_allclose(ranking.novelty[:, 0], -np.minimum(1 / costs, 1), rtol=1e-6)
    nothing = SequenceMethod(subtract_minimum=False).ranked(
        database(), np.ones((ROWS, 20), np.float32), 1
    )
    # a cost of 0, and no better one elsewhere
    np.testing.assert_array_equal(nothing.novelty, [[-1, 1]] * 20)


def test_of_equally_good_rows_the_first_answers() -> None:
    twice = np.concatenate([LOOKS[:60], LOOKS[:60]])
    method = SequenceMethod()
    ranking = method.ranked(database(), differences(np.arange(25, 40), references=twice), 2)
    inner = slice(5, -5)  # of which neither window reaches an end
    np.testing.assert_array_equal(
        ranking.places[inner], np.stack([np.arange(30, 35), np.arange(90, 95)], axis=1)
    )


def test_validation_rows_are_queried_in_one_drive_and_are_not_their_own_answer() -> None:
    given: list[np.ndarray] = []

    def difference(known: np.ndarray, asking: np.ndarray) -> np.ndarray:
        given[:] = known, asking
        smooth = np.cumsum(LOOKS, axis=0)  # neighbours look similar, 4 apart
        return np.asarray(
            np.linalg.norm(smooth[known][:, None] - smooth[asking], axis=2), np.float32
        )

    method = SequenceMethod(validation_every_m=80.0, validation_length_m=20.0, neighbour_m=20.0)
    views = path()
    places = np.arange(ROWS) // 5
    held = method.validation(views)
    # Blocks of 20 m around 40, 120 and 200 m, ten rows each, of which five are odd.
    np.testing.assert_array_equal(np.flatnonzero(held)[:10], np.arange(20, 30))
    evidence = method.evidence(Database.learned(views, places), views, difference)
    np.testing.assert_array_equal(given[0], np.arange(0, ROWS, 2))
    np.testing.assert_array_equal(given[1], np.arange(1, ROWS, 2))
    assert len(evidence.right) == held[1::2].sum() == 15
    assert evidence.right.mean() > 0.7
    assert set(evidence.seen) == set(evidence.unseen) == {"cost", "ratio"}
    assert (evidence.unseen["cost"] > evidence.seen["cost"]).all()
    assert evidence.block.tolist() == [0] * 5 + [1] * 5 + [2] * 5
    for threshold, kept in Rejection(target_precision=0.6).thresholds(
        {**evidence.arrays()}, ("cost", "ratio")
    ):
        assert np.isfinite(threshold)
        assert kept >= 0.6 or np.isnan(kept)


def test_all_odd_rows_count_on_a_path_without_blocks() -> None:
    def flat(known: np.ndarray, asking: np.ndarray) -> np.ndarray:
        return np.ones((len(known), len(asking)), np.float32)

    for n in (1, 2, 3, 20):
        evidence = SequenceMethod(neighbour_m=5.0).evidence(database(n), path(n, step_m=1.0), flat)
        assert len(evidence.right) == max(n // 2, 1)
        # Of 20 rows the even ones 8 to 12 can be the middle of a run: all near row 9, which is then
        # held against them after all.
        assert not any(values.any() for values in (evidence.seen["cost"], evidence.unseen["cost"]))


def test_differences_from_other_rows_than_the_database_s_are_refused() -> None:
    with pytest.raises(InputError, match=r"\(3, 2\): expected a row for each of 120"):
        SequenceMethod().ranked(database(), np.ones((3, 2), np.float32), 1)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_differences_that_are_no_numbers_are_refused(value: float) -> None:
    matrix = differences(np.arange(30, 80))
    matrix[70, 20] = value
    for settings in ({}, {"subtract_minimum": False}):
        with pytest.raises(InputError, match="expected finite numbers"):
            SequenceMethod(**settings).ranked(database(), matrix, 1)  # type: ignore[arg-type]
