"""Tests the search for a scan's walls in a whole map from above, against all positions one by
one."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.signal import correlate

from pipeline.mapping.wall_chart import BESIDE, SEEN_THROUGH, WALL
from pipeline.matching import correlation
from pipeline.matching.correlation import Correlation, Fits, WallMap
from pipeline.views.walls import Walls
from tests.mapping.town import scan, town
from tests.posing.scene import planar

REACH = 20
HEADINGS = 60
SEE_THROUGH = 0.3


def town_map(seed: int = 0, side_m: float = 90.0, reach: int = REACH) -> WallMap:
    """The walls of a made town, in cells of 1 m; a scan may have been taken anywhere in it."""
    side = int(side_m)
    points_m = town(seed, side_m)
    cells = np.floor(points_m[points_m[:, 2] > 1][:, :2]).astype(int)
    cells = cells[((cells >= 0) & (cells < side)).all(axis=1)]
    counts = np.bincount(cells @ [side, 1], minlength=side**2).reshape(side, side)
    everywhere = np.ones((side, side), bool)
    return WallMap(counts.clip(0, 255).astype(np.uint8), everywhere, np.zeros(2), 1.0, reach)


def seen(
    town_seed: int, pose: NDArray[np.float64], side_m: float = 90.0, reach: int = REACH
) -> NDArray[np.int8]:
    """The walls and the seen-through cells of a scan in the town."""
    return Walls(range_m=reach)(scan(town(town_seed, side_m), pose))


def fits(walls: WallMap, image: NDArray[np.int8], k: int = 10, blocks: int = 300) -> Fits:
    return walls.fits(image, k, Correlation(HEADINGS, SEE_THROUGH, blocks, apart_m=4.0))


def exhaustive(walls: WallMap, image: NDArray[np.int8]) -> NDArray[np.float64]:
    """The score (heading, x, y) at each heading, half a step apart, and each position in cells."""
    is_wall = np.pad(walls.counts > 0, 2 * REACH)
    gains = np.where(is_wall, WALL, np.where(maximum_filter(is_wall, 3), BESIDE, 0))
    losses = -2 * SEE_THROUGH * is_wall
    headings_rad = np.arange(2 * HEADINGS) * np.pi / HEADINGS
    scores = []
    for angle in headings_rad:
        rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        total = np.zeros(walls.counts.shape)
        for value, chart in ((WALL, gains), (SEEN_THROUGH, losses)):
            middles = np.argwhere(image == value) - REACH + 0.5
            turned = np.zeros((4 * REACH, 4 * REACH))
            np.add.at(turned, tuple(np.floor(middles @ rotation.T).astype(int).T + 2 * REACH), 1)
            total += correlate(chart, turned, "valid", "fft")[:-1, :-1]
        scores.append(total / (WALL * np.count_nonzero(image == WALL)))
    return np.array(scores)


def poses(count: int, side_m: float = 90.0, seed: int = 7) -> list[NDArray[np.float64]]:
    """Random poses in the town."""
    rng = np.random.default_rng(seed)
    return [
        planar(*rng.uniform(15, side_m - 15, 2), float(rng.uniform(0, 360))) for _ in range(count)
    ]


def turned_by(first_deg: float, second_deg: float) -> float:
    """The angle between two headings, in degrees."""
    return abs((first_deg - second_deg + 180) % 360 - 180)


def test_the_search_finds_what_a_search_of_all_positions_finds() -> None:
    walls = town_map()
    for pose in poses(4):
        image = seen(0, pose)
        scores = exhaustive(walls, image)
        found = fits(walls, image)
        heading, x, y = np.unravel_index(scores.argmax(), scores.shape)
        np.testing.assert_allclose(found.scores[0], scores.max(), atol=1e-9)
        assert np.abs(found.xy_m[0] - (x, y)).max() <= 1
        assert turned_by(found.heading_deg[0], heading * 180 / HEADINGS) <= 3
        # Each answer has the score of its position and heading, or one out of the map.
        for xy_m, heading_deg, score in zip(*found, strict=True):
            number = round(heading_deg * HEADINGS / 180) % (2 * HEADINGS)
            x, y = np.rint(xy_m).astype(int)
            if min(x, y) >= 0 and max(x, y) < 90:
                np.testing.assert_allclose(score, scores[number, x, y], atol=1e-9)


def test_a_turned_scan_is_found_with_its_position_and_heading() -> None:
    walls = town_map(1)
    all_poses = poses(20)
    found = [fits(walls, seen(1, pose), k=1) for pose in all_poses]
    away_m = [
        np.linalg.norm(fit.xy_m[0] - pose[:2, 3])
        for fit, pose in zip(found, all_poses, strict=True)
    ]
    turns_deg = [
        turned_by(fit.heading_deg[0], np.rad2deg(np.arctan2(pose[1, 0], pose[0, 0])))
        for fit, pose in zip(found, all_poses, strict=True)
    ]
    is_right = (np.array(away_m) < 2) & (np.array(turns_deg) < 6)
    assert is_right.sum() >= 19  # 20 of 20 measured


def test_answers_are_apart_and_the_best_comes_first() -> None:
    found = fits(town_map(), seen(0, planar(40, 50, 30)), k=30)
    assert 10 < len(found.scores) <= 30
    assert (np.diff(found.scores) <= 0).all()
    # They are 4 m apart before the last step, which moves each by at most 3 m along each axis.
    assert len({tuple(xy) for xy in found.xy_m.tolist()}) > 10


def test_no_more_answers_than_there_is_room_for() -> None:
    # 20 by 20 cells have room for at most some 36 positions that are 4 m apart.
    walls = town_map(0, 20.0)
    found = fits(walls, seen(0, planar(10, 10, 0), 20.0), k=500, blocks=10_000)
    assert 0 < len(found.scores) < 100
    assert np.isfinite(found.scores).all()


def corridor(length: int) -> NDArray[np.bool_]:
    """Cells (40, 40) with two walls along x, 6 cells apart, on `length` cells in the middle."""
    cells = np.zeros((40, 40), bool)
    cells[20 - length // 2 : 20 + length // 2, [16, 23]] = True
    return cells


def test_a_place_whose_walls_the_scan_saw_through_is_worse() -> None:
    # Two alike pairs of walls, but across the second stands another wall, which the scan saw
    # through: (2, 1) of 24 cells, each −.6 of 2 · 24.
    counts = np.zeros((120, 60), np.uint8)
    counts[10:50, 10:50] += corridor(12).astype(np.uint8) * 5
    counts[70:110, 10:50] += corridor(12).astype(np.uint8) * 5
    counts[90:92, 28:32] = 5
    walls = WallMap(counts, np.ones(counts.shape, bool), np.zeros(2), 1.0, REACH)
    image = np.zeros((2 * REACH, 2 * REACH), np.int8)
    image[corridor(12)] = WALL
    image[14:26, 18:22] = SEEN_THROUGH
    found = fits(walls, image, k=2000)
    best = {tuple(xy): score for xy, score in zip(found.xy_m.tolist(), found.scores, strict=True)}
    assert tuple(found.xy_m[0]) == (30, 30)
    assert best[30, 30] == 1.0
    # 8 cells of the wall are seen through, at each 2 · .3 of 2 for each of the 24 cells of walls.
    np.testing.assert_allclose(best[90, 30], 1 - 8 * 2 * SEE_THROUGH / (2 * 24))
    ignorant = walls.fits(image, 2000, Correlation(HEADINGS, 0.0, 300, 4.0))
    assert ignorant.scores[1] == 1.0


@pytest.mark.parametrize("xy_m", [(1.0, 45.0), (89.0, 45.0), (45.0, 1.0), (45.0, 89.0)])
def test_a_scan_at_the_border_of_the_map_is_found(xy_m: tuple[float, float]) -> None:
    found = fits(town_map(4, reach=50), seen(4, planar(*xy_m, 200.0), reach=50), k=1)
    assert np.linalg.norm(found.xy_m[0] - xy_m) < 3
    assert turned_by(found.heading_deg[0], 200.0) < 6


def test_answers_lie_where_a_scan_may_have_been_taken() -> None:
    # Only the last 10 of 300 cells along y, and the first 10, of the same town twice.
    one = town_map()
    counts = np.concatenate([one.counts, np.zeros((90, 120), np.uint8), one.counts], axis=1)
    is_candidate = np.zeros(counts.shape, bool)
    is_candidate[30:50, 30:60] = True
    walls = WallMap(counts, is_candidate, np.array([-100.0, 500.0]), 1.0, REACH)
    found = fits(walls, seen(0, planar(40, 45, 10)), k=50)
    steps = found.xy_m - walls.corner_m
    # Whole blocks of 8 cells are searched, and 3 cells beside them.
    assert (steps >= (30 - 11, 30 - 11)).all()
    assert (steps <= (50 + 11, 60 + 11)).all()
    assert np.linalg.norm(steps[0] - (40, 45)) < 2


def test_a_scan_without_walls_and_a_map_without_candidates_have_no_answer() -> None:
    walls = town_map()
    nothing = np.full((2 * REACH, 2 * REACH), SEEN_THROUGH, np.int8)
    assert [len(part) for part in fits(walls, nothing)] == [0, 0, 0]
    nowhere = WallMap(walls.counts, walls.is_candidate & False, walls.corner_m, 1.0, REACH)
    assert [len(part) for part in fits(nowhere, seen(0, planar(40, 45, 10)))] == [0, 0, 0]


def test_a_large_map_is_searched_with_a_sample_of_the_cells(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    walls = town_map(1)
    shares: list[float] = []
    sampled = correlation._sampled

    def noted(cells: NDArray[np.float64], count: int) -> tuple[NDArray[np.float64], float]:
        sample, share = sampled(cells, count)
        shares.append(share)
        return sample, share

    monkeypatch.setattr(correlation, "_sampled", noted)
    monkeypatch.setattr(correlation, "MOST_SUMS", 1)
    monkeypatch.setattr(correlation, "FEWEST_CELLS", 15)
    right = 0
    for pose in poses(10):
        found = fits(walls, seen(1, pose), k=1)
        right += np.linalg.norm(found.xy_m[0] - pose[:2, 3]) < 2
    assert np.median(shares) < 0.8
    assert right >= 9


def test_sums_of_more_walls_than_fit_into_a_byte_are_exact() -> None:
    # A solid block of 20 by 20 cells: 400 walls of 2 sum to 800, more than a byte holds.
    counts = np.zeros((60, 60), np.uint8)
    counts[20:40, 20:40] = 255
    walls = WallMap(counts, np.ones(counts.shape, bool), np.zeros(2), 1.0, REACH)
    image = np.zeros((2 * REACH, 2 * REACH), np.int8)
    image[10:30, 10:30] = WALL
    found = fits(walls, image, k=1)
    assert found.scores[0] == 1.0
    np.testing.assert_array_equal(found.xy_m[0], [30, 30])


def test_walls_in_the_corners_of_a_scan_are_beyond_its_reach() -> None:
    # 20 cells are in reach; the corner is hypot(19.5, 19.5) = 27.6 cells away.
    walls = town_map()
    image = seen(0, planar(40, 45, 10))
    cornered = image.copy()
    cornered[[0, 0, -1, -1], [0, -1, 0, -1]] = WALL
    for one, other in zip(fits(walls, image), fits(walls, cornered), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("reach", [19, 20])
def test_reaches_of_any_parity_are_searched(reach: int) -> None:
    found = fits(town_map(1, reach=reach), seen(1, planar(45, 40, 77), reach=reach), k=1)
    assert np.linalg.norm(found.xy_m[0] - (45, 40)) < 2


def test_a_window_shows_the_map_around_a_position_and_nothing_beyond_it() -> None:
    counts = np.zeros((30, 30), np.uint8)
    counts[10, 12] = 1
    walls = WallMap(counts, np.ones((30, 30), bool), np.array([100.0, 200.0]), 1.0, REACH)
    # Cell (10, 12) is 1 along x and 0 along y from the position, in the middle of 6 cells.
    window = walls.window(np.array([109.0, 212.0]), 3)
    expected = np.zeros((6, 6), np.int8)
    expected[3:6, 2:5] = BESIDE
    expected[4, 3] = WALL
    np.testing.assert_array_equal(window, expected)
    assert not walls.window(np.array([-900.0, 212.0]), 3).any()


def test_the_score_at_a_pose_is_that_of_the_fit_there_and_less_elsewhere() -> None:
    walls = town_map(4, reach=50)
    image = seen(4, planar(45.0, 40.0, 200.0), reach=50)
    search = Correlation(HEADINGS, SEE_THROUGH, 300)
    found = walls.fits(image, 1, search)
    there = walls.score_at(image, found.xy_m[0], float(found.heading_deg[0]), search)
    assert there >= found.scores[0]
    assert there < found.scores[0] + 0.05  # half a step of headings further on
    assert walls.score_at(image, found.xy_m[0] + [12.0, 0.0], 200.0, search) < there - 0.1


def test_no_walls_and_a_position_far_from_the_map_score_nothing() -> None:
    walls = town_map()
    image = seen(0, planar(45.0, 45.0, 0.0))
    search = Correlation(HEADINGS, SEE_THROUGH, 300)
    assert walls.score_at(image, np.array([1e5, 45.0]), 0.0, search) == 0.0
    assert walls.score_at(image, np.array([45.0, -1e5]), 0.0, search) == 0.0
    assert walls.score_at(np.zeros_like(image), np.array([45.0, 45.0]), 0.0, search) == 0.0
