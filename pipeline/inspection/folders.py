"""Describes folders of raw files for `yearloc inspect`: a folder in; rows of text and warnings out.

A folder may hold the scans of a log, be a sequence, or the root of a data set.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.formats import bin_layout, carmen, folder, kitti, nclt
from pipeline.inspection.cloud import spread, survey
from pipeline.inspection.drives import VEHICLE
from pipeline.inspection.files import FORMATS, format_of
from pipeline.inspection.inspection import Inspection, clock, duration, metres, nbytes
from pipeline.readers import log
from pipeline.readers.carmen import Carmen
from pipeline.readers.folder import Folder
from pipeline.readers.keyframes import KeyFrames
from pipeline.readers.kitti import Kitti, read_velodyne
from pipeline.readers.log import Log, Reader
from pipeline.readers.nclt import Nclt, read_velodyne_sync
from pipeline.readers.robotcar import RobotCar

FRAMES = "key frames"
OWN = "another robot's"
"""What a data set is called that the reader of key frames or of own scans opens."""
SHOWN = 20
"""Names of a folder that are listed."""
FAR_M = 50.0
"""A robot farther than this from the origin of its world tells where its cloud lies.

Nearer, a cloud around the robot and one around the origin look the same.
"""
RECORD = {"nclt": nclt.RECORD_BYTES, "kitti": kitti.RECORD_BYTES}
"""Bytes of a point, by format."""


def scan_folder(path: Path, as_format: str | None, inspection: Inspection) -> None:
    """Describe the scans of one log: velodyne_sync/ or velodyne/.

    Raises LogError if none of them is whole.
    """
    kind = format_of(path, as_format)
    if kind == "folder":
        _own_scans(path, inspection)
        return
    files = _whole_scans(path, kind, inspection)
    numbers = np.array([int(file.stem) for file in files], np.int64)
    title = f"{kind.upper()} scans of one log"
    rows = _file_rows(files, RECORD[kind])
    if kind == "nclt":
        inspection.describe(title, *rows, *rate(inspection, numbers * 1e-6))
        survey(
            inspection, len(files), lambda row: read_velodyne_sync(files[row]), "body frame, z up"
        )
        return
    missing = int(numbers[-1] - numbers[0] + 1 - len(numbers))
    inspection.warn(
        missing,
        f"{missing} scans between the first and the last are not there: the path has holes; fetch "
        "them",
    )
    times = path.parent / "times.txt"
    if times.is_file():
        seconds = log.table(times, 1)[:, 0]
        rows += rate(inspection, seconds[numbers[numbers < len(seconds)]])
    inspection.describe(title, *rows)
    height_m = Kitti().lidar_height_m
    survey(
        inspection,
        len(files),
        lambda row: read_velodyne(files[row], height_m),
        f"raised by lidar_height_m = {height_m} m, z up",
    )


def _whole_scans(path: Path, kind: str, inspection: Inspection) -> list[Path]:
    """The scan files of a format that are whole, by number; warns of the others.

    Raises LogError if there is none.
    """
    record_bytes = RECORD[kind]
    files = [file for file in path.glob("*.bin") if file.name != "velodyne_hits.bin"]
    numbered = [file for file in files if file.stem.isdecimal() and len(file.stem) <= 17]
    sizes = {file: file.stat().st_size for file in numbered}
    whole = [file for file, size in sizes.items() if size and size % record_bytes == 0]
    unnamed_count = len(files) - len(numbered)
    cut_count = len(numbered) - len(whole)
    inspection.warn(
        unnamed_count, f"{unnamed_count} .bin files are named by no number: the reader skips them"
    )
    broken = f"empty or cut short (no whole number of {record_bytes}-byte records)"
    inspection.warn(
        cut_count, f"{cut_count} scans are {broken}: the reader skips them; fetch them anew"
    )
    if not whole:
        raise LogError(
            f"{path}: none of its {len(files)} .bin files is a whole {kind.upper()} scan; is it "
            "the other format's?"
        )
    return sorted(whole, key=lambda file: (int(file.stem), file.name))


def _file_rows(files: list[Path], record_bytes: int) -> list[tuple[str, str]]:
    """Rows on scan files: how many, how large, and their names."""
    sizes = np.array([file.stat().st_size for file in files])
    least, most, median = (np.quantile(sizes, (0, 1, 0.5)) // record_bytes).astype(int)
    return [
        ("scans", f"{len(files):,}, {nbytes(int(sizes.sum()))}"),
        ("points a scan", f"{least:,} … {most:,}, median {median:,.0f}"),
        ("first, last", f"{files[0].name}, {files[-1].name}"),
    ]


def _own_scans(path: Path, inspection: Inspection) -> None:
    """Describe a folder of another robot's scans; raises LogError if all are empty."""
    files = sorted(
        file for file in path.iterdir() if file.suffix in folder.SCANS and file.stat().st_size
    )
    if not files:
        raise LogError(f"{path}: all of its scans are empty; fetch them anew")
    rows = [
        ("scans", f"{len(files):,}, {nbytes(sum(file.stat().st_size for file in files))}"),
        ("read by", "the dataset folder, with poses beside them: see conf/dataset/folder.yaml"),
    ]
    bin_file = next((file for file in files if file.suffix == ".bin"), None)
    width = None
    if bin_file:
        data = bin_file.read_bytes()
        bin_layout.refuse_planar(data, bin_file)
        width = bin_layout.point_bytes(data)
        rows.insert(
            1,
            (
                "records",
                f"of {width or 'unknown'} bytes, found from the content of {bin_file.name}",
            ),
        )
    inspection.describe("scans of another robot", *rows)
    survey(
        inspection,
        len(files),
        lambda row: folder.points(files[row].read_bytes(), files[row], width),
        "as stored",
    )


