"""Describes folders of raw files for `yearloc inspect`: a folder in; rows of text and warnings out.

A folder may hold the scans of one log, be a sequence, or be the root of a data set. A sequence is
opened by the reader of its data set, and its log described; a CARMEN log, one file, is too.
"""

from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import step_lengths_m
from pipeline.formats import bin_layout, folder, kitti, nclt
from pipeline.inspection.cloud import describe_clouds, spread
from pipeline.inspection.drives import VEHICLE
from pipeline.inspection.files import FORMATS, format_of
from pipeline.inspection.inspection import Inspection, duration, metres, nbytes, stamp_rows
from pipeline.opening.opening import KEY_FRAMES, OTHER_ROBOT, Opening
from pipeline.readers import log
from pipeline.readers.carmen import Carmen
from pipeline.readers.folder import Folder
from pipeline.readers.keyframes import KeyFrames
from pipeline.readers.kitti import Kitti, read_velodyne, scan_numbers
from pipeline.readers.log import Log, Reader
from pipeline.readers.nclt import Nclt, nclt_utimes, read_velodyne_sync
from pipeline.readers.robotcar import RobotCar

FRAMES = {KEY_FRAMES: "as stored; conf/dataset/nclt_keyframes.yaml turns and raises them"}
"""The frame of the points of a data set, where it is not that of the vehicle."""
MAX_NAMES = 20
"""Names of files in a folder that are listed."""
FAR_M = 50.0
"""If the robot is nearer than this to the origin of its world, a cloud around the robot cannot be
distinguished from one around the origin."""


def describe_scan_folder(path: Path, as_format: str | None, inspection: Inspection) -> None:
    """Describe a folder with the scans of one log, such as velodyne_sync/ or velodyne/.

    Raises LogError if none of them is whole.
    """
    format_name = format_of(path, as_format)
    if format_name == "nclt":
        _describe_nclt_scans(path, inspection)
    elif format_name == "kitti":
        _describe_kitti_scans(path, inspection)
    else:
        _describe_own_scans(path, inspection)


def _describe_nclt_scans(path: Path, inspection: Inspection) -> None:
    """Describe velodyne_sync/, whose scans are named by their utimes."""
    skipped = Counter[str]()
    utimes = nclt_utimes(path, skipped)
    warn_of_skipped(inspection, skipped, "scans")
    files = [path / f"{utime}.bin" for utime in utimes]
    rows = file_rows(files, nclt.RECORD_BYTES)
    inspection.kind = "NCLT scans of one log"
    inspection.add("", *rows, *rate_rows(inspection, utimes * 1e-6))
    describe_clouds(
        inspection, len(files), lambda row: read_velodyne_sync(files[row]), "body frame, z up"
    )


def _describe_kitti_scans(path: Path, inspection: Inspection) -> None:
    """Describe velodyne/, whose scans are numbered; times.txt beside it has their times."""
    skipped = Counter[str]()
    numbers = scan_numbers(path, skipped)
    warn_of_skipped(inspection, skipped, "scans")
    files = [path / f"{number:06d}.bin" for number in numbers]
    rows = file_rows(files, kitti.RECORD_BYTES)
    missing_count = int(numbers[-1] - numbers[0] + 1 - len(numbers))
    inspection.warn_if(
        missing_count,
        f"{missing_count} scans between the first and the last are not there: the path has holes; "
        "fetch them",
    )
    times_path = path.parent / "times.txt"
    if times_path.is_file():
        times_s = log.read_table(times_path, 1)[:, 0]
        rows += rate_rows(inspection, times_s[numbers[numbers < len(times_s)]])
    inspection.kind = "KITTI scans of one log"
    inspection.add("", *rows)
    height_m = Kitti().lidar_height_m
    describe_clouds(
        inspection,
        len(files),
        lambda row: read_velodyne(files[row], height_m),
        f"raised by lidar_height_m = {height_m} m, z up",
    )


