"""Reads numbered scans with a table of their poses as a Log (METHODS 7.9).

ROOT/SEQUENCE/scans/000.pcd …    the scans
ROOT/SEQUENCE/truth.csv          a header, then a row per scan: its number, 1 if its pose is sure,
                                 a share, and the upper 3 × 4 numbers of its pose, row by row

The scans have no times: they are stamped one second apart.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core import settings
from pipeline.core.errors import LogError
from pipeline.core.frames import Poses
from pipeline.readers import log
from pipeline.readers.folder import read_scan
from pipeline.readers.keyframes import NUMBERS_END
from pipeline.readers.log import Log

HEADER = ("scan", "sure", "overlap", *(f"T{row}{col}" for row in range(3) for col in range(4)))
"""The columns of a table of poses."""
SCANS = "scans/*.pcd"


@dataclass(frozen=True)
class PosedScans:
    """A folder of sequences, each with numbered scans and a table of their poses."""

    poses: str = "truth.csv"
    """Below the sequence: the table of the poses of the scans' frame."""
    lift_m: float = 0.0
    """Height of the origin of the scans' frame above the ground, added to z."""

    def __post_init__(self) -> None:
        settings.check(self, "reader")

    def open(self, root: Path, sequence: str) -> Log:
        """Open a sequence below `root`; raises LogError if it cannot be read.

        Scans without a row, and those whose pose is not sure, are left out.
        """
        folder = root / sequence
        numbers, is_sure, world_T_scan = read_poses(folder / self.poses)
        paths = {int(path.stem): path for path in folder.glob(SCANS) if path.stem.isdecimal()}
        skipped: Counter[str] = Counter()
        skipped["no such file"] += sum(number not in paths for number in numbers.tolist())
        skipped["no pose"] += len(paths.keys() - set(numbers.tolist()))
        is_on_disk = np.isin(numbers, list(paths))
        skipped["no sure pose"] += int((is_on_disk & ~is_sure).sum())
        rows = np.flatnonzero(is_on_disk & is_sure)
        if not len(rows):
            raise LogError(f"{folder}: no scan in {SCANS} that {self.poses} gives a sure pose")
        vehicle_T_scan = log.raised(self.lift_m)
        return Log(
            stamps_ns=numbers[rows] * 10**9,
            world_T_scan=log.lifted(world_T_scan[rows], self.lift_m),
            odom_T_scan=np.full((len(rows), 4, 4), np.nan),
            points=lambda row: read_scan(paths[int(numbers[rows[row]])], vehicle_T_scan),
            skipped=+skipped,  # without the reasons that were counted as 0
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        """The sequences below `root`, each with the files that it lacks."""
        folders = sorted(path.parent for path in root.glob(f"*/{self.poses}"))
        return {folder.name: [] if any(folder.glob(SCANS)) else [SCANS] for folder in folders}


def read_poses(path: Path) -> tuple[NDArray[np.int64], NDArray[np.bool_], Poses]:
    """The scans' numbers (n,), which poses are sure (n,), and the poses (n, 4, 4) of a table.

    Raises LogError naming what is wrong.
    """
    text = log.read_bytes(path, 1, "bytes").decode("utf-8-sig", "replace")
    header, *lines = text.splitlines() or [""]
    if tuple(name.strip() for name in header.split(",")) != HEADER:
        raise LogError(f"{path}: begins with {header[:60]!r}; expected {','.join(HEADER)}")
    rows = np.array([_numbers(path, i, line) for i, line in enumerate(lines, 1) if line.strip()])
    if not len(rows):
        raise LogError(f"{path}: holds no rows")
    numbers = rows[:, 0].clip(-1, NUMBERS_END)
    is_wrong = ~((numbers >= 0) & (numbers < NUMBERS_END) & (numbers == np.floor(numbers)))
    is_wrong[1:] |= np.diff(numbers) <= 0
    if is_wrong.any():
        row = int(is_wrong.argmax())
        raise LogError(
            f"{path}: row {row + 1} is of scan {rows[row, 0]:g}; expected whole numbers that "
            "increase"
        )
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = rows[:, 3:].reshape(-1, 3, 4)
    is_sure = rows[:, 1] == 1
    log.refuse_poses(path, poses, is_sure)
    return numbers.astype(np.int64), is_sure, poses


def _numbers(path: Path, row: int, line: str) -> list[float]:
    """The numbers of a row of the table."""
    try:
        numbers = [float(word) for word in line.split(",")]
    except ValueError as error:
        raise LogError(f"{path}: row {row}: {error}") from None
    if len(numbers) != len(HEADER):
        raise LogError(f"{path}: row {row} has {len(numbers)} numbers, expected {len(HEADER)}")
    return numbers
