"""Tests of the evidence from validation blocks of a training day: queries on maps with and without
their surroundings."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.progress import Progress
from pipeline.matching.ranking import Ranking, Rows
from pipeline.posing.ageing import Ageing
from pipeline.posing.fix import ScanFix
from pipeline.posing.probabilities import HypothesisModel
from pipeline.posing.search import Fixer
from pipeline.posing.targets import write_map
from pipeline.posing.validation import (
    Drive,
    TrainingDay,
    ValidationBlocks,
    gated,
    least_overlap,
    street_of,
)
from pipeline.posing.verdict import USUAL, FixEvidence
from tests.posing.scene import hypothesis, planar, scene, seen_from
from tests.posing.test_queries import drive

ANCHORS = np.array([planar(x_m, y_m, 0) for y_m in (0, 400) for x_m in (0, 2, 4, 6)])
"""Two scenes far apart, each driven through in steps of 2 m."""
VIEWS = Rows(np.zeros((8, 1)), np.arange(8), ANCHORS)
VALIDATION = ValidationBlocks(every_m=4.0, length_m=2.0, around_m=(30.0, 40.0))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map, beside the drive's scans and submaps."""
    folder = tmp_path_factory.mktemp("day")
    clouds = [seen_from(scene(seed), planar(x_m, 0, 0)) for seed in (0, 1) for x_m in (0, 2, 4, 6)]
    write_map(folder / "day.zarr", *drive(folder, "day", ANCHORS, clouds), 0.5, 80.0, 50.0)
    return folder / "day.zarr"


def looked_at(points_m: np.ndarray) -> np.ndarray:
    """An empty view, since the localizer knows where each row is."""
    return np.zeros(1)


def localizer(views: Rows, k: int) -> Ranking:
    """Answers each view with its true place."""
    xy_m = views.world_T_anchor[:, None, :2, 3]
    n = len(views.stamps_ns)
    column = np.zeros((n, 1), np.float32)
    return Ranking(np.zeros((n, 1), np.int64), column, xy_m, column, column[:, 0], column, ("own",))


def evidence_of(views: Rows, path: Path, how: ValidationBlocks = VALIDATION) -> FixEvidence:
    drive = Drive(path.parent / "scans" / "day.zarr", path.parent / "submaps" / "day.zarr")
    places = np.zeros(len(views.stamps_ns), np.int64)
    return how.evidence(
        Fixer(),
        TrainingDay(path, drive, views, places, looked_at, localizer, 1),
        Compute(),
        Progress(),
    )


@pytest.fixture(scope="module")
def evidence(path: Path) -> FixEvidence:
    return evidence_of(VIEWS, path)


def test_blocks_are_right_with_their_surroundings_aged_or_not_and_wrong_without_them(
    path: Path, evidence: FixEvidence
) -> None:
    """Blocks of 2 m in every 4 m; as these are too few, the scans between them are queries too."""
    queries = len(evidence.fixes) // 3
    assert queries == 8
    few = evidence_of(VIEWS, path, replace(VALIDATION, enough=1))
    assert len(few.fixes) == 3 * 4
    assert few.blocks < evidence.blocks
    assert evidence.unseen.tolist() == [False, False, True] * queries
    assert evidence.judged(USUAL)[1][:, 0].tolist() == [True, True, False] * queries
    assert evidence.blocks == len(np.unique(evidence.block)) > 1
    probability = np.array([fix.probability for fix in evidence.fixes])
    assert probability[~evidence.unseen].min() > probability[evidence.unseen].max()
    assert (
        probability[1::3] < probability[::3]
    ).mean() > 0.5  # an aged submap is less similar to the map


def test_approaches_are_refined_from_four_fifths_of_the_least_overlap_of_right_ones() -> None:
    def approached(overlap: float, x_m: float = 0.0) -> ScanFix:
        return ScanFix((replace(hypothesis(x_m, 0.8), approach_overlap=overlap),), (0.9,))

    true = np.eye(4)[None].repeat(2, axis=0)
    assert least_overlap([approached(0.25), approached(0.1, x_m=9.0)], true) == pytest.approx(0.2)
    assert least_overlap([approached(0.9), approached(0.8)], true) == 0.3  # not over this
    assert least_overlap([approached(0.9, x_m=9.0)], true[:1]) == 0.0  # none is right


def test_a_fix_loses_the_hypotheses_that_a_search_with_a_least_overlap_does_not_refine() -> None:
    hypotheses = [
        replace(hypothesis(x_m, 0.5), approach_overlap=overlap)
        for x_m, overlap in ((0.0, 0.4), (50.0, 0.1))
    ]
    unlikely = HypothesisModel((0.0,) * 6, -9.0)
    likely = HypothesisModel((0.0,) * 6, 0.0)
    assert len(gated(ScanFix.of(hypotheses, unlikely), 0.2, unlikely).hypotheses) == 1
    assert len(gated(ScanFix.of(hypotheses, likely), 0.2, likely).hypotheses) == 2


def test_evidence_stands_for_as_many_queries_as_there_are_blocks(evidence: FixEvidence) -> None:
    weight = evidence.weight(0.25)
    assert weight.sum() == pytest.approx(evidence.blocks)
    assert weight[evidence.unseen].sum() == pytest.approx(evidence.blocks / 4)


