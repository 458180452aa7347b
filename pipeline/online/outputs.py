"""Writes fixes in the formats of `yearloc localize`: text, JSON, CSV, TUM, or an MCAP bag.

`writer` opens an output in one of these formats. `record` and `person` give a single fix as a JSON
object and as a line of text, for the server and other commands too.
"""

import csv
import json
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.errors import ConfigError
from pipeline.core.frames import yaw
from pipeline.core.replacing import replace
from pipeline.formats.bag import BagWriter
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix

POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""Position in metres and quaternion."""
COLUMNS = (
    "stamp",
    "name",
    "verdict",
    "place",
    *POSE,
    "novelty",
    "place_novelty",
    "overlap",
    "target_precision",
    "accepted_at",
    "ms",
)
"""The columns of a CSV file; the stamp is in seconds."""
FRAME = "map"
"""The frame of the poses in a bag: the world."""
Write = Callable[[Scan, Fix], None]
"""Writes the fix of one scan."""


def record(scan: Scan, fix: Fix) -> dict[str, Any]:
    """A fix as a JSON object: COLUMNS, covariance in the world, runners-up.

    Unknown values are None.
    """
    row = dict(zip(COLUMNS, _row(scan, fix), strict=True))
    row["stamp"] = None if scan.stamp_ns is None else scan.stamp_ns / 1e9
    has_covariance = np.isfinite(fix.covariance).all() and np.isfinite(fix.world_T_sensor).all()
    runners_up = [
        {
            "place": runner_up.place,
            "overlap": round(runner_up.overlap, 4),
            "probability": round(runner_up.probability, 6),
            **_pose(runner_up.world_T_sensor),
        }
        for runner_up in fix.runners_up
    ]
    return row | {
        "covariance": in_world(fix).tolist() if has_covariance else None,
        "runners_up": runners_up,
    }


def _row(scan: Scan, fix: Fix) -> list[Any]:
    """A fix as the values of COLUMNS; the stamp is a text with nine decimals."""
    stamp = None
    if scan.stamp_ns is not None:
        stamp = f"{scan.stamp_ns // 10**9}.{scan.stamp_ns % 10**9:09d}"
    numbers = (
        round(fix.novelty, 6),
        round(fix.place_novelty, 6),
        round(fix.overlap, 4),
        fix.target_precision,
        fix.accepted_at,
        round(fix.ms, 1),
    )
    return [stamp, scan.name, fix.verdict, fix.place, *_pose(fix.world_T_sensor).values(), *numbers]


def _pose(world_T_sensor: NDArray[np.float64]) -> dict[str, float | None]:
    """A pose (4, 4) as the values of POSE, each None if the pose is unknown."""
    if not np.isfinite(world_T_sensor).all():
        return dict.fromkeys(POSE)
    quaternion = Rotation.from_matrix(world_T_sensor[:3, :3]).as_quat(canonical=True)
    values = (*world_T_sensor[:3, 3], *quaternion)
    return {name: round(float(value), 6) for name, value in zip(POSE, values, strict=True)}


def stamp_of(scan: Scan, number: int) -> int:
    """The stamp of a scan in ns; without a stamp, its number in seconds."""
    return number * 10**9 if scan.stamp_ns is None else scan.stamp_ns


def in_world(fix: Fix) -> NDArray[np.float64]:
    """The covariance (6, 6) of a fix along the world's axes: x, y, z, then turns, as in ROS."""
    both_turned = np.kron(np.eye(2), fix.world_T_sensor[:3, :3])  # rotates the turns and the steps
    turns_first = both_turned @ fix.covariance @ both_turned.T
    steps_first = [3, 4, 5, 0, 1, 2]
    return np.asarray(turns_first[np.ix_(steps_first, steps_first)])


def person(scan: Scan, fix: Fix) -> str:
    """A fix as a line for people to read."""
    if fix.verdict == "no pose":
        return f"{scan.name:<24} no pose   too few points, or nothing fits   {fix.ms:6.1f} ms"
    x_m, y_m = fix.world_T_sensor[:2, 3]
    heading_deg = float(np.rad2deg(yaw(fix.world_T_sensor)))
    position = f"x {x_m:9.2f} m  y {y_m:9.2f} m  heading {heading_deg:6.1f}°  place {fix.place:>4}"
    return (
        f"{scan.name:<24} {fix.verdict:<9} {position}  overlap {fix.overlap:.2f}  novelty "
        f"{fix.novelty:.3f}  {fix.ms:6.1f} ms"
    )


@contextmanager
def writer(kind: str, path: Path | None) -> Iterator[Write]:
    """Writes fixes as `kind` (text, json, csv, tum or mcap) to a path or to standard output.

    tum and mcap get only the accepted fixes, since their readers know no verdict. A scan without a
    stamp has its number there, in seconds. Raises ConfigError for mcap without a path.
    """
    if kind == "mcap":
        if path is None:
            raise ConfigError("--mcap: expected -o FILE.mcap, a bag is no text")
        if path.suffix != ".mcap":
            raise ConfigError(f"-o {path}: expected FILE.mcap")
        numbers = count(1)
        with whole_bag(path) as bag:
            yield lambda scan, fix: write_fix(bag, stamp_of(scan, next(numbers)), fix)
        return
    write_text: Write | None = None
    with ExitStack() as stack:

        def write(scan: Scan, fix: Fix) -> None:
            nonlocal write_text
            # the file is opened at the first fix: a refused command leaves an older file as it is
            if write_text is None:
                stream: TextIO = sys.stdout
                if path is not None:
                    file = path.open("w", newline="", encoding="utf-8")
                    stream = stack.enter_context(file)
                write_text = _text(kind, stream)
            write_text(scan, fix)

        yield write


def _text(kind: str, stream: TextIO) -> Write:
    """Writes fixes to a stream as `kind`, which is not mcap."""
    rows = csv.writer(stream)
    number = -1
    if kind == "csv":
        rows.writerow(COLUMNS)

    def write(scan: Scan, fix: Fix) -> None:
        nonlocal number
        number += 1
        if kind == "json":
            stream.write(json.dumps(record(scan, fix), allow_nan=False) + "\n")
        elif kind == "csv":
            rows.writerow(["" if value is None else value for value in _row(scan, fix)])
        elif kind == "text":
            stream.write(person(scan, fix) + "\n")
        elif fix.verdict == "accepted":
            stamp, *_ = _row(scan, fix)
            pose = _pose(fix.world_T_sensor).values()
            stream.write(" ".join(map(str, (stamp or number, *pose))) + "\n")
        stream.flush()

    return write


@contextmanager
def whole_bag(path: Path) -> Iterator[BagWriter]:
    """Writes FILE.mcap, whole or not at all."""
    with TemporaryDirectory() as scratch:
        folder = Path(scratch, "recording")
        with BagWriter(folder, "mcap") as bag:
            yield bag
        (recording_file,) = folder.glob("*.mcap")
        with replace(path) as whole:
            shutil.move(recording_file, whole)


def write_fix(bag: BagWriter, stamp_ns: int, fix: Fix) -> None:
    """Writes a fix as PoseWithCovarianceStamped on /fix in the frame FRAME, if it is accepted."""
    if fix.verdict == "accepted":
        bag.pose_with_covariance(stamp_ns, FRAME, fix.world_T_sensor, in_world(fix), "/fix")
