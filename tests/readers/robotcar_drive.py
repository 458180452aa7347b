"""Writes a small RobotCar drive by hand, with the bytes and the text of the data set's files."""

import struct
from collections.abc import Mapping
from pathlib import Path

DATE = "2014-07-14-14-49-50"
START = 1_405_349_390_000_000  # µs: 2014-07-14 14:49:50 UTC
VO_HEADER = "source_timestamp,destination_timestamp,x,y,z,roll,pitch,yaw\n"
INS_HEADER = (
    "timestamp,ins_status,latitude,longitude,altitude,northing,easting,down,utm_zone,"
    "velocity_north,velocity_east,velocity_down,roll,pitch,yaw\n"
)
ZERO = "0 0 0 0 0 0\n"
FRONT = "1.7589 0.2268 1.0411 -0.0437 -1.4572 0.0356\n"
REAR = "-2.5850 0.2852 1.0885 -2.8405 -1.5090 -0.3614\n"
INS = "-1.7132 0.1181 1.1948 -0.0125 0.0400 0.0050\n"


def sweep(*returns: tuple[float, float, float]) -> bytes:
    """A sweep file of beams with x, y, reflectance."""
    return b"".join(struct.pack("<3d", *beam) for beam in returns)


def utime(ms: float) -> int:
    """The utime so many milliseconds after START."""
    return START + round(1000 * ms)


def six(numbers: tuple[float, ...]) -> list[str]:
    """The words of six numbers, of which the last may be left out: they are 0."""
    return [repr(number) for number in (*numbers, *[0.0] * (6 - len(numbers)))]


def vo_row(source_ms: float, before_ms: float, *step: float) -> str:
    """A row of vo.csv: the motion from one moment to a later one, in milliseconds after START.

    `step` is x, y, z, roll, pitch, yaw; what is left out is 0.
    """
    return f"{utime(source_ms)},{utime(before_ms)},{','.join(six(step))}\n"


def ins_row(ms: float, *place: float, status: str = "INS_SOLUTION_GOOD", zone: str = "30U") -> str:
    """A row of ins.csv: the pose of the INS unit, in milliseconds after START.

    `place` is northing, easting, down, roll, pitch, yaw; what is left out is 0.
    """
    numbers = six(place)
    position = ",".join(numbers[:3])
    angles = ",".join(numbers[3:])
    return f"{utime(ms)},{status},51.7,-1.2,110.0,{position},{zone},9,0,0,{angles}\n"


def vo_text(*rows: str) -> str:
    """The text of vo.csv."""
    return VO_HEADER + "".join(rows)


def ins_text(*rows: str) -> str:
    """The text of ins.csv."""
    return INS_HEADER + "".join(rows)


DRIVEN = vo_text(*(vo_row(100 * i + 100, 100 * i, 1.0) for i in range(10)))
"""The visual odometry of 10 m/s forward for one second."""
SEEN = ins_text(*(ins_row(20 * i, 0.2 * i) for i in range(51)))
"""The inertial navigation of the same drive, northwards."""


def drive(
    root: Path,
    sweeps: Mapping[float, bytes] | None = None,
    rear: Mapping[float, bytes] | None = None,
    vo: str | bytes | None = DRIVEN,
    ins: str | bytes | None = SEEN,
    stamps: str | None = "",
    extrinsics: Mapping[str, str] | None = None,
) -> Path:
    """Write a root with one sequence, and return it.

    `sweeps` are those of the front laser and `rear` of the rear one, by milliseconds after START;
    by default the front laser has one return 1 m ahead every 100 ms, the rear laser no folder.
    `stamps` is the text of lms_front.timestamps: None for no such file, "" for a line per sweep.
    The INS unit sits in the origin of the vehicle unless `extrinsics` says otherwise.
    """
    front = {50 + 100 * i: sweep((1, 0, 7)) for i in range(10)} if sweeps is None else sweeps
    for laser, files in (("lms_front", front), ("lms_rear", rear)):
        if files is None:
            continue
        (root / DATE / laser).mkdir(parents=True)
        for ms, data in files.items():
            (root / DATE / laser / f"{utime(ms)}.bin").write_bytes(data)
        text = "".join(f"{utime(ms)} 1\n" for ms in sorted(files))
        if laser == "lms_front" and stamps:
            text = stamps
        if stamps is not None or laser == "lms_rear":
            (root / DATE / f"{laser}.timestamps").write_text(text)
    (root / "extrinsics").mkdir()
    texts = {"lms_front": FRONT, "lms_rear": REAR, "ins": ZERO} | dict(extrinsics or {})
    for sensor, text in texts.items():
        (root / "extrinsics" / f"{sensor}.txt").write_text(text)
    for name, table in (("vo/vo.csv", vo), ("gps/ins.csv", ins)):
        if table is not None:
            (root / DATE / name).parent.mkdir()
            (root / DATE / name).write_bytes(table.encode() if isinstance(table, str) else table)
    return root
