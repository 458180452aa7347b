"""Describes the files of Oxford RobotCar for `yearloc inspect`: a path in; rows and warnings out.

There are functions for a sweep, the folder of one laser, a sequence as its reader opens it, and the
csv tables of visual odometry and inertial navigation (INS).
"""

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import step_lengths_m
from pipeline.formats import robotcar
from pipeline.inspection import folders
from pipeline.inspection.cloud import spread
from pipeline.inspection.files import moment_of
from pipeline.inspection.inspection import Inspection, box, duration, metres, nbytes, stamp_rows
from pipeline.inspection.tracks import warn_of_gaps
from pipeline.mapping.appearance import measure_coverage_deg
from pipeline.opening.opening import Opening
from pipeline.readers import log
from pipeline.readers.columns import read_columns, to_numbers
from pipeline.readers.robotcar import RobotCar, read_sweep, sweep_utimes
from pipeline.readers.robotcar_poses import read_ins, read_vo

BEAMS = 541
"""Number of beams in a whole sweep: 270° in steps of half a degree."""
REACH_M = 50.0
"""An LMS-151 sees no farther."""
PLANE = np.eye(4)
"""Extrinsics that leave a sweep in its scan plane."""


def describe_sweep(path: Path, inspection: Inspection) -> None:
    """Describe a sweep, lms_front/UTIME.bin or lms_rear/UTIME.bin.

    It holds x, y and reflectance in the laser's scan plane.
    """
    data = log.read_bytes(path, robotcar.RECORD_BYTES, "returns")
    if not data:
        raise LogError(f"{path}: empty; expected the returns of one sweep: fetch the file again")
    rows = robotcar.decode_sweep(data)
    points = read_sweep(path, PLANE)
    range_m = np.hypot(points[:, 0], points[:, 1])
    range_text = "none"
    if len(points):
        nearest, farthest, median = map(metres, np.quantile(range_m, (0, 1, 0.5)))
        range_text = f"{nearest} … {farthest}, median {median}"
    reflectances = rows[np.isfinite(rows[:, 2]), 2]
    reflectance_text = "none"
    if len(reflectances):
        reflectance_text = f"{reflectances.min():g} … {reflectances.max():g}"
    far_count = int((range_m > REACH_M).sum())
    inspection.kind = f"RobotCar sweep of {path.parent.name}"
    inspection.add(
        "",
        ("size", f"{nbytes(len(data))}, records of {robotcar.RECORD_BYTES} bytes"),
        ("taken", moment_of(path)),
        ("returns", f"{len(points):,} of {len(rows):,} beams in the file"),
        ("range", range_text),
        ("azimuth", f"{measure_coverage_deg(points):.0f}° of 360° covered"),
        ("reflectance", reflectance_text),
        (
            "frame",
            "the laser's scan plane, z = 0; the reader places it in the vehicle by the "
            "extrinsics, z up",
        ),
    )
    inspection.warn_if(not len(points), "no beam has a return: was the laser covered?")
    inspection.warn_if(
        len(rows) > BEAMS,
        f"{len(rows):,} beams: an LMS-151 has {BEAMS}; is this file another laser's?",
    )
    inspection.warn_if(
        far_count, f"{far_count} returns beyond {metres(REACH_M)}, farther than an LMS-151 sees"
    )


def describe_sweeps(path: Path, inspection: Inspection) -> None:
    """Describe lms_front/ or lms_rear/: the sweeps of one laser that its reader takes.

    Raises LogError if there is none.
    """
    skipped = Counter[str]()
    notes: list[str] = []
    utimes = sweep_utimes(path.parent, path.name, skipped, notes)
    folders.warn_of_skipped(inspection, skipped, "sweeps")
    inspection.warnings += tuple(notes)
    files = [path / f"{utime}.bin" for utime in utimes]
    inspection.kind = "RobotCar sweeps of one laser"
    inspection.add(
        "",
        *folders.file_rows(files, robotcar.RECORD_BYTES, "sweeps", "beams a sweep"),
        *folders.rate_rows(inspection, utimes * 1e-6),
    )
    _add_table(
        inspection,
        len(files),
        lambda row: read_sweep(files[row], PLANE),
        "in the laser's scan plane",
    )


def describe_sequence(opening: Opening, inspection: Inspection) -> None:
    """Describe the folder of a sequence, opened by its reader.

    If the reader refuses it, the error becomes a warning, and each laser's folder is described.
    """
    path = inspection.path.resolve()
    lasers = [laser for laser in robotcar.LASERS if (path / laser).is_dir()]
    title = f"as its reader opens it, with {' and '.join(lasers)}"
    opened_log = folders.describe_opened(inspection, opening, title, "sweeps")
    if opened_log is not None:
        frame = "vehicle frame: x forward, y left, z up from the camera"
        _add_table(inspection, len(opened_log.stamps_ns), opened_log.points, frame)
        return
    for laser in lasers:
        laser_inspection = Inspection(path / laser)
        describe_sweeps(path / laser, laser_inspection)
        inspection.add(laser, *laser_inspection.sections[0].rows)
        inspection.warnings += laser_inspection.warnings


