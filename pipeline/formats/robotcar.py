"""Encodes and decodes the files of Oxford RobotCar (METHODS 7.2).

The reader uses it, and the simulated world that writes its logs as RobotCar does. Frames are those
of the files: the vehicle is x forward, y right, z down with the stereo camera as its origin; the
world is north-east-down (UTM northing, easting, down); a laser scans in its plane z = 0. Angles are
in radians, utimes in microseconds.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.formats.kitti import write_lines

RECORD_BYTES = 24
"""Bytes of a point of a sweep: x, y, reflectance as 64-bit floats."""
LASERS = ("lms_front", "lms_rear")
"""The 2-D lasers; the sweeps of a laser lie in a folder of its name."""
STAMPS = "{laser}.timestamps"
VO = "vo/vo.csv"
INS = "gps/ins.csv"
"""The other files of a sequence, below its folder."""
EXTRINSICS = {
    "lms_front": (1.7589, 0.2268, 1.0411, -0.0437, -1.4572, 0.0356),
    "lms_rear": (-2.5850, 0.2852, 1.0885, -2.8405, -1.5090, -0.3614),
    "ldmrs": (1.5349, 0.0090, 1.3777, 0.0205, 0.0767, -0.0299),
    "ins": (-1.7132, 0.1181, 1.1948, -0.0125, 0.0400, 0.0050),
    "stereo": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
}
"""x, y, z, roll, pitch, yaw of each sensor in the vehicle frame, from the data set's SDK."""
POSE = ("x", "y", "z", "roll", "pitch", "yaw")
VO_STAMPS = ("source_timestamp", "destination_timestamp")
VO_COLUMNS = (*VO_STAMPS, *POSE)
"""The columns of VO: the stamps of a motion's end and start, and the motion."""
INS_POSE = ("northing", "easting", "down", "roll", "pitch", "yaw")
INS_COLUMNS = (
    "timestamp",
    "ins_status",
    "latitude",
    "longitude",
    "altitude",
    "northing",
    "easting",
    "down",
    "utm_zone",
    "velocity_north",
    "velocity_east",
    "velocity_down",
    "roll",
    "pitch",
    "yaw",
)
INS_GOOD = "INS_SOLUTION_GOOD"
"""The status of a pose that can be relied on."""


def encode_sweep(
    xy_m: NDArray[np.float64], reflectance: NDArray[np.floating | np.integer]
) -> bytes:
    """A sweep file's bytes: `xy_m` (n, 2) in the laser's scan plane and `reflectance` (n,)."""
    return np.column_stack([xy_m, reflectance]).astype("<f8").tobytes()


def decode_sweep(data: bytes) -> NDArray[np.float64]:
    """Rows (n, 3) of x, y in metres in the laser's scan plane, and reflectance."""
    return np.frombuffer(data, "<f8").reshape(-1, 3).astype(np.float64, copy=False)


def write_timestamps(path: Path, utimes: NDArray[np.int64]) -> None:
    """Write one line per sweep: its utime, and the number of its download chunk, here always 1."""
    write_lines(path, [f"{utime} 1" for utime in utimes.tolist()])


def write_vo(path: Path, utimes: NDArray[np.int64], xyzrpy: NDArray[np.float64]) -> None:
    """Write visual odometry at `utimes` (n,).

    `xyzrpy` (n−1, 6) is each pose in the vehicle frame of the previous one.
    """
    stamps = zip(utimes[1:].tolist(), utimes[:-1].tolist(), strict=True)
    lines = [",".join(VO_COLUMNS)]
    for (utime, previous_utime), step in zip(stamps, xyzrpy.tolist(), strict=True):
        lines.append(f"{utime},{previous_utime},{_numbers(step)}")
    write_lines(path, lines)


def write_ins(
    path: Path,
    utimes: NDArray[np.int64],
    statuses: Sequence[str],
    ned_xyzrpy: NDArray[np.float64],
    utm_zone: str = "30U",
) -> None:
    """Write inertial navigation: poses `ned_xyzrpy` (n, 6) of the INS unit in the world.

    `utimes` and `statuses` are (n,). Latitude, longitude and velocities are written as nan, the
    altitude as −down.
    """
    lines = [",".join(INS_COLUMNS)]
    for utime, status, (north, east, down, *angles) in zip(
        utimes.tolist(), statuses, ned_xyzrpy.tolist(), strict=True
    ):
        position = _numbers([-down, north, east, down])
        lines.append(
            f"{utime},{status},nan,nan,{position},{utm_zone},nan,nan,nan,{_numbers(angles)}"
        )
    write_lines(path, lines)


def write_extrinsics(folder: Path) -> None:
    """Write the published extrinsics, one file per sensor."""
    for sensor, numbers in EXTRINSICS.items():
        write_lines(folder / f"{sensor}.txt", [" ".join(f"{number:.4f}" for number in numbers)])


def _numbers(values: Sequence[float]) -> str:
    """Numbers as text, with commas between them."""
    return ",".join(f"{value:.12g}" for value in values)
