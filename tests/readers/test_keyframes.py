"""Tests the reader of key frames: clouds named by number, and four poses in a row."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.core.errors import LogError
from pipeline.core.frames import yaw
from pipeline.readers.keyframes import KeyFrames
from tests.readers.damage import one_line, opened
from tests.readers.logs import key_frames


def test_the_body_looks_where_it_drives(tmp_path: Path) -> None:
    root = key_frames(tmp_path)
    (root / "run" / "1.pcd").unlink()
    reader = KeyFrames(body_T_lidar=(0, 0, 0, 0, 0, 90), lift_m=0.5)
    assert reader.sequences(root) == {"run": []}
    log = opened(reader, root, "run")
    assert log is not None
    assert log.stamps_ns.tolist() == [100 * 10**9, 102 * 10**9, 103 * 10**9]
    assert log.skipped == {"no such file": 1}
    driven_m = np.array([[3, 0, 0], [3, -2, 0], [3, -3, 0]])
    assert log.world_T_scan[:, :3, 3] == pytest.approx(driven_m)
    assert log.odom_T_scan[:, 0, 3] == pytest.approx(0)  # x distinguishes the four sources
    assert yaw(log.world_T_scan) == pytest.approx(-np.pi / 2)
    assert log.points(1) == pytest.approx(np.array([[2, 0, 2.5]]))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1 2 3\n", "expected 33 numbers a row, found 3"),
        ("1e300 " * 33 + "\n", "row 1 names cloud 1e\\+300"),
        ("-inf " * 33 + "\n", "row 1 names cloud -inf"),
        ("0 " * 33 + "\n", "row 1 has a quaternion"),
        ("", "no rows"),
    ],
)
def test_a_wrong_table_raises_an_error_of_one_line(tmp_path: Path, text: str, says: str) -> None:
    root = key_frames(tmp_path)
    (root / "run" / "keyframes.txt").write_text(text)
    with one_line(LogError, says):
        KeyFrames().open(root, "run")


def test_clouds_are_needed(tmp_path: Path) -> None:
    root = key_frames(tmp_path)
    for path in (root / "run").glob("*.pcd"):
        path.unlink()
    with one_line(LogError, "none of the 4 clouds that keyframes.txt names"):
        KeyFrames().open(root, "run")


def test_nclts_key_frames_drive_forward(real: Path) -> None:
    log = KeyFrames(body_T_lidar=(0, 0, 0, 0, 0, 90), lift_m=0.78).open(real, "nclt_keyframes")
    steps_m = np.diff(log.world_T_scan[:400, :3, 3], axis=0)
    ahead = log.world_T_scan[:399, :3, 0]
    along = np.einsum("nx,nx->n", steps_m, ahead) / np.linalg.norm(steps_m, axis=1).clip(0.1)
    assert len(log.stamps_ns) == 1141
    assert np.median(along) > 0.95
