"""The drive in 3-D: what is counted, where the camera is, and what a frame shows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError
from pipeline.core.progress import Progress
from pipeline.report.figures.accepted import AcceptedDrive, verdicts
from pipeline.report.figures.chase import (
    ACCEPTED,
    FOCAL_PX,
    GREYS,
    HEIGHT_PX,
    REFUSED,
    WIDTH_PX,
    chase,
    frame,
    projected,
    write,
)
from tests.posing.scene import planar

TRUE = np.array([planar(x, 0, 0) for x in (0, 10, 20, 30)])
"""Four queries along x: accepted and right; accepted, 3 m off; refused, 3 m off; without a pose."""
NOWHERE = np.full((4, 4), np.nan)
FOUND = np.array([planar(0, 0, 0), planar(10, 3, 0), planar(20, 3, 0), NOWHERE])
WALL_M = np.array([(x, 6.0, z) for x in np.arange(0, 12, 0.1) for z in np.arange(0, 4, 0.2)])
PLAN = np.s_[HEIGHT_PX - 180 :, WIDTH_PX - 200 :]


@pytest.fixture
def drive() -> AcceptedDrive:
    return AcceptedDrive(
        where="simulated street",
        model="sci_ring-pose",
        trained="monday",
        driven="tuesday",
        days=1,
        simulated=True,
        posed=True,
        target_precision=0.99,
        map_m=WALL_M + np.array((15.0, -14.0, 0.0)),
        world_T_true=TRUE,
        world_T_query=FOUND,
        accepted=np.array([True, True, False, False]),
        right=np.array([True, False, False, False]),
        points_m=lambda query: WALL_M,
    )


def share(picture: np.ndarray, ink: str) -> float:
    """Share of the pixels of the scene, without words and plan, that have a colour."""
    scene = picture.copy()
    scene[PLAN] = 255
    scene[:50] = 255
    scene[HEIGHT_PX - 80 :] = 255
    return float((scene == list(bytes.fromhex(ink[1:]))).all(axis=2).mean())


def test_what_is_accepted_wrong_and_refused_is_counted_up_to_each_query(
    drive: AcceptedDrive,
) -> None:
    """A query without a pose is refused, and nothing is wrong of it."""
    assert drive.counts.tolist() == [[1, 2, 2, 2], [0, 1, 1, 1], [0, 0, 1, 2], [0, 0, 1, 1]]


def test_the_camera_is_behind_the_robot_and_looks_ahead() -> None:
    """A robot at (5, 7) that looks along +y: 20 m ahead of it is in the middle column, 3 m to its
    left further left, and near things stand lower."""
    camera_T_world = chase(planar(5, 7, 90))
    at_px, depth_m = projected(
        camera_T_world, np.array([(5.0, 27.0, 0.0), (2.0, 27.0, 0.0), (5.0, 12.0, 0.0)])
    )
    assert at_px[0, 0] == pytest.approx(WIDTH_PX / 2)
    assert at_px[0, 0] - at_px[1, 0] == pytest.approx(3 * FOCAL_PX / depth_m[1])
    assert at_px[2, 1] > at_px[0, 1]
    assert not len(projected(camera_T_world, np.array([(5.0, -60.0, 0.0)]))[0])


def test_a_scan_has_the_colour_of_its_verdict_and_without_a_pose_none_is_drawn(
    drive: AcceptedDrive,
) -> None:
    first, _, third, last = (
        frame(drive, query, drive.counts[:, query].tolist()) for query in range(4)
    )
    assert share(first, ACCEPTED) > 0.002 > share(first, REFUSED)
    assert share(third, REFUSED) > 0.002
    assert share(last, REFUSED) < share(third, REFUSED) / 2  # dots alone
    assert sum(share(first, grey) for grey in GREYS) > 0.002


def test_simulated_is_said_and_so_is_recorded(drive: AcceptedDrive) -> None:
    simulated, recorded = (
        frame(replace(drive, simulated=is_simulated), 0, [1, 0, 0, 0])[:26, 560:]
        for is_simulated in (True, False)
    )
    assert (simulated < 255).any()
    assert (recorded < 255).any()
    assert not np.array_equal(simulated, recorded)


def test_the_file_has_a_frame_a_query_and_the_same_bytes_each_time(
    drive: AcceptedDrive, tmp_path: Path
) -> None:
    for name in ("once.gif", "again.gif"):
        assert write(drive, tmp_path / name, Progress())[0] == 4
    assert (tmp_path / "once.gif").read_bytes() == (tmp_path / "again.gif").read_bytes()
    with Image.open(tmp_path / "once.gif") as image:
        assert (image.n_frames, image.size) == (4, (WIDTH_PX, HEIGHT_PX))


@pytest.mark.parametrize(
    ("pose_thresholds", "accepted", "target_precision"),
    [
        ([0.7, 0.3, -1.0], [True, False, False, False], 0.99),
        ([0.7, -1.0, -1.0], [True, True, False, False], 0.95),
        ([-1.0, -1.0, -1.0], [False, False, False, False], None),
    ],
)
def test_the_highest_target_precision_that_is_kept_says_what_is_accepted(
    tmp_path: Path,
    pose_thresholds: list[float],
    accepted: list[bool],
    target_precision: float | None,
) -> None:
    """Error probabilities of .1, .5 and .9; the last has no pose."""
    caveat = np.array([0.1, 0.5, 0.9, 0.0], np.float32)
    flat = {"heading_deg": np.zeros((4, 1), np.float32), "costs": np.ones((4, 1), np.float32)}
    columns = flat | {
        "places": np.zeros((4, 1), np.int64),
        "xy_m": np.zeros((4, 1, 2)),
        "novelty": caveat[:, None],
        "confidence": 1 - caveat,
        "turned_deg": np.zeros(4, np.float32),
        "world_T_query": FOUND,
        "covariance": np.zeros((4, 6, 6)),
        "overlap": np.ones(4, np.float32),
    }
    attrs = {
        "cases": [{"change": "", "level": 0.0, "shadow": False, "repeat": 0}],
        "kinds": ["fix"],
        "thresholds": [0.3],
        "target_precision": 0.99,
        "target_precisions": [0.95, 0.99, 0.999],
        "pose_thresholds": pose_thresholds,
        "place_thresholds": pose_thresholds,
        "several_thresholds": pose_thresholds,
        "validation_blocks": 200,
        "right_within": [2.0, 5.0],
    }
    with store.draft(tmp_path / "day.zarr", schemas.Fixes, **attrs) as out:
        for name, values in columns.items():
            out.put(name, values)
    fixes = store.read(tmp_path / "day.zarr", schemas.Fixes)
    world_T_query, is_accepted, kept = verdicts(fixes, 4, 0.99)
    np.testing.assert_array_equal(world_T_query, FOUND)
    assert (is_accepted.tolist(), kept) == (accepted, target_precision)
    with pytest.raises(ArtifactError, match="4 poses of 5 submaps"):
        verdicts(fixes, 5, 0.99)
