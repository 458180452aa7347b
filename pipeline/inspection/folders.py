"""Folders of raw files: the scans of a log, a sequence, and the root of a data set."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import LogError
from pipeline.formats import carmen, folder, kitti, nclt, records
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
SHOWN = 20  # names of a folder
FAR_M = 50.0
"""A robot so far from the origin of its world tells whether a cloud lies around itself or around
the origin."""
RECORD = {"nclt": nclt.RECORD_BYTES, "kitti": kitti.RECORD_BYTES}


def scan_folder(path: Path, as_format: str | None, found: Inspection) -> None:
    """The scans of one log: velodyne_sync/ or velodyne/; raises LogError if none of them is
    whole."""
    kind = format_of(path, as_format)
    if kind == "folder":
        _own_scans(path, found)
        return
    record_bytes = RECORD[kind]
    files = {
        file: file.stat().st_size
        for file in sorted(path.glob("*.bin"))
        if file.name != "velodyne_hits.bin"
    }
    named = {
        file: size for file, size in files.items() if file.stem.isdecimal() and len(file.stem) <= 17
    }
    whole = sorted(
        (file for file, size in named.items() if size and size % record_bytes == 0),
        key=lambda file: int(file.stem),
    )
    title = f"{kind.upper()} scans of one log"
    unnamed = len(files) - len(named)
    cut = len(named) - len(whole)
    found.warn(unnamed, f"{unnamed} .bin files are named by no number: the reader skips them")
    broken = f"empty or cut short (no whole number of {record_bytes}-byte records)"
    found.warn(cut, f"{cut} scans are {broken}: the reader skips them; fetch them anew")
    if not whole:
        raise LogError(
            f"{path}: none of its {len(files)} .bin files is a whole {kind.upper()} scan; is it "
            "the other format's?"
        )
    sizes = np.array([named[file] for file in whole])
    numbers = np.array([int(file.stem) for file in whole], np.int64)
    rows = [
        ("scans", f"{len(whole):,}, {nbytes(int(sizes.sum()))}"),
        (
            "points a scan",
            "{:,} … {:,}, median {:,.0f}".format(
                *(np.quantile(sizes, (0, 1, 0.5)) // record_bytes).astype(int)
            ),
        ),
        ("first, last", f"{whole[0].name}, {whole[-1].name}"),
    ]
    if kind == "nclt":
        found.describe(title, *rows, *rate(found, numbers * 1e-6))
        survey(found, len(whole), lambda row: read_velodyne_sync(whole[row]), "body frame, z up")
        return
    missing = int(numbers[-1] - numbers[0] + 1 - len(numbers))
    found.warn(
        missing,
        f"{missing} scans between the first and the last are not there: the path has holes; fetch "
        "them",
    )
    times = path.parent / "times.txt"
    if times.is_file():
        seconds = log.table(times, 1)[:, 0]
        rows += rate(found, seconds[numbers[numbers < len(seconds)]])
    found.describe(title, *rows)
    height_m = Kitti().lidar_height_m
    survey(
        found,
        len(whole),
        lambda row: read_velodyne(whole[row], height_m),
        f"raised by lidar_height_m = {height_m} m, z up",
    )


def _own_scans(path: Path, found: Inspection) -> None:
    """A folder of another robot's scans."""
    files = sorted(
        file for file in path.iterdir() if file.suffix in folder.SCANS and file.stat().st_size
    )
    if not files:
        raise LogError(f"{path}: all of its scans are empty; fetch them anew")
    rows = [
        ("scans", f"{len(files):,}, {nbytes(sum(file.stat().st_size for file in files))}"),
        ("read by", "the dataset folder, with poses beside them: see conf/dataset/folder.yaml"),
    ]
    plain = next((file for file in files if file.suffix == ".bin"), None)
    width = None
    if plain:
        data = plain.read_bytes()
        records.refuse_planar(data, plain)
        width = records.point_bytes(data)
        rows.insert(
            1, ("records", f"of {width or 'unknown'} bytes, found from the content of {plain.name}")
        )
    found.describe("scans of another robot", *rows)
    survey(
        found,
        len(files),
        lambda row: folder.points(files[row].read_bytes(), files[row], width),
        "as stored",
    )


def own_sequence(path: Path, reader: Folder, found: Inspection) -> None:
    """A folder of another robot's scans and poses, opened by its reader."""
    if log := describe_opened(found, OWN, path.resolve().parent, reader, "as its reader opens it"):
        survey_log(found, log, VEHICLE)


def sequence(path: Path, found: Inspection) -> None:
    """The folder of a sequence of NCLT or KITTI, opened by its reader; a LogError of the reader
    becomes a warning."""
    is_nclt = (path / "velodyne_sync").is_dir()
    whole = path.resolve()
    scans, root = (
        (path / "velodyne_sync", whole.parent) if is_nclt else (path / "velodyne", whole.parents[1])
    )
    reader: Reader = Nclt() if is_nclt else Kitti()
    opened = describe_opened(
        found, FORMATS[scans.name].upper(), root, reader, "as its reader opens it"
    )
    if opened is not None:
        survey_log(found, opened, VEHICLE)
        return
    part = Inspection(scans)
    scan_folder(scans, None, part)
    found.sections += part.sections
    found.warnings += part.warnings


