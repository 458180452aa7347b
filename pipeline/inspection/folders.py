"""Folders of raw files: the scans of a log, a sequence, and the root of a data set."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import LogError
from pipeline.formats import kitti, nclt
from pipeline.inspection import tracks
from pipeline.inspection.drives import VEHICLE
from pipeline.inspection.files import format_of
from pipeline.inspection.inspection import Inspection, Section, clock, duration, metres, nbytes
from pipeline.inspection.survey import spread, survey
from pipeline.readers.kitti import Kitti, read_velodyne
from pipeline.readers.log import Log
from pipeline.readers.nclt import Nclt, read_velodyne_sync
from pipeline.readers.robotcar import RobotCar

RECORD = {"nclt": nclt.RECORD_BYTES, "kitti": kitti.RECORD_BYTES}


def scan_folder(path: Path, as_format: str | None) -> Inspection:
    """The scans of one log: velodyne_sync/ or velodyne/; raises LogError if none of them is whole."""
    kind = format_of(path, as_format)
    record_bytes = RECORD[kind]
    files = {file: file.stat().st_size for file in sorted(path.glob("*.bin")) if file.name != "velodyne_hits.bin"}
    named = {file: size for file, size in files.items() if file.stem.isdecimal() and len(file.stem) <= 17}
    whole = sorted((file for file, size in named.items() if size and size % record_bytes == 0), key=lambda file: int(file.stem))
    warnings = []
    if len(named) < len(files):
        warnings.append(f"{len(files) - len(named)} .bin files are named by no number: the reader skips them")
    if len(whole) < len(named):
        warnings.append(
            f"{len(named) - len(whole)} scans are empty or cut short (no whole number of {record_bytes}-byte records): "
            "the reader skips them; fetch them anew"
        )
    if not whole:
        raise LogError(f"{path}: none of its {len(files)} .bin files is a whole {kind.upper()} scan; is it the other format's?")
    sizes = np.array([named[file] for file in whole])
    rows = [
        ("scans", f"{len(whole):,}, {nbytes(int(sizes.sum()))}"),
        ("points a scan", "{:,} … {:,}, median {:,.0f}".format(*(np.quantile(sizes, (0, 1, 0.5)) // record_bytes).astype(int))),
        ("first, last", f"{whole[0].name}, {whole[-1].name}"),
    ]
    numbers = np.array([int(file.stem) for file in whole], np.int64)
    if kind == "nclt":
        rows += rate(numbers * 1e-6, warnings)
        clouds, found = survey(spread(len(whole)), lambda row: read_velodyne_sync(whole[row]), "body frame, z up")
    else:
        missing = int(numbers[-1] - numbers[0] + 1 - len(numbers))
        if missing:
            warnings.append(f"{missing} scans between the first and the last are not there: the path has holes; fetch them")
        times = path.parent / "times.txt"
        if times.is_file():
            seconds = tracks.table(times, 1)[:, 0]
            rows += rate(seconds[numbers[numbers < len(seconds)]], warnings)
        lift = np.array([0.0, 0.0, Kitti().lidar_height_m])
        frame = f"raised by lidar_height_m = {lift[2]} m, z up"
        clouds, found = survey(spread(len(whole)), lambda row: read_velodyne(whole[row]) + lift, frame)
    return Inspection(f"{path} — {kind.upper()} scans of one log", (Section("", tuple(rows)), clouds), (*warnings, *found))


def sequence(path: Path) -> Inspection:
    """The folder of a sequence, opened by its reader; a LogError of the reader becomes a warning."""
    path = path.resolve()
    kind = "nclt" if (path / "velodyne_sync").is_dir() else "kitti"
    root, scans = (path.parent, path / "velodyne_sync") if kind == "nclt" else (path.parents[1], path / "velodyne")
    headline = f"{path} — {kind.upper()} sequence {path.name}"
    try:
        opened = (Nclt() if kind == "nclt" else Kitti()).open(root, path.name)
    except LogError as error:
        part, refused = scan_folder(scans, kind), f"the reader refuses the sequence: {error}"
        return Inspection(headline, (listing(path, root), *part.sections), (refused, *part.warnings))
    rows, warnings = opened_rows(opened)
    clouds, found = survey(spread(len(opened.stamps_ns)), opened.points, VEHICLE)
    return Inspection(headline, (listing(path, root), Section("as its reader opens it", rows), clouds), (*warnings, *found))


def listing(path: Path, root: Path) -> Section:
    """The files in the folder of a sequence, and the root of the data set."""
    names = sorted(file.name + ("/" if file.is_dir() else "") for file in path.iterdir())
    return Section("", (("holds", ", ".join(names)), ("root", str(root))))


def root(path: Path) -> Inspection:
    """The root of a data set: its sequences, and the files that each lacks; raises LogError if there is no sequence."""
    found = {"KITTI": Kitti().sequences(path), "NCLT": Nclt().sequences(path), "RobotCar": RobotCar().sequences(path)}
    name, sequences = next((item for item in found.items() if item[1]), ("", {}))
    if not sequences:
        names = sorted(file.name for file in path.iterdir())
        hint = f"it holds {', '.join(names[:5])}{' …' if len(names) > 5 else ''}" if names else "it is empty"
        raise LogError(
            f"{path}: no artifact, folder of scans, sequence or data set: {hint}; name a file in it, "
            "or a folder with velodyne_sync/, velodyne/, sequences/ or lms_front/"
        )
    rows = tuple((sequence, "lacks " + ", ".join(lacks) if lacks else "can be read") for sequence, lacks in sequences.items())
    lacking = sum(1 for lacks in sequences.values() if lacks)
    warnings = (f"{lacking} of {len(sequences)} sequences cannot be read: fetch what they lack",) if lacking else ()
    return Inspection(f"{path} — {name} root, sequences: {len(sequences)}", (Section("sequences", rows),), warnings)


def opened_rows(log: Log, scans: str = "scans") -> tuple[tuple[tuple[str, str], ...], list[str]]:
    """The content of an opened log as rows of text, and warnings on what is missing; `scans` is the word for its rows."""
    warnings = [f"{count:,} {scans} are skipped: {reason}" for reason, count in sorted(log.skipped.items())] + list(log.notes)
    xyz = log.world_T_scan[:, :3, 3]
    placed = np.isfinite(log.world_T_scan).all(axis=(1, 2))
    steps = np.linalg.norm(np.diff(xyz, axis=0), axis=1)
    steps = steps[np.isfinite(steps)]
    posed = np.isfinite(log.odom_T_scan).all(axis=(1, 2)).mean() if len(xyz) else 0.0
    step = f", step median {metres(float(np.median(steps)))}, longest {metres(float(steps.max()))}" if len(steps) else ""
    rows = [
        (scans, f"{len(xyz):,}, {int(placed.sum()):,} with a true pose"),
        *rate(log.stamps_ns * 1e-9, warnings),
        ("path", f"{metres(float(steps.sum()))}{step}"),
        ("odometry", f"at {100 * posed:.3g} % of the {scans}"),
    ]
    if not placed.any():
        warnings.append("no scan has a true pose: do the stamps of the scans and of the ground truth share a clock?")
    return tuple(rows), warnings


def rate(times_s: NDArray[np.floating], warnings: list[str]) -> list[tuple[str, str]]:
    """Rows on the stamps (n,) in seconds; appends a warning on gaps to `warnings`."""
    steps = np.diff(times_s)
    holes = int((steps > max(1.0, 5 * float(np.median(steps)))).sum()) if len(steps) else 0
    if holes:
        longest = duration(float(steps.max()))
        warnings.append(f"{holes} holes in time, the longest {longest}: the path jumps there; fetch the missing scans")
    return clock(times_s)