def own_sequence(path: Path, reader: Folder, inspection: Inspection) -> None:
    """Describe a folder of another robot's scans and poses, opened by its reader."""
    if log := describe_opened(
        inspection, OWN, path.resolve().parent, reader, "as its reader opens it"
    ):
        survey_log(inspection, log, VEHICLE)


def sequence(path: Path, inspection: Inspection) -> None:
    """Describe the folder of a sequence of NCLT or KITTI, opened by its reader.

    A LogError of the reader becomes a warning.
    """
    is_nclt = (path / "velodyne_sync").is_dir()
    full_path = path.resolve()
    scans, root = (
        (path / "velodyne_sync", full_path.parent)
        if is_nclt
        else (path / "velodyne", full_path.parents[1])
    )
    reader: Reader = Nclt() if is_nclt else Kitti()
    opened_log = describe_opened(
        inspection, FORMATS[scans.name].upper(), root, reader, "as its reader opens it"
    )
    if opened_log is not None:
        survey_log(inspection, opened_log, VEHICLE)
        return
    scan_inspection = Inspection(scans)
    scan_folder(scans, None, scan_inspection)
    inspection.sections += scan_inspection.sections
    inspection.warnings += scan_inspection.warnings


def root(path: Path, folder_reader: Folder, inspection: Inspection) -> None:
    """Describe the root of a data set: its sequences, and the files that each lacks.

    Raises LogError if there is no sequence.
    """
    readers: dict[str, Reader] = {
        "KITTI": Kitti(),
        "NCLT": Nclt(),
        "RobotCar": RobotCar(),
        "CARMEN": Carmen(),
        FRAMES: KeyFrames(),
        OWN: folder_reader,
    }
    sequences_by_reader = {name: reader.sequences(path) for name, reader in readers.items()}
    name, sequences = next((item for item in sequences_by_reader.items() if item[1]), ("", {}))
    if not sequences:
        names = sorted(file.name for file in path.iterdir())
        hint = (
            f"it holds {', '.join(names[:5])}{' …' if len(names) > 5 else ''}"
            if names
            else "it is empty"
        )
        raise LogError(
            f"{path}: no artifact, folder of scans, sequence or data set: {hint}; name a file in "
            "it, or a folder with velodyne_sync/, velodyne/, sequences/ or lms_front/"
        )
    inspection.kind = f"{name} root, sequences: {len(sequences)}"
    rows = (
        (sequence, "lacks " + ", ".join(lacks) if lacks else "can be read")
        for sequence, lacks in sequences.items()
    )
    inspection.add("sequences", *rows)
    incomplete = sum(map(bool, sequences.values()))
    inspection.warn(
        incomplete,
        f"{incomplete} of {len(sequences)} sequences cannot be read: fetch what they lack",
    )