def root(path: Path, own: Folder, found: Inspection) -> None:
    """The root of a data set: its sequences, and the files that each lacks; raises LogError if
    there is no sequence."""
    readers: dict[str, Reader] = {
        "KITTI": Kitti(),
        "NCLT": Nclt(),
        "RobotCar": RobotCar(),
        "CARMEN": Carmen(),
        FRAMES: KeyFrames(),
        OWN: own,
    }
    held = {name: reader.sequences(path) for name, reader in readers.items()}
    name, sequences = next((item for item in held.items() if item[1]), ("", {}))
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
    found.kind = f"{name} root, sequences: {len(sequences)}"
    rows = (
        (sequence, "lacks " + ", ".join(lacks) if lacks else "can be read")
        for sequence, lacks in sequences.items()
    )
    found.add("sequences", *rows)
    lacking = sum(map(bool, sequences.values()))
    found.warn(
        lacking, f"{lacking} of {len(sequences)} sequences cannot be read: fetch what they lack"
    )


def describe_opened(
    found: Inspection, kind: str, root: Path, reader: Reader, title: str, scans: str = "scans"
) -> Log | None:
    """Open a sequence; describe its files and, under `title`, the content of its log, whose rows
    are called `scans`.

    Warns of what is missing; where the reader refuses the sequence, the only warning is why, and
    the result is None.
    """
    found.path = path = found.path.resolve()
    names = sorted(file.name + ("/" if file.is_dir() else "") for file in path.iterdir())
    more = f", and {len(names) - SHOWN:,} more" if len(names) > SHOWN else ""
    found.describe(
        f"{kind} sequence {path.name}",
        ("holds", ", ".join(names[:SHOWN]) + more),
        ("root", str(root.resolve())),
    )
    try:
        log = reader.open(root, path.name)
    except LogError as error:
        found.warn(True, f"the reader refuses the sequence: {error}")
        return None
    describe_log(found, log, title, scans)
    return log


def key_frames(path: Path, found: Inspection) -> None:
    """A folder with keyframes.txt and its clouds, as they lie in the file."""
    if log := describe_opened(
        found, FRAMES, path.resolve().parent, KeyFrames(), "as its reader opens it"
    ):
        survey_log(found, log, "as stored; conf/dataset/nclt_keyframes.yaml turns and raises them")


def carmen_log(path: Path, found: Inspection) -> None:
    """A CARMEN log, with the reader's usual settings."""
    name = next(path.name.removesuffix(end) for end in carmen.SUFFIXES if path.name.endswith(end))
    found.describe("CARMEN log", ("size", nbytes(path.stat().st_size)))
    describe_log(found, Carmen().open(path.parent, name), "as its reader opens it", "sweeps")


def describe_log(found: Inspection, log: Log, title: str, scans: str) -> None:
    """The content of a log, whose rows are called `scans`; warns of what is missing."""
    found.warnings += tuple(
        f"{lost:,} {scans} are skipped: {reason}" for reason, lost in sorted(log.skipped.items())
    )
    found.warnings += log.notes
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
    found.add(
        title,
        (scans, f"{count:,}, {placed:,} with a true pose"),
        *rate(found, log.stamps_ns * 1e-9),
        ("path", f"{metres(float(steps.sum()))}{step}"),
        ("odometry", f"at {posed:.3g} % of the {scans}"),
    )
    found.warn(
        not placed, "no scan has a true pose: such a log can neither be learned nor judge answers"
    )


def survey_log(found: Inspection, log: Log, frame: str) -> None:
    """Add the diagnoses of a few clouds of a log; warns where they lie in the world already, so
    that poses move them twice."""
    survey(found, len(log.stamps_ns), log.points, frame)
    far = [
        row
        for row in spread(len(log.stamps_ns))
        if np.linalg.norm(log.world_T_scan[row, :2, 3]) > FAR_M
    ]
    places_m = log.world_T_scan[far, :2, 3]
    centres_m = np.array([np.median(log.points(row)[:, :2], axis=0) for row in far]).reshape(-1, 2)
    off_m = np.linalg.norm(centres_m - places_m, axis=1)
    found.warn(
        len(far) > 1 and (off_m < 0.3 * np.linalg.norm(places_m, axis=1)).all(),
        "clouds in the world already: their points lie around where the robot was, not around "
        "itself; poses would move them twice: use the clouds in the frame of the LiDAR or the "
        "body",
    )


def rate(found: Inspection, times_s: NDArray[np.floating]) -> list[tuple[str, str]]:
    """Rows on the stamps (n,) in seconds; warns of gaps."""
    steps = np.diff(times_s)
    holes = int((steps > max(1.0, 5 * float(np.median(steps)))).sum()) if len(steps) else 0
    longest = duration(float(steps.max(initial=0)))
    found.warn(
        holes,
        f"{holes} holes in time, the longest {longest}: the path jumps there; fetch the missing "
        "scans",
    )
    return clock(times_s)
