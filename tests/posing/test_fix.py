"""Tests of the search and its fixes: the right pose is found among candidate submaps, and no pose
if there are too few points."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.frames import distance_and_turn
from pipeline.posing.fix import ScanFix, features
from pipeline.posing.search import Answers, Fixer
from pipeline.posing.targets import Targets
from tests.artifacts import write_map
from tests.posing.scene import OVERLAPS, hypothesis, planar, scene, seen_from

ANCHORS = [planar(0, 0, 0), planar(200, 0, 90), planar(400, 0, -30)]
PLACES = Answers.at(np.array([[400.0, 0.0], [200.0, 0.0], [0.0, 0.0]]))


def written(path: Path, seeds: range) -> Targets:
    """A map of places, each with its own scene."""
    anchors = np.array(ANCHORS[: len(seeds)]).reshape(-1, 4, 4)
    write_map(path, [scene(seed) for seed in seeds], anchors)
    return Targets.read(path)


@pytest.fixture(scope="module")
def targets(tmp_path_factory: pytest.TempPathFactory) -> Targets:
    """A map of three places."""
    return written(tmp_path_factory.mktemp("map") / "day.zarr", range(3))


def test_an_empty_map_gives_no_pose(tmp_path: Path) -> None:
    assert Fixer().fix(scene(), written(tmp_path / "none.zarr", range(0)), PLACES) == ScanFix()


@pytest.mark.parametrize(
    ("row", "x_m", "y_m", "yaw_deg"),
    [(0, 2.0, -1.0, 130.0), (1, -3.0, 4.0, 0.0), (2, 0.0, 0.0, -60.0)],
)
def test_the_pose_is_found_among_candidates(
    targets: Targets, row: int, x_m: float, y_m: float, yaw_deg: float
) -> None:
    anchor_T_query = planar(x_m, y_m, yaw_deg)
    result = Fixer().fix(seen_from(scene(row), anchor_T_query), targets, PLACES)
    best = result.hypotheses[0]
    away_m, turn_deg = distance_and_turn(
        best.world_T_query[None], (ANCHORS[row] @ anchor_T_query)[None]
    )
    assert best.row == row
    assert away_m[0] < 0.1
    assert turn_deg[0] < 0.3
    assert best.here.overlap > 0.8
    assert best.here.structure > 0.8
    assert best.here.seen_again > 0.8
    assert best.beside == best.here  # there is no other submap near
    assert result.probability > 0.9


def test_a_place_that_the_map_does_not_have_overlaps_little(targets: Targets) -> None:
    here, elsewhere = (
        Fixer().fix(seen_from(scene(seed), planar(1, 1, 20)), targets, PLACES) for seed in (0, 7)
    )
    assert elsewhere.overlap < 0.6 * here.overlap
    assert elsewhere.hypotheses[0].alignment.spread_m > 2 * here.hypotheses[0].alignment.spread_m
    assert elsewhere.probability < 0.5 < 0.99 < here.probability


def test_approaches_of_little_overlap_are_refined_only_beside_a_likely_hypothesis(
    targets: Targets,
) -> None:
    """No approach of a query from elsewhere is refined. For a query from the map, the search, which
    is never sure here, refines the right place, and then the other two for comparison."""
    there, elsewhere = (seen_from(scene(seed), planar(1, 1, 20)) for seed in (0, 7))
    fixer = Fixer(least_overlap=0.7, sure=1.0)
    assert len(Fixer().fix(elsewhere, targets, PLACES).hypotheses) > 0
    assert fixer.fix(elsewhere, targets, PLACES) == ScanFix()
    result = fixer.fix(there, targets, PLACES)
    assert result.hypotheses[0].approach_overlap > 0.7
    assert min(other.approach_overlap for other in result.hypotheses[1:]) < 0.7


@pytest.mark.parametrize(
    "points_m",
    [
        np.zeros((0, 3)),
        np.random.default_rng(0).uniform(-10, 10, (12, 3)),
        np.full((5000, 3), np.nan),
        np.column_stack([np.random.default_rng(0).uniform(-20, 20, (5000, 2)), np.zeros(5000)]),
    ],
    ids=["none", "12 points", "NaN", "one plane"],
)
def test_too_little_to_tell_is_no_pose(targets: Targets, points_m: np.ndarray) -> None:
    result = Fixer().fix(points_m, targets, PLACES)
    assert result.hypotheses == ()
    assert np.isinf(result.covariance).all()
    assert result.probability == 0


def test_without_answers_the_whole_map_is_searched(targets: Targets) -> None:
    result = Fixer().fix(
        seen_from(scene(1), planar(1, 0, 90)), targets, Answers.at(np.full((5, 2), np.nan))
    )
    assert result.hypotheses[0].row == 1
    assert result.overlap > 0.8


def test_what_is_left_out_is_not_there(targets: Targets) -> None:
    result = Fixer().fix(scene(1), targets, PLACES, left_out=np.array([False, True, False]))
    assert {one.row for one in result.hypotheses} <= {0, 2}
    assert Fixer().fix(scene(1), targets, PLACES, left_out=np.ones(3, bool)) == ScanFix()


def test_millimetres_are_not_accepted(targets: Targets) -> None:
    assert all(one.overlap < 0.1 for one in Fixer().fix(scene() * 1000, targets, PLACES).hypotheses)


def test_the_likeliest_comes_first_whatever_its_spread_and_runners_up_are_elsewhere() -> None:
    result = ScanFix.of(
        [
            hypothesis(0, 0.4, 0.001),
            hypothesis(7, 0.9, 0.03),
            hypothesis(9, 0.5),
            hypothesis(20, 0.3),
        ],
        OVERLAPS,
    )
    assert [one.here.overlap for one in result.hypotheses] == [0.9, 0.5, 0.4, 0.3]
    assert result.elsewhere == [2, 3]  # 9 m is within 5 m of 7 m
    odds = np.exp([4.0, 0.0, -1.0, -2.0])
    assert result.probabilities == pytest.approx(odds / (1 + odds.sum()))


def test_hypotheses_at_one_pose_are_merged_and_share_no_probability() -> None:
    one = hypothesis(0, 0.5)
    again = hypothesis(1.5, 0.4)
    turned = hypothesis(0, 0.4, yaw_deg=6)
    result = ScanFix.of([again, turned, one], OVERLAPS)
    assert result.hypotheses == (one, turned)
    assert result.probability == pytest.approx(1 / (1 + 1 + np.exp(-1)))


def test_a_perceptual_alias_lowers_the_probability() -> None:
    alone = ScanFix.of([hypothesis(0, 0.9)], OVERLAPS)
    beside = ScanFix.of([hypothesis(0, 0.9), hypothesis(20, 0.9)], OVERLAPS)
    assert alone.probability == pytest.approx(np.exp(4) / (1 + np.exp(4)))
    assert beside.probability == pytest.approx(np.exp(4) / (1 + 2 * np.exp(4)))


def test_a_sure_hypothesis_ends_the_search(targets: Targets) -> None:
    query = seen_from(scene(1), planar(1, 0, 90))
    every, first = (Fixer(sure=sure).fix(query, targets, PLACES) for sure in (1.0, 0.9))
    assert len(every.hypotheses) > len(first.hypotheses)
    assert first.hypotheses[0].row == every.hypotheses[0].row == 1


def test_the_rankings_own_pose_is_tried_first(targets: Targets) -> None:
    """Row 1 heads 90° and the query 30° to its left; once it is sure, no walls are matched."""
    query = seen_from(scene(1), planar(1, 2, 30))
    world_T_query = ANCHORS[1] @ planar(1, 2, 30)
    answers = Answers(world_T_query[None, :2, 3] + 0.5, np.array([123.0]))
    result = Fixer(sure=0.9, rounds=(1,), tries=1).fix(query, targets, answers)
    assert len(result.hypotheses) == 1
    away_m, turn_deg = distance_and_turn(
        result.hypotheses[0].world_T_query[None], world_T_query[None]
    )
    assert away_m[0] < 0.1
    assert turn_deg[0] < 0.3


def test_the_nearest_rows_come_in_the_order_of_the_positions(targets: Targets) -> None:
    positions_m = np.array([[390.0, 5.0], [10.0, 0.0], [np.nan, 0.0], [380.0, 0.0], [180.0, 0.0]])
    rows = targets.nearest(positions_m, np.zeros(3, bool))
    assert list(targets.spaced(rows)) == [2, 0, 1]
    assert list(targets.nearest(positions_m, np.array([False, False, True]))) == [1, 0, 1, 1]


def test_settings_and_a_missing_map_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"fixer\.tries=0: expected a number above 0"):
        Fixer(tries=0)
    with pytest.raises(ConfigError, match=r"fixer\.rounds=\(5, 0\): expected at least 1"):
        Fixer(rounds=(5, 0))
    with pytest.raises(ArtifactError, match="no such artifact"):
        Targets.read(tmp_path / "none.zarr")


def test_a_hypothesis_is_ahead_of_the_best_other_one_and_alone_of_none() -> None:
    """Qualities are the overlaps here: .9, .5 and .4."""
    three = [hypothesis(0, 0.5), hypothesis(20, 0.9), hypothesis(40, 0.4)]
    assert features(three)[:, -1] == pytest.approx([-0.4, 0.4, -0.5])
    assert features(three[:1])[:, -1].tolist() == [0.0]