def describe_opened(
    inspection: Inspection, kind: str, root: Path, reader: Reader, title: str, scans: str = "scans"
) -> Log | None:
    """Open a sequence, and describe its files and the content of its log.

    The content stands under `title`; its rows are called `scans`. Warns of what is missing; where
    the reader refuses the sequence, the only warning is why, and the result is None.
    """
    inspection.path = path = inspection.path.resolve()
    names = sorted(file.name + ("/" if file.is_dir() else "") for file in path.iterdir())
    hidden_names = f", and {len(names) - SHOWN:,} more" if len(names) > SHOWN else ""
    inspection.describe(
        f"{kind} sequence {path.name}",
        ("holds", ", ".join(names[:SHOWN]) + hidden_names),
        ("root", str(root.resolve())),
    )
    try:
        log = reader.open(root, path.name)
    except LogError as error:
        inspection.warn(True, f"the reader refuses the sequence: {error}")
        return None
    describe_log(inspection, log, title, scans)
    return log


def key_frames(path: Path, inspection: Inspection) -> None:
    """Describe a folder with keyframes.txt and its clouds, in the frame of their files."""
    if log := describe_opened(
        inspection, FRAMES, path.resolve().parent, KeyFrames(), "as its reader opens it"
    ):
        survey_log(
            inspection, log, "as stored; conf/dataset/nclt_keyframes.yaml turns and raises them"
        )


def carmen_log(path: Path, inspection: Inspection) -> None:
    """Describe a CARMEN log, opened with the reader's defaults."""
    name = next(path.name.removesuffix(end) for end in carmen.SUFFIXES if path.name.endswith(end))
    inspection.describe("CARMEN log", ("size", nbytes(path.stat().st_size)))
    describe_log(inspection, Carmen().open(path.parent, name), "as its reader opens it", "sweeps")


def describe_log(inspection: Inspection, log: Log, title: str, scans: str) -> None:
    """Add the content of a log, whose rows are called `scans`; warns of what is missing."""
    inspection.warnings += tuple(
        f"{scan_count:,} {scans} are skipped: {reason}"
        for reason, scan_count in sorted(log.skipped.items())
    )
    inspection.warnings += log.notes
    count = len(log.stamps_ns)
    placed = int(np.isfinite(log.world_T_scan).all(axis=(1, 2)).sum())
    posed = 100 * np.isfinite(log.odom_T_scan).all(axis=(1, 2)).sum() / max(count, 1)
    steps = np.linalg.norm(np.diff(log.world_T_scan[:, :3, 3], axis=0), axis=1)
    steps = steps[np.isfinite(steps)]
    step = (
        f", step median {metres(float(np.median(steps)))}, longest {metres(float(steps.max()))}"
        if len(steps)
        else ""
    )
    inspection.add(
        title,
        (scans, f"{count:,}, {placed:,} with a true pose"),
        *rate(inspection, log.stamps_ns * 1e-9),
        ("path", f"{metres(float(steps.sum()))}{step}"),
        ("odometry", f"at {posed:.3g} % of the {scans}"),
    )
    inspection.warn(
        not placed,
        "no scan has a true pose: such a log can be learned, and judge answers, only by poses that "
        "are estimated (poses=slam)",
    )


def survey_log(inspection: Inspection, log: Log, frame: str) -> None:
    """Add the diagnoses of a few clouds of a log.

    Warns where they lie in the world already, so that poses would move them twice.
    """
    survey(inspection, len(log.stamps_ns), log.points, frame)
    far_rows = [
        row
        for row in spread(len(log.stamps_ns))
        if np.linalg.norm(log.world_T_scan[row, :2, 3]) > FAR_M
    ]
    places_m = log.world_T_scan[far_rows, :2, 3]
    centres_m = np.array([np.median(log.points(row)[:, :2], axis=0) for row in far_rows]).reshape(
        -1, 2
    )
    off_m = np.linalg.norm(centres_m - places_m, axis=1)
    inspection.warn(
        len(far_rows) > 1 and (off_m < 0.3 * np.linalg.norm(places_m, axis=1)).all(),
        "clouds in the world already: their points lie around where the robot was, not around "
        "itself; poses would move them twice: use the clouds in the frame of the LiDAR or the "
        "body",
    )


def rate(inspection: Inspection, times_s: NDArray[np.floating]) -> list[tuple[str, str]]:
    """Rows on the stamps (n,) in seconds; warns of gaps."""
    steps = np.diff(times_s)
    holes = int((steps > max(1.0, 5 * float(np.median(steps)))).sum()) if len(steps) else 0
    longest = duration(float(steps.max(initial=0)))
    inspection.warn(
        holes,
        f"{holes} holes in time, the longest {longest}: the path jumps there; fetch the missing "
        "scans",
    )
    return clock(times_s)
