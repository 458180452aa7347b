"""Oxford RobotCar: a sweep, the folder of one laser, and a sequence as its reader opens it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import LogError
from pipeline.formats import robotcar
from pipeline.inspection import folders, symptoms
from pipeline.inspection.files import moment_of
from pipeline.inspection.inspection import Inspection, Section, metres, nbytes, typographic
from pipeline.inspection.survey import spread
from pipeline.readers import log
from pipeline.readers.columns import utimes_ns
from pipeline.readers.robotcar import RobotCar, read_sweep

BEAMS = 541
"""Number of beams in a whole sweep: 270° in steps of half a degree."""
REACH_M = 50.0
PLANE = np.eye(4)
"""Extrinsics that leave a sweep in its scan plane."""


def sweep(path: Path) -> Inspection:
    """lms_front/UTIME.bin or lms_rear/UTIME.bin: x, y, reflectance in the laser's scan plane."""
    data = log.read_bytes(path, robotcar.RECORD_BYTES, "returns")
    if not data:
        raise LogError(f"{path}: empty; expected the returns of one sweep: fetch the file anew")
    rows, points = robotcar.decode_sweep(data), read_sweep(path, PLANE)
    range_m = np.hypot(points[:, 0], points[:, 1])
    bright = rows[np.isfinite(rows[:, 2]), 2]
    cells = [
        ("size", f"{nbytes(len(data))}, records of {robotcar.RECORD_BYTES} bytes"),
        ("taken", moment_of(path)),
        ("returns", f"{len(points):,} of {len(rows):,} beams in the file"),
        ("range", "{} … {}, median {}".format(*map(metres, np.quantile(range_m, (0, 1, 0.5)))) if len(points) else "none"),
        ("azimuth", f"{symptoms.coverage(points):.0f}° of 360° covered"),
        ("reflectance", f"{bright.min():g} … {bright.max():g}" if len(bright) else "none"),
        ("frame", "the laser's scan plane, z = 0; the reader lays it out in the vehicle by the extrinsics, z up"),
    ]
    warnings = []
    if not len(points):
        warnings.append("no beam has a return: was the laser covered?")
    if len(rows) > BEAMS:
        warnings.append(f"{len(rows):,} beams: an LMS-151 has {BEAMS}; is this file another laser's?")
    if (range_m > REACH_M).any():
        warnings.append(f"{int((range_m > REACH_M).sum())} returns beyond {metres(REACH_M)}, farther than an LMS-151 sees")
    return Inspection(f"{path} — RobotCar sweep of {path.parent.name}", (Section("", tuple(cells)),), tuple(warnings))


def sweeps(path: Path) -> Inspection:
    """lms_front/ or lms_rear/: the sweeps of one laser, and the list of stamps beside the folder."""
    sizes = {file: file.stat().st_size for file in path.glob("*.bin") if file.stem.isdecimal() and len(file.stem) <= 17}
    whole = sorted((file for file, size in sizes.items() if size and size % robotcar.RECORD_BYTES == 0), key=_utime)
    if not whole:
        raise LogError(f"{path}: none of its {len(sizes)} files UTIME.bin is a whole sweep; fetch them anew")
    warnings = []
    if len(whole) < len(sizes):
        warnings.append(f"{len(sizes) - len(whole)} sweeps are empty or cut short: the reader skips them; fetch them anew")
    utimes = np.array([_utime(file) for file in whole])
    beams = np.array([sizes[file] // robotcar.RECORD_BYTES for file in whole])
    rows = [
        ("sweeps", f"{len(whole):,}, {nbytes(sum(sizes.values()))}"),
        ("beams a sweep", f"{beams.min():,} … {beams.max():,}, median {np.median(beams):,.0f}"),
        ("first, last", f"{whole[0].name}, {whole[-1].name}"),
        *folders.rate(utimes * 1e-6, warnings),
        ("stamps", _stamps(path, utimes, warnings)),
    ]
    table = _table(spread(len(whole)), lambda row: read_sweep(whole[row], PLANE), "in the laser's scan plane")
    return Inspection(f"{path} — RobotCar sweeps of one laser", (Section("", tuple(rows)), table), tuple(warnings))


def sequence(path: Path) -> Inspection:
    """The folder of a sequence, opened by its reader; a LogError of the reader becomes a warning."""
    path = path.resolve()
    lasers = [laser for laser in robotcar.LASERS if (path / laser).is_dir()]
    listing = folders.listing(path, path.parent)
    headline = f"{path} — RobotCar sequence {path.name}"
    try:
        opened = RobotCar(lasers).open(path.parent, path.name)
    except LogError as error:
        parts = [sweeps(path / laser) for laser in lasers]
        sections = [Section(laser, part.sections[0].rows) for laser, part in zip(lasers, parts, strict=True)]
        found = [warning for part in parts for warning in part.warnings]
        return Inspection(headline, (listing, *sections), (f"the reader refuses the sequence: {error}", *found))
    rows, warnings = folders.opened_rows(opened, "sweeps")
    read = Section(f"as its reader opens it, with {' and '.join(lasers)}", rows)
    table = _table(spread(len(opened.stamps_ns)), opened.points, "vehicle frame: x forward, y left, z up from the camera")
    return Inspection(headline, (listing, read, table), tuple(warnings))


def _table(rows: list[int], points: Callable[[int], NDArray[np.floating]], frame: str) -> Section:
    """A table of a few sweeps."""
    table: list[tuple[str, ...]] = [("sweep", "returns", "x", "y", "z")]
    for row in rows:
        cloud = points(row)
        ends = zip(cloud.min(axis=0), cloud.max(axis=0), strict=True) if len(cloud) else []
        table.append((str(row), f"{len(cloud):,}", *(typographic(f"{low:.1f} … {high:.1f} m") for low, high in ends)))
    return Section(f"sweeps, {frame}", tuple(table))


def _stamps(folder: Path, utimes: NDArray[np.int64], warnings: list[str]) -> str:
    """The number of stamps in the list of a laser; appends warnings on files without a stamp and the reverse."""
    path = folder.with_suffix(".timestamps")
    if not path.is_file():
        warnings.append(f"no {path.name} beside the folder: the reader takes every file that is there")
        return "by the names of the files"
    stamps = utimes_ns(path, log.table(path, 2)[:, 0]) // 1000
    lone, lost = int((~np.isin(utimes, stamps)).sum()), int((~np.isin(stamps, utimes)).sum())
    if lone or lost:
        warnings.append(f"{path.name}: {lost:,} stamps have no whole file and {lone:,} files no stamp: the reader skips them")
    return f"{len(stamps):,} in {path.name}"


def _utime(path: Path) -> int:
    return int(path.stem)