def describe_vo(path: Path, inspection: Inspection) -> None:
    """Describe vo/vo.csv: the vehicle's motion from image to image, chained by the reader."""
    max_gap_s = RobotCar().max_vo_gap_s
    odometry = read_vo(path, max_gap_s)
    stamps_s = odometry.trajectory.stamps_ns * 1e-9
    poses = odometry.trajectory.world_T_body
    has_pose: NDArray[np.bool_] = np.all(np.isfinite(poses), axis=(1, 2))
    steps_m = step_lengths_m(poses[:, :3, 3])
    steps_m = steps_m[np.isfinite(steps_m)]
    path_text = metres(float(steps_m.sum()))
    longest_text = metres(float(steps_m.max(initial=0.0)))
    steps_s = np.diff(stamps_s)[has_pose[1:] & has_pose[:-1]]
    break_count = len(odometry.breaks_ns)
    inspection.kind = "RobotCar visual odometry"
    inspection.add(
        "",
        ("knots", f"{int(has_pose.sum()):,}, in {break_count + 1} chains"),
        *stamp_rows(stamps_s[has_pose]),
        ("path", f"{path_text}, longest step {longest_text}"),
        (
            "frame",
            "the vehicle (stereo camera): x forward, y right, z down, radians; the reader turns "
            "it z up",
        ),
    )
    inspection.warn_if(
        break_count,
        f"breaks: {break_count} rows start elsewhere than where the row before them ended; no "
        "accumulated submap reaches across one",
    )
    warn_of_gaps(
        inspection,
        steps_s,
        max_gap_s,
        "steps",
        "sweeps there have no odometry; sparser odometry needs max_vo_gap_s in the dataset's yaml",
    )


def describe_ins(path: Path, inspection: Inspection) -> None:
    """Describe gps/ins.csv: the poses of the INS unit.

    The reader takes only those with the status INS_SOLUTION_GOOD.
    """
    max_gap_s = RobotCar().max_ins_gap_s
    track = read_ins(path, np.eye(4), max_gap_s)
    table = read_columns(path, ("ins_status", "utm_zone", *robotcar.INS_POSE))
    statuses = Counter(table["ins_status"]).most_common(5)
    zones = sorted(set(table["utm_zone"]))
    is_good: NDArray[np.bool_] = np.all(np.isfinite(track.world_T_body), axis=(1, 2))
    stamps_s = track.stamps_ns * 1e-9
    xyz_m = to_numbers(path, table, robotcar.INS_POSE)[is_good, :3]
    steps_m = step_lengths_m(xyz_m)
    steps_s = np.diff(stamps_s[is_good])
    is_outage = steps_s > max_gap_s
    inspection.kind = "RobotCar inertial navigation"
    inspection.add(
        "",
        (
            "rows",
            f"{len(is_good):,}, of which {100 * is_good.mean():.1f} % are {robotcar.INS_GOOD}",
        ),
        (
            "statuses",
            ", ".join(f"{status[:40]} {count:,}" for status, count in statuses),
        ),
        *stamp_rows(stamps_s),
        ("path", metres(float(steps_m[~is_outage].sum()))),
        ("box", box(xyz_m, ("northing", "easting", "down"))),
        ("UTM zone", ", ".join(zones)[:60]),
        (
            "frame",
            "the INS unit in north-east-down, radians; the reader converts it to the z-up "
            "vehicle by the extrinsics",
        ),
    )
    inspection.warn_if(
        not is_good.any(), f"no row is {robotcar.INS_GOOD}: no sweep has a true pose"
    )
    inspection.warn_if(
        is_outage.any(),
        f"outages: {int(is_outage.sum())} over {max_gap_s} s without a good row, the longest "
        f"{duration(float(steps_s.max(initial=0)))}: sweeps there have no place, but go into the "
        "submaps around",
    )


def _add_table(
    inspection: Inspection, count: int, points: Callable[[int], NDArray[np.floating]], frame: str
) -> None:
    """Add a table of a few of `count` sweeps; `points` returns one (n, 3), in this `frame`."""
    table: list[tuple[str, ...]] = [("sweep", "returns", "x", "y", "z")]
    for row in spread(count):
        cloud = points(row)
        extents: list[str] = []
        if len(cloud):
            extents = [box(cloud[:, [axis]], [""]).strip() for axis in range(3)]
        table.append((str(row), f"{len(cloud):,}", *extents))
    inspection.add(f"sweeps, {frame}", *table)
