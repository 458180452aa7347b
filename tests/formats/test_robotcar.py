"""Tests how RobotCar's sweeps and tables are encoded, and that the reader reads what is written."""

import struct
from pathlib import Path

import numpy as np
import pytest

from pipeline.core.frames import flip_ned, pose, rpy
from pipeline.formats import robotcar
from pipeline.readers.robotcar import RobotCar

SEQUENCE = "2014-07-14-14-49-50"
START = 1_405_349_390_000_000


def xyzrpy(poses: np.ndarray) -> np.ndarray:
    """x, y, z, roll, pitch, yaw (n, 6) of poses."""
    return np.column_stack([poses[:, :3, 3], rpy(poses)])


def test_a_return_is_three_little_endian_doubles() -> None:
    data = robotcar.encode_sweep(np.array([[1.5, -2.0], [0, 0]]), np.array([40, 0]))
    assert data == struct.pack("<6d", 1.5, -2.0, 40, 0, 0, 0)
    np.testing.assert_array_equal(robotcar.decode_sweep(data), [[1.5, -2, 40], [0, 0, 0]])
    assert robotcar.decode_sweep(b"").shape == (0, 3)


def test_tables_are_written_as_in_the_data_set(tmp_path: Path) -> None:
    # METHODS 7.2's headers; a row's source is the later of its two stamps.
    utimes = np.array([START, START + 62_500])
    robotcar.write_vo(tmp_path / "vo" / "vo.csv", utimes, np.array([[0.5, 0, 0, 0, 0, 1e-7]]))
    assert (tmp_path / "vo" / "vo.csv").read_text().splitlines() == [
        "source_timestamp,destination_timestamp,x,y,z,roll,pitch,yaw",
        "1405349390062500,1405349390000000,0.5,0,0,0,0,1e-07",
    ]
    north = np.array([[5_735_000.123456, 620_000.5, -110, 0, 0, 0.25]])
    robotcar.write_ins(tmp_path / "ins.csv", utimes[:1], ["INS_SOLUTION_GOOD"], north)
    assert (tmp_path / "ins.csv").read_text().splitlines() == [
        "timestamp,ins_status,latitude,longitude,altitude,northing,easting,down,utm_zone,"
        "velocity_north,velocity_east,velocity_down,roll,pitch,yaw",
        "1405349390000000,INS_SOLUTION_GOOD,nan,nan,110,5735000.12346,620000.5,-110,30U,nan,nan,nan,0,0,0.25",
    ]
    robotcar.write_timestamps(tmp_path / "lms_front.timestamps", utimes)
    assert (
        tmp_path / "lms_front.timestamps"
    ).read_text() == "1405349390000000 1\n1405349390062500 1\n"


def test_the_extrinsics_are_those_of_the_sdk(tmp_path: Path, real: Path) -> None:
    robotcar.write_extrinsics(tmp_path)
    for sensor in robotcar.EXTRINSICS:
        published = np.loadtxt(real / "robotcar" / "extrinsics" / f"{sensor}.txt")
        np.testing.assert_array_equal(np.loadtxt(tmp_path / f"{sensor}.txt"), published)


@pytest.mark.parametrize("lasers", [("lms_front",), ("lms_rear",), ("lms_front", "lms_rear")])
def test_a_drive_that_is_written_is_read_back(tmp_path: Path, lasers: tuple[str, ...]) -> None:
    # A winding climb, known z up; the files hold the INS unit's z-down poses, and motion between
    # images.
    rng = np.random.default_rng(4)
    s = np.arange(20.0)
    xyz = np.column_stack([5.7e6 + 3 * s, -6.2e5 + np.sin(s), 110 + 0.1 * s])
    world_T_vehicle = pose(xyz, np.column_stack([0.02 * np.sin(s), 0.03 * np.cos(s), 0.02 * s]))
    utimes = START + 100_000 * np.arange(20)
    ned = flip_ned(world_T_vehicle)
    numbers = np.array([robotcar.EXTRINSICS["ins"]])
    robotcar.write_extrinsics(tmp_path / "extrinsics")
    robotcar.write_vo(
        tmp_path / SEQUENCE / robotcar.VO, utimes, xyzrpy(np.linalg.inv(ned[:-1]) @ ned[1:])
    )
    statuses = [robotcar.INS_GOOD] * 20
    robotcar.write_ins(
        tmp_path / SEQUENCE / robotcar.INS,
        utimes,
        statuses,
        xyzrpy(ned @ pose(*np.hsplit(numbers, 2))),
    )
    returns = {laser: rng.uniform(-40, 40, (20, 9, 2)) for laser in lasers}
    for laser in lasers:
        robotcar.write_timestamps(tmp_path / SEQUENCE / robotcar.STAMPS.format(laser=laser), utimes)
        (tmp_path / SEQUENCE / laser).mkdir()
        for utime, xy in zip(utimes, returns[laser], strict=True):
            data = robotcar.encode_sweep(xy, np.zeros(9))
            (tmp_path / SEQUENCE / laser / f"{utime}.bin").write_bytes(data)

    log = RobotCar(lasers).open(tmp_path, SEQUENCE)
    assert log.stamps_ns.tolist() == [1000 * utime for utime in utimes]
    assert (log.notes, log.skipped) == ((), {})
    # the file has 12 digits: 10 µm of a northing
    np.testing.assert_allclose(log.world_T_scan, world_T_vehicle, atol=1e-4)
    np.testing.assert_allclose(
        log.odom_T_scan, np.linalg.inv(world_T_vehicle[0]) @ world_T_vehicle, atol=1e-6
    )
    for row in (0, 7, 19):
        points = np.split(log.points(row), len(lasers))
        for laser, cloud in zip(lasers, points, strict=True):
            zup_T_laser = flip_ned(pose(*np.hsplit(np.array([robotcar.EXTRINSICS[laser]]), 2)))[0]
            in_plane = (np.linalg.inv(zup_T_laser) @ np.column_stack([cloud, np.ones(9)]).T).T
            np.testing.assert_allclose(in_plane[:, :2] * (1, -1), returns[laser][row], atol=1e-9)
            np.testing.assert_allclose(in_plane[:, 2], 0, atol=1e-9)
