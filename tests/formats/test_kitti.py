"""Tests how KITTI's scans, poses, times and calibration are encoded and decoded."""

from pathlib import Path

import numpy as np

from pipeline.formats.kitti import (
    CAM_T_VELO,
    decode,
    encode,
    to_poses,
    write_calib,
    write_poses,
    write_times,
)


def test_twelve_numbers_are_three_rows_of_a_pose() -> None:
    found = to_poses(np.arange(24.0).reshape(2, 12))
    np.testing.assert_array_equal(
        found[1], [[12, 13, 14, 15], [16, 17, 18, 19], [20, 21, 22, 23], [0, 0, 0, 1]]
    )


def test_a_scan_is_four_little_endian_floats_a_point() -> None:
    # 1.0 is 3f800000, −2.0 c0000000, 0.5 3f000000, 0.25 3e800000.
    assert encode(np.array([[1.0, -2.0, 0.5]]), np.array([0.25])) == bytes.fromhex(
        "0000803f 000000c0 0000003f 0000803e"
    )


def test_the_lidar_s_axes_are_turned_into_the_camera_s() -> None:
    # Forward is the camera's z, left is −x, up is −y; the lidar's origin lies 29 cm behind the
    # camera.
    np.testing.assert_allclose(CAM_T_VELO @ [1, 0, 0, 0], [0, 0, 1, 0])
    np.testing.assert_allclose(CAM_T_VELO @ [0, 1, 0, 0], [-1, 0, 0, 0])
    np.testing.assert_allclose(CAM_T_VELO @ [0, 0, 1, 0], [0, -1, 0, 0])
    np.testing.assert_allclose(CAM_T_VELO[:3, 3], [-0.012, -0.054, -0.292])


def test_text_files_have_twelve_numbers_a_row(tmp_path: Path) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 1000 / 3
    write_poses(tmp_path / "poses" / "00.txt", pose[None])
    np.testing.assert_allclose(
        np.loadtxt(tmp_path / "poses" / "00.txt"),
        [1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 1000 / 3],
        atol=1e-9,
    )
    write_times(tmp_path / "times.txt", np.array([0.0, 0.1, 120.3]))
    assert (tmp_path / "times.txt").read_text() == "0.000000e+00\n1.000000e-01\n1.203000e+02\n"
    write_calib(tmp_path / "calib.txt")
    rows = dict(line.split(": ") for line in (tmp_path / "calib.txt").read_text().splitlines())
    assert list(rows) == ["P0", "P1", "P2", "P3", "Tr"]
    np.testing.assert_allclose(to_poses(np.array([rows["Tr"].split()], float))[0], CAM_T_VELO)
    assert {len(row.split()) for row in rows.values()} == {12}


def test_decoding_gives_the_bits_of_the_plain_formula() -> None:
    numbers = np.random.default_rng(0).normal(size=(1000, 4)).astype("<f4")
    numbers[:3, :3] = (-0.0, np.nan, 1), (-0.0, -0.0, 5), (np.inf, 1, 1)
    plain = numbers[np.isfinite(numbers[:, :3]).all(axis=1), :3] + np.array([0.0, 0.0, 1.73])
    assert len(plain) == 998
    assert decode(numbers.ravel(), 1.73).tobytes() == plain.tobytes()
