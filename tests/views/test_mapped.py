"""Bird-views of submaps, drawn of a map that remembers the scans before."""

from pathlib import Path

import numpy as np
import pytest

from pipeline import store
from pipeline.mapping.octree import Octree
from pipeline.schemas import SCANS, SUBMAPS
from pipeline.views.birdview import BirdView
from pipeline.views.mapped import MappedViews

VIEW = BirdView(octree=Octree(edge_m=16.0, depth=5, motion="none"), headings=8, side_px=16, jitter_m=0.0)
"""A leaf is half a metre, a pixel a metre."""
POLES_M = np.array([[4.25, 0.25], [-0.25, 3.25], [0.25, -5.25]])
"""In the world: ahead, to the left and to the right of where the robot starts. Scan i sees pole i alone."""
UNKNOWN = np.full((4, 4), np.nan)


def at(x_m: float) -> np.ndarray:
    pose = np.eye(4)
    pose[0, 3] = x_m
    return pose


def mapped(folder: Path, odom_T_scan: np.ndarray, ground_m: float = 0.0) -> MappedViews:
    """Three scans half a metre apart, each a submap."""
    world_T_scan = np.stack([at(0.0), at(0.5), at(1.0)])
    heights_m = np.arange(0.75, 3.0, 0.25)
    points = [np.column_stack([np.tile(pole - (0.5 * i, 0), (len(heights_m), 1)), heights_m]) for i, pole in enumerate(POLES_M)]
    with store.write(folder / "scans.zarr", SCANS, grain_m=0.005, skipped={}, clipped=0) as draft:
        draft.put("points", np.rint(np.concatenate(points) / 0.005).astype(np.int16))
        draft.put("offsets", np.arange(4) * len(heights_m))
        draft.put("stamps_ns", np.arange(3))
        draft.put("world_T_scan", world_T_scan)
        draft.put("odom_T_scan", odom_T_scan)
    with store.write(folder / "submaps.zarr", SUBMAPS, layout="world_T_scan", left_out={}) as draft:
        for name in ("first", "scans", "stamps_ns"):
            draft.put(name, np.arange(3))
        draft.put("ground_m", np.full(3, ground_m))
        draft.put("used", np.ones(3, bool))
        draft.put("world_T_anchor", world_T_scan)
    return MappedViews(store.read(folder / "scans.zarr", SCANS), store.read(folder / "submaps.zarr", SUBMAPS), VIEW)


def poles(mapped: MappedViews) -> list[int]:
    """Bright spots in each submap's straight view."""
    return [int((images[0] > 30).sum()) for images in mapped]


def test_a_view_shows_what_earlier_scans_saw(tmp_path: Path) -> None:
    assert poles(mapped(tmp_path, np.stack([at(0.0), at(0.5), at(1.0)]))) == [1, 2, 3]


def test_a_pole_seen_once_comes_nearer_as_the_robot_drives(tmp_path: Path) -> None:
    views = [images[0] for images in mapped(tmp_path, np.stack([at(0.0), at(0.5), at(1.0)]))]
    # pole 0 is 4.25 m ahead, then 3.25: the image's middle is row 8, so rows 8 − 5 and 8 − 4; y = 0.25 m is left of the middle
    assert views[0].argmax() == 3 * 16 + 7
    assert views[2][4, 7] == views[0].max()


def test_a_log_without_odometry_is_laid_out_by_its_truth(tmp_path: Path) -> None:
    assert poles(mapped(tmp_path, np.stack([UNKNOWN] * 3))) == [1, 2, 3]


@pytest.mark.parametrize(("unknown", "seen"), [(0, [1, 1, 2]), (1, [1, 1, 1]), (2, [1, 2, 1])])
def test_a_break_in_the_odometry_begins_a_new_map(tmp_path: Path, unknown: int, seen: list[int]) -> None:
    odom_T_scan = np.stack([at(0.0), at(0.5), at(1.0)])
    odom_T_scan[unknown] = np.nan
    assert poles(mapped(tmp_path, odom_T_scan)) == seen


def test_heights_count_from_the_submaps_ground(tmp_path: Path) -> None:
    """With the ground at 2.5 m the poles' tops at 2.75 m are not above 0.3 m any more."""
    assert poles(mapped(tmp_path, np.stack([at(0.0), at(0.5), at(1.0)]), ground_m=2.5)) == [0, 0, 0]