def test_a_scan_ages_by_what_was_built_felled_and_torn_down() -> None:
    """Each change alone: walls only add and hide, a wedge of 90° leaves three quarters of a circle
    at least, leaves fall."""
    rng = np.random.default_rng(0)
    circle_m = np.column_stack(
        [10 * np.cos(at := np.arange(3600) / 3600 * 2 * np.pi), 10 * np.sin(at), np.full(3600, 3.0)]
    )
    none = {
        "walls": 0,
        "wedge_deg": 0.0,
        "cars": 0,
        "crowns": 0,
        "went": 0,
        "above": 0.0,
        "below": 0.0,
    }
    assert np.array_equal(Ageing(**none).aged(circle_m, rng), circle_m)
    wedges = [len(Ageing(**none | {"wedge_deg": 90.0}).aged(circle_m, rng)) for _ in range(40)]
    assert 2700 <= min(wedges) < 3400
    assert max(wedges) == 3600
    leaves = [len(Ageing(**none | {"above": 0.5}).aged(circle_m, rng)) for _ in range(40)]
    assert 1700 < min(leaves) < 2400 < 3200 < max(leaves) <= 3600
    assert [len(Ageing(**none | {"below": 0.5}).aged(circle_m, rng)) for _ in range(5)] == [
        3600
    ] * 5
    for what, points, high_m in (("cars", 150, 1.5), ("crowns", 200, 8.5)):
        came = [Ageing(**none | {what: 10}).aged(circle_m, rng) for _ in range(40)]
        assert all(np.array_equal(aged[:3600], circle_m) for aged in came)  # they hide nothing
        assert {len(aged) for aged in came} <= {3600 + count * points for count in range(11)}
        assert min(map(len, came)) < 3600 + 3 * points < 3600 + 7 * points < max(map(len, came))
        new_m = np.concatenate([aged[3600:] for aged in came])
        assert np.hypot(*new_m[:, :2].T).min() > 5 - 3
        assert 0 <= new_m[:, 2].min() < new_m[:, 2].max() <= high_m
    went = [len(Ageing(**none | {"went": 3}).aged(circle_m, rng)) for _ in range(40)]
    assert 2000 < min(went) < max(went) == 3600
    walls = [Ageing(**none | {"walls": 2}).aged(circle_m, rng) for _ in range(40)]
    # Some stand before the circle
    assert min(np.isclose(np.hypot(*one[:, :2].T), 10.0).sum() for one in walls) < 3600
    assert any(len(one) > 3600 for one in walls)


def test_a_map_of_another_day_is_refused(path: Path) -> None:
    other = Rows(np.zeros((8, 1)), np.arange(8), ANCHORS[::-1])
    with pytest.raises(
        InputError, match=r"day\.zarr: a map of 8 submaps that are not the 8 of the training views"
    ):
        evidence_of(other, path)


def test_settings_that_make_no_evidence_are_refused() -> None:
    with pytest.raises(
        ConfigError, match=r"validation\.length_m=5\.0: expected less than validation\.every_m=4\.0"
    ):
        ValidationBlocks(every_m=4.0, length_m=5.0, around_m=(20.0,))
    with pytest.raises(
        ConfigError, match=r"validation\.around_m=\[20\.0, 0\]: expected lengths above 0"
    ):
        ValidationBlocks(every_m=4.0, length_m=2.0, around_m=(20.0, 0))
    with pytest.raises(ConfigError, match=r"ageing\.walls=-1: expected a number from 0 on"):
        Ageing(walls=-1)
    with pytest.raises(ConfigError, match=r"ageing\.went=-1: expected a number from 0 on"):
        Ageing(went=-1)


def test_a_street_ends_at_turns_and_has_its_second_drive_and_its_near_ends() -> None:
    """The path runs 100 m along x, then 100 m along y, then back along the first street, 5 m
    beside it; rows are 10 m apart."""
    along = [planar(x_m, 0, 0) for x_m in range(0, 100, 10)]
    up = [planar(100, y_m, 90) for y_m in range(0, 100, 10)]
    back = [planar(x_m, 5, 180) for x_m in range(90, -10, -10)]
    anchors = np.array([*along, *up, *back])
    street = street_of(anchors, 4)
    assert street[:10].all()
    # Within 20 m of the last row at x = 90 m are those of the side street up to y = 17.3 m.
    assert street[10:20].tolist() == [True] * 2 + [False] * 8
    assert street[20:].all()
    side_street = street_of(anchors, 15)
    assert side_street[10:20].all()
    assert side_street[:9].tolist() == [False] * 8 + [False]
    assert side_street[9]


def test_every_second_novel_place_lacks_its_whole_street() -> None:
    anchors = np.array([planar(x_m, 0, 0) for x_m in range(0, 400, 4)])
    assert VALIDATION._surroundings(anchors, 51).all()
    around = np.flatnonzero(VALIDATION._surroundings(anchors, 50))
    assert (around.min(), around.max()) == (41, 59)  # nearer than 40 m
