"""Tests of the walls of the whole map: which submaps are drawn, and where a query fits."""

from pathlib import Path

import numpy as np

from pipeline.mapping.wall_chart import SEEN_THROUGH, WALL
from pipeline.posing.targets import Targets
from pipeline.posing.whole_map import Slid, WholeMap
from tests.artifacts import write_map
from tests.mapping.town import scan, town
from tests.posing.scene import planar

AT = planar(45, 40, 200)
ANCHORS = np.array([planar(x_m, 40, 0) for x_m in (5.0, 25.0, 45.0, 65.0, 85.0)])
NONE = np.zeros(len(ANCHORS), bool)


def mapped(folder: Path) -> Targets:
    """The map of five scans along a street of a made town."""
    points_m = town(4, 90.0)
    write_map(folder / "day.zarr", [scan(points_m, anchor) for anchor in ANCHORS], ANCHORS)
    return Targets.read(folder / "day.zarr")


def slid(targets: Targets, left_out: np.ndarray) -> Slid:
    whole_map = WholeMap()
    image = whole_map.scan(scan(town(4, 90.0), AT), is_single_scan=True)
    return Slid(whole_map, targets.wall_map(whole_map, left_out), image)


def test_a_query_is_found_in_the_map_without_a_ranking(tmp_path: Path) -> None:
    found = slid(mapped(tmp_path), NONE)
    assert np.linalg.norm(found.fits.xy_m[0] - AT[:2, 3]) < 2
    assert abs(found.fits.heading_deg[0] - 200) < 4
    assert abs(found.score_at(AT) - found.fits.scores[0]) < 0.1  # half a step of headings apart


def test_fits_at_the_pose_are_not_elsewhere_unless_they_are_turned(tmp_path: Path) -> None:
    found = slid(mapped(tmp_path), NONE)
    assert 0 not in found.elsewhere(AT, 3.0, 1.0)
    away_m = np.linalg.norm(found.fits.xy_m - AT[:2, 3], axis=1)
    assert found.elsewhere(AT, 3.0, 1.0).tolist() == np.flatnonzero(away_m >= 3).tolist()
    assert 0 in found.elsewhere(planar(45, 40, 110), 3.0, 1.0)
    assert 0 in found.elsewhere(planar(49, 40, 200), 3.0, 1.0)


def test_a_better_fit_beside_a_pose_is_elsewhere_if_only_one_of_them_can_be_right(
    tmp_path: Path,
) -> None:
    """A pose is right within 2 m."""
    found = slid(mapped(tmp_path), NONE)
    score = found.fits.scores[0]
    assert 0 in found.elsewhere(planar(47.5, 40, 200), 3.0, score - 0.1)
    assert 0 not in found.elsewhere(planar(47.5, 40, 200), 3.0, score + 0.1)
    assert 0 not in found.elsewhere(planar(46, 40, 200), 3.0, score - 0.1)


def test_a_submap_that_is_left_out_is_not_drawn(tmp_path: Path) -> None:
    """Without the middle submaps no candidate is within 6 m of the query, and walls are missing."""
    targets = mapped(tmp_path)
    left_out = np.array([False, True, True, True, False])
    whole_map = WholeMap()
    walls = targets.wall_map(whole_map, left_out)
    assert walls.counts.astype(int).sum() < targets.wall_map(whole_map, NONE).counts.sum() / 2
    assert np.linalg.norm(slid(targets, left_out).fits.xy_m - AT[:2, 3], axis=1).min() > 10


def test_only_a_single_scan_has_seen_through_the_space_before_walls() -> None:
    points_m = scan(town(4, 90.0), AT)
    single = WholeMap().scan(points_m, is_single_scan=True)
    gathered = WholeMap().scan(points_m, is_single_scan=False)
    assert (single == SEEN_THROUGH).any()
    assert not (gathered == SEEN_THROUGH).any()
    assert ((single == WALL) == (gathered == WALL)).all()


def test_the_map_of_walls_in_a_site_is_the_one_that_its_submaps_draw(tmp_path: Path) -> None:
    targets = mapped(tmp_path)
    drawn = targets.wall_map(WholeMap(), NONE)
    arrays = {name: targets._arrays[name] for name in ("points", "offsets", "world_T_anchor")}
    arrays |= drawn.arrays
    arrays["points"] = arrays["points"] * 0  # nothing can be drawn from these
    of_site = Targets(arrays, 0.01, 80.0, single=True)
    again = of_site.wall_map(WholeMap(), NONE)
    assert (again.counts == drawn.counts).all()
    assert (again.is_candidate == drawn.is_candidate).all()
    # Without some rows it is drawn again.
    assert not of_site.wall_map(WholeMap(), np.arange(5) < 2).counts.any()
