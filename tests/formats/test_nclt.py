"""Tests how NCLT's scans and poses are encoded, and that the reader reads what is written."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.core.frames import pose
from pipeline.formats import nclt
from pipeline.readers.nclt import read_poses, read_velodyne_sync


def test_a_hit_is_eight_bytes_of_the_data_sets_own_frame() -> None:
    # 1 m forward, 2 m left, 3 m up is (1, −2, −3) in the file: 20200, 19600, 19400, little-endian;
    # intensity 5, laser 31.
    data = nclt.encode(
        np.array([[1, 2, 3]], np.float32), np.array([5], np.uint8), np.array([31], np.uint8)
    )
    assert data == struct.pack("<3H2B", 20_200, 19_600, 19_400, 5, 31)


@given(st.lists(st.tuples(*[st.floats(-99.5, 99.5, width=32)] * 3), min_size=1, max_size=20))
@settings(max_examples=25)
def test_points_come_back_within_half_a_grain(
    tmp_path_factory: pytest.TempPathFactory, points: list[tuple[float, ...]]
) -> None:
    path = tmp_path_factory.getbasetemp() / "scan.bin"
    zeros = np.zeros(len(points), np.uint8)
    path.write_bytes(nclt.encode(np.array(points, np.float32), zeros, zeros))
    np.testing.assert_allclose(read_velodyne_sync(path), points, atol=0.0025 + 1e-6)


def test_poses_come_back(tmp_path: Path) -> None:
    path = tmp_path / "new" / "groundtruth.csv"
    rows = np.array(
        [[1, 2, 3, 0.1, 0.2, 0.3], [1.5, np.nan, 3, 0, 0, 0], [-1e3, 12.345678, 0, 0, 0, -3]]
    )
    utimes = 1_326_030_975_000_000 + np.array([0, 1, 1_000_000])
    nclt.write_pose_rows(path, utimes, rows)
    np.testing.assert_allclose(np.loadtxt(path, delimiter=",")[:, 1:], rows, rtol=1e-8)
    ground_truth = read_poses(path)
    assert ground_truth.stamps_ns.tolist() == (1000 * utimes).tolist()
    assert np.isfinite(ground_truth.world_T_body).all(axis=(1, 2)).tolist() == [True, False, True]


def test_the_lidars_forward_axis_points_left_in_the_body() -> None:
    # METHODS 7.1: the velodyne's +x maps to body (−0.012269, −0.999921, −0.002897).
    x, y, z, *angles = nclt.BODY_T_VELODYNE_XYZRPH
    body_T_velodyne = pose(np.array([[x, y, z]]), np.deg2rad([angles]))[0]
    np.testing.assert_allclose(body_T_velodyne[:3, 0], [-0.012269, -0.999921, -0.002897], atol=1e-6)
    np.testing.assert_allclose(body_T_velodyne[:3, 3], [0.002, -0.004, -0.957])


@pytest.mark.parametrize("lift_m", [0.0, 1.73])
def test_decoding_gives_the_bits_of_the_plain_formula(lift_m: float) -> None:
    # Every 16-bit word on every axis; bits, since artifacts' bytes follow from them: −0.0 is not
    # 0.0.
    words = np.repeat(np.arange(2**16, dtype=np.uint16), 4)
    plain = (words.reshape(-1, 4)[:, :3] * 0.005 - 100.0) * np.array([1.0, -1.0, -1.0]) + np.array(
        [0.0, 0.0, lift_m]
    )
    assert nclt.decode(words, lift_m).tobytes() == plain.tobytes()
