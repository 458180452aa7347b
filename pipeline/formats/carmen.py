"""Parses CARMEN logs of robots with 2-D lasers: a text file in; its records out (METHODS 7.5).

A record is a line: its kind, then words between blanks. Used are PARAM (a parameter), ODOM (a
reading of the odometry), and four kinds of sweeps: FLASER and RLASER of the older format,
ROBOTLASER1 and ROBOTLASER2 of the newer one, by the front and the rear laser.
"""

import gzip
import zlib
from collections import Counter
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError

SUFFIXES = (".log.gz", ".log", ".clf.gz", ".clf")
"""Suffixes of CARMEN logs."""
LARGEST_BYTES = 2**29
"""Limit for a log, packed and unpacked."""
CHUNK_BYTES = 2**20
"""Bytes that are unpacked at a time."""
MAX_BEAMS = 10_000
"""A record that claims more is damaged."""
FOV_RAD = np.pi
"""Field of view of FLASER and RLASER records, which do not hold it."""
Laser = Literal["front", "rear"]
LASERS: dict[str, Laser] = {
    "FLASER": "front",
    "RLASER": "rear",
    "ROBOTLASER1": "front",
    "ROBOTLASER2": "rear",
}
"""The laser by the kind of record."""


@dataclass(frozen=True)
class Sweep:
    """One reading of a laser."""

    laser: Laser
    ranges_m: NDArray[np.float64]
    """(beam,) from right to left."""
    angles_rad: NDArray[np.float64]
    """(beam,) counter-clockwise from the laser's x axis."""
    limit_m: float
    """The largest range that the record declares; NaN where it declares none."""
    laser_pose: NDArray[np.float64]
    """x, y in metres and heading in radians (3,) of the laser, in the log's frame."""
    robot_pose: NDArray[np.float64]
    """x, y in metres and heading in radians (3,) of the robot, in the log's frame."""
    stamp_s: float
    odometry: int
    """Number of odometry readings before it in the log, so the index of the reading after it."""


@dataclass
class Records:
    """The records of a log: parameters, sweeps and odometry readings."""

    params: dict[str, str] = field(default_factory=dict)
    sweeps: list[Sweep] = field(default_factory=list)
    odometry: list[NDArray[np.float64]] = field(default_factory=list)
    """x, y in metres and heading in radians (3,) of each reading."""
    skipped: Counter[str] = field(default_factory=Counter)
    """Number of records that are not used, by reason."""


def read(path: Path) -> Records:
    """All records of a log, plain or gzipped.

    Records that are cut short or hold other words are counted in `skipped`. Raises LogError for a
    file that is missing, damaged or larger than LARGEST_BYTES, or without a sweep.
    """
    records = Records()
    for line in _text(path).splitlines():
        kind, *words = line.split() or [""]
        try:
            if kind == "PARAM":
                records.params[words[0]] = words[1]
            elif kind == "ODOM":
                records.odometry.append(_numbers(words, 0, 3))
            elif kind in LASERS:
                parse = _flaser if kind.endswith("LASER") else _robotlaser
                records.sweeps.append(parse(LASERS[kind], words, len(records.odometry)))
        except (ValueError, IndexError):
            records.skipped["broken record"] += 1
    if not records.sweeps:
        raise LogError(f"{path}: no readable {', '.join(LASERS)} record; is it a CARMEN log?")
    return records


def _flaser(laser: Laser, words: list[str], odometry: int) -> Sweep:
    """The sweep of a FLASER or RLASER record."""
    # Its words are n, n ranges, the laser's pose, the robot's, stamp, host, stamp.
    beams = _count(words[0])
    after_ranges = 1 + beams
    return Sweep(
        laser,
        ranges_m=_ranges(words, 1, beams),
        angles_rad=np.linspace(-FOV_RAD / 2, FOV_RAD / 2, beams),
        limit_m=np.nan,
        laser_pose=_numbers(words, after_ranges, 3),
        robot_pose=_numbers(words, after_ranges + 3, 3),
        stamp_s=float(_numbers(words, after_ranges + 6, 1)[0]),
        odometry=odometry,
    )


def _robotlaser(laser: Laser, words: list[str], odometry: int) -> Sweep:
    """The sweep of a ROBOTLASER1 or ROBOTLASER2 record."""
    # Its words are type, first angle, field of view, step, largest range, accuracy, mode, n, n
    # ranges, m, m remissions, the laser's pose, the robot's, five numbers of its motion, stamp,
    # host, stamp.
    first_rad, _, step_rad, limit_m = _numbers(words, 1, 4)
    beams = _count(words[7])
    after_ranges = 8 + beams
    after_remissions = after_ranges + 1 + _count(words[after_ranges])
    motion = _numbers(words, after_remissions + 6, 5)
    return Sweep(
        laser,
        ranges_m=_ranges(words, 8, beams),
        angles_rad=first_rad + step_rad * np.arange(beams),
        limit_m=float(limit_m),
        laser_pose=_numbers(words, after_remissions, 3),
        robot_pose=_numbers(words, after_remissions + 3, 3),
        stamp_s=float(_numbers(words, after_remissions + 6 + len(motion), 1)[0]),
        odometry=odometry,
    )


def _text(path: Path) -> str:
    """The text of a log; it is read in chunks, so that a small file cannot unpack to any size."""
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            chunks = iter(lambda: file.read(CHUNK_BYTES), b"")
            data = b"".join(islice(chunks, LARGEST_BYTES // CHUNK_BYTES + 1))
    except (FileNotFoundError, IsADirectoryError):
        raise LogError(f"{path}: no such file") from None
    except (EOFError, gzip.BadGzipFile, zlib.error) as error:
        raise LogError(f"{path}: no whole gzip file ({error}); fetch it again") from None
    if len(data) > LARGEST_BYTES:
        raise LogError(f"{path}: unpacks to more than {LARGEST_BYTES >> 20} MiB; split the log")
    return data.decode("utf-8", "replace")


def _count(word: str) -> int:
    """A word as a number of beams; raises ValueError for another word."""
    if not (word.isascii() and word.isdecimal() and len(word) < 6 and int(word) <= MAX_BEAMS):
        raise ValueError
    return int(word)


def _numbers(words: list[str], start: int, count: int) -> NDArray[np.float64]:
    """The `count` words from `start` on as finite numbers; raises ValueError for other words."""
    numbers = np.array(words[start : start + count], np.float64)
    if len(numbers) < count or not np.isfinite(numbers).all():
        raise ValueError
    return numbers


def _ranges(words: list[str], start: int, beams: int) -> NDArray[np.float64]:
    """The ranges (beam,) in metres from the word `start` on; they may be NaN or infinite."""
    ranges_m = np.array(words[start : start + beams], np.float64)
    if len(ranges_m) < beams:
        raise ValueError
    return ranges_m
