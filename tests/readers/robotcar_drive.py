"""A small RobotCar drive, made by hand: packed bytes and text as the data set's own files hold
them."""

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
    """A sweep file: x, y, reflectance of each beam."""
    return b"".join(struct.pack("<3d", *beam) for beam in returns)


def vo_row(source_ms: float, before_ms: float, *step: float) -> str:
    """Motion from one moment to the next, in milliseconds after START: x, y, z, roll, pitch, yaw;
    the rest is 0."""
    numbers = [*step, *[0.0] * (6 - len(step))]
    return f"{START + round(1000 * source_ms)},{START + round(1000 * before_ms)},{','.join(map(repr, numbers))}\n"


def ins_row(ms: float, *place: float, status: str = "INS_SOLUTION_GOOD", zone: str = "30U") -> str:
    """The INS unit's northing, easting, down, roll, pitch, yaw at a moment; the rest is 0."""
    numbers = [*map(repr, [*place, *[0.0] * (6 - len(place))])]
    return f"{START + round(1000 * ms)},{status},51.7,-1.2,110.0,{','.join(numbers[:3])},{zone},9,0,0,{','.join(numbers[3:])}\n"


def vo_text(*rows: str) -> str:
    return VO_HEADER + "".join(rows)


def ins_text(*rows: str) -> str:
    return INS_HEADER + "".join(rows)


DRIVEN = vo_text(*(vo_row(100 * i + 100, 100 * i, 1.0) for i in range(10)))
"""10 m/s forward for one second."""
SEEN = ins_text(*(ins_row(20 * i, 0.2 * i) for i in range(51)))
"""The same, northwards."""


def drive(
    root: Path,
    sweeps: Mapping[float, bytes] | None = None,
    rear: Mapping[float, bytes] | None = None,
    vo: str | bytes | None = DRIVEN,
    ins: str | bytes | None = SEEN,
    stamps: str | None = "",
    extrinsics: Mapping[str, str] | None = None,
) -> Path:
    """A root with one sequence.

    Sweeps are given by milliseconds after START (one return 1 m ahead every 100 ms if not given).

    `stamps` is the text of lms_front.timestamps: None for no such file, "" for a line a sweep. The
    INS unit sits in the vehicle's origin unless `extrinsics` says otherwise.
    """
    front = {50 + 100 * i: sweep((1, 0, 7)) for i in range(10)} if sweeps is None else sweeps
    for laser, files in (("lms_front", front), ("lms_rear", rear)):
        if files is None:
            continue
        (root / DATE / laser).mkdir(parents=True)
        for ms, data in files.items():
            (root / DATE / laser / f"{START + round(1000 * ms)}.bin").write_bytes(data)
        lines = "".join(f"{START + round(1000 * ms)} 1\n" for ms in sorted(files))
        text = stamps or lines if laser == "lms_front" else lines
        if stamps is not None or laser == "lms_rear":
            (root / DATE / f"{laser}.timestamps").write_text(text)
    (root / "extrinsics").mkdir()
    for sensor, text in (
        {"lms_front": FRONT, "lms_rear": REAR, "ins": ZERO} | dict(extrinsics or {})
    ).items():
        (root / "extrinsics" / f"{sensor}.txt").write_text(text)
    for name, table in (("vo/vo.csv", vo), ("gps/ins.csv", ins)):
        if table is not None:
            (root / DATE / name).parent.mkdir()
            (root / DATE / name).write_bytes(table.encode() if isinstance(table, str) else table)
    return root