def file_rows(
    files: list[Path], record_bytes: int, scans: str = "scans", points: str = "points a scan"
) -> list[tuple[str, str]]:
    """Rows on files of `scans` of so many `points`: how many, how large, the first and last."""
    sizes = np.array([file.stat().st_size for file in files])
    fewest, most, median = (np.quantile(sizes, (0, 1, 0.5)) // record_bytes).astype(int)
    return [
        (scans, f"{len(files):,}, {nbytes(int(sizes.sum()))}"),
        (points, f"{fewest:,} … {most:,}, median {median:,.0f}"),
        ("first, last", f"{files[0].name}, {files[-1].name}"),
    ]


def _describe_own_scans(path: Path, inspection: Inspection) -> None:
    """Describe a folder of another robot's scans; raises LogError if all are empty."""
    files = sorted(
        file for file in path.iterdir() if file.suffix in folder.SCANS and file.stat().st_size
    )
    if not files:
        raise LogError(f"{path}: all of its scans are empty; fetch them again")
    rows = [("scans", f"{len(files):,}, {nbytes(sum(file.stat().st_size for file in files))}")]
    bin_file = next((file for file in files if file.suffix == ".bin"), None)
    width = None
    if bin_file:
        data = bin_file.read_bytes()
        bin_layout.refuse_planar(data, bin_file)
        width = bin_layout.point_bytes(data)
        width_text = f"of {width or 'unknown'} bytes, found from the content of {bin_file.name}"
        rows.append(("records", width_text))
    reader = "the dataset folder, with poses beside them: see conf/dataset/folder.yaml"
    inspection.kind = "scans of another robot"
    inspection.add("", *rows, ("read by", reader))
    describe_clouds(
        inspection,
        len(files),
        lambda row: folder.points(files[row].read_bytes(), files[row], width),
        "as stored",
    )


def describe_sequence(opening: Opening, inspection: Inspection) -> None:
    """Describe a drive as its reader opens it.

    If the reader refuses it, the error becomes a warning, and only the scans are described.
    """
    path = inspection.path
    opened_log = describe_opened(inspection, opening, "as its reader opens it")
    scans = next((path / name for name in FORMATS if (path / name).is_dir()), None)
    if opened_log is not None:
        describe_clouds_of(inspection, opened_log, FRAMES.get(opening.data_set, VEHICLE))
    elif scans:
        scan_inspection = Inspection(scans)
        describe_scan_folder(scans, None, scan_inspection)
        inspection.sections += scan_inspection.sections
        inspection.warnings += scan_inspection.warnings


def describe_root(path: Path, folder_reader: Folder, inspection: Inspection) -> None:
    """Describe the root of a data set: its sequences, and the files that each lacks.

    The data set is the first whose reader finds a sequence there. Raises LogError if none does.
    """
    readers: dict[str, Reader] = {
        "KITTI": Kitti(),
        "NCLT": Nclt(),
        "RobotCar": RobotCar(),
        "CARMEN": Carmen(),
        KEY_FRAMES: KeyFrames(),
        OTHER_ROBOT: folder_reader,
    }
    for name, reader in readers.items():
        sequences = reader.sequences(path)
        if sequences:
            _add_sequences(inspection, name, sequences)
            return
    names = sorted(file.name for file in path.iterdir())
    hint = "it is empty"
    if names:
        hint = f"it holds {', '.join(names[:5])}{' …' if len(names) > 5 else ''}"
    raise LogError(
        f"{path}: no artifact, folder of scans, sequence or data set: {hint}; name a file in "
        "it, or a folder with velodyne_sync/, velodyne/, sequences/ or lms_front/"
    )


def _add_sequences(inspection: Inspection, name: str, sequences: dict[str, list[str]]) -> None:
    """Add the sequences of the data set `name`, each with the files that it lacks."""
    inspection.kind = f"{name} root, sequences: {len(sequences)}"
    rows = [
        (sequence, f"lacks {', '.join(missing)}" if missing else "can be read")
        for sequence, missing in sequences.items()
    ]
    inspection.add("sequences", *rows)
    incomplete_count = sum(bool(missing) for missing in sequences.values())
    inspection.warn_if(
        incomplete_count,
        f"{incomplete_count} of {len(sequences)} sequences cannot be read: fetch what they lack",
    )


def describe_opened(
    inspection: Inspection, opening: Opening, title: str, scans: str = "scans"
) -> Log | None:
    """Open the drive at the path of the inspection, describe its files and its log, return it.

    The content of the log stands under `title`; its rows are called `scans`. Warns of what is
    missing. If the reader refuses the drive, its error becomes the only warning, and the result is
    None.
    """
    inspection.path = path = inspection.path.resolve()
    names = sorted(file.name + ("/" if file.is_dir() else "") for file in path.iterdir())
    names_text = ", ".join(names[:MAX_NAMES])
    if len(names) > MAX_NAMES:
        names_text += f", and {len(names) - MAX_NAMES:,} more"
    inspection.kind = f"{opening.data_set} sequence {path.name}"
    inspection.add("", ("holds", names_text), ("root", str(opening.root)))
    try:
        log = opening.open()
    except LogError as error:
        inspection.warn(f"the reader refuses the sequence: {error}")
        return None
    describe_log(inspection, log, title, scans)
    return log


def describe_carmen_log(opening: Opening, inspection: Inspection) -> None:
    """Describe a CARMEN log, one file; raises LogError if its reader refuses it."""
    inspection.kind = "CARMEN log"
    inspection.add("", ("size", nbytes(inspection.path.stat().st_size)))
    describe_log(inspection, opening.open(), "as its reader opens it", "sweeps")


def warn_of_skipped(inspection: Inspection, skipped: Counter[str], scans: str) -> None:
    """Warn of the `scans` that a reader skips, by reason."""
    for reason, count in sorted((+skipped).items()):
        inspection.warn(f"{count:,} {scans} are skipped: {reason}")


def describe_log(inspection: Inspection, log: Log, title: str, scans: str) -> None:
    """Add the content of a log, whose rows are called `scans`; warns of what is missing."""
    warn_of_skipped(inspection, log.skipped, scans)
    inspection.warnings += log.notes
    count = len(log.stamps_ns)
    true_pose_count = int(np.isfinite(log.world_T_scan).all(axis=(1, 2)).sum())
    odometry_count = np.isfinite(log.odom_T_scan).all(axis=(1, 2)).sum()
    odometry_percent = 100 * odometry_count / max(count, 1)
    steps_m = step_lengths_m(log.world_T_scan[:, :3, 3])
    steps_m = steps_m[np.isfinite(steps_m)]
    path = metres(float(steps_m.sum()))
    if len(steps_m):
        median = metres(float(np.median(steps_m)))
        path += f", step median {median}, longest {metres(float(steps_m.max()))}"
    inspection.add(
        title,
        (scans, f"{count:,}, {true_pose_count:,} with a true pose"),
        *rate_rows(inspection, log.stamps_ns * 1e-9),
        ("path", path),
        ("odometry", f"at {odometry_percent:.3g} % of the {scans}"),
    )
    inspection.warn_if(
        not true_pose_count,
        "no scan has a true pose: such a log can be learned, and judge answers, only by poses that "
        "are estimated (poses=slam)",
    )


def describe_clouds_of(inspection: Inspection, log: Log, frame: str) -> None:
    """Add the diagnoses of a few clouds of a log.

    Warns if the clouds are in the world frame already, since poses would move them twice: then the
    centre of each cloud lies near the robot's place in the world, not near the origin.
    """
    describe_clouds(inspection, len(log.stamps_ns), log.points, frame)
    far_rows = [
        row
        for row in spread(len(log.stamps_ns))
        if np.linalg.norm(log.world_T_scan[row, :2, 3]) > FAR_M
    ]
    places_m = log.world_T_scan[far_rows, :2, 3]
    centres = [np.median(log.points(row)[:, :2], axis=0) for row in far_rows]
    centres_m = np.array(centres).reshape(-1, 2)
    away_m = np.linalg.norm(centres_m - places_m, axis=1)
    # nearer to the robot's place than to the origin, by a margin for clouds that reach to one side
    inspection.warn_if(
        len(far_rows) > 1 and (away_m < 0.3 * np.linalg.norm(places_m, axis=1)).all(),
        "clouds in the world already: their points lie around where the robot was, not around "
        "itself; poses would move them twice: use the clouds in the frame of the LiDAR or the "
        "body",
    )


def rate_rows(inspection: Inspection, times_s: NDArray[np.floating]) -> list[tuple[str, str]]:
    """Rows on the first of `times_s` (n,), their span and their rate; warns of holes.

    A hole is a step of more than a second and of more than five times the median.
    """
    steps_s = np.diff(times_s)
    hole_count = 0
    if len(steps_s):
        hole_count = int((steps_s > max(1.0, 5 * float(np.median(steps_s)))).sum())
    longest = duration(float(steps_s.max(initial=0)))
    inspection.warn_if(
        hole_count,
        f"{hole_count} holes in time, the longest {longest}: the path jumps there; fetch the "
        "missing scans",
    )
    return stamp_rows(times_s)
