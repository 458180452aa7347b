"""NCLT: velodyne_sync scans, ground truth and wheel odometry (METHODS 7.1).

The files' frames are north-east-down; everything handed out is x forward (north), y left (west), z up.
"""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import LogError
from pipeline.formats import nclt
from pipeline.frames import Trajectory, flip_ned, pose
from pipeline.readers import log
from pipeline.readers.log import Log


@dataclass(frozen=True)
class Nclt:
    """A folder of NCLT sequences, one date a sequence."""

    max_gap_s: float = 0.5
    """Ground truth further apart than this is a gap; a scan in it is skipped."""
    lift_m: float = 0.0
    """Added to z. NCLT's body frame has its origin at about ground level."""

    def open(self, root: Path, sequence: str) -> Log:
        folder = root / sequence / nclt.SCANS
        truth_path = log.located(root, nclt.TRUTH_PLACES, sequence)
        if truth_path is None:
            raise LogError(
                f"{root / nclt.TRUTH_PLACES[0].format(sequence=sequence)}: no ground truth there or in its other places"
            )
        skipped: Counter[str] = Counter()
        paths = _scan_files(folder, skipped)
        utimes = np.array([int(path.stem) for path in paths], np.int64)
        odometry_path = log.located(root, nclt.ODOMETRY_PLACES, sequence)
        odometry = None if odometry_path is None else read_poses(odometry_path, self.max_gap_s)
        rows, world_T_scan, odom_T_scan = log.posed(utimes * 1000, read_poses(truth_path, self.max_gap_s), odometry, skipped)
        kept = [paths[row] for row in rows]
        lift = np.array([0.0, 0.0, self.lift_m])
        notes = () if odometry_path is not None else ("no odometry_mu_100hz.csv",)
        return Log(
            utimes[rows] * 1000, world_T_scan, odom_T_scan, lambda row: read_velodyne_sync(kept[row]) + lift, +skipped, notes
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        names = sorted(path.parent.name for path in root.glob(f"*/{nclt.SCANS}") if path.is_dir())
        return {name: [] if log.located(root, nclt.TRUTH_PLACES, name) else [f"groundtruth_{name}.csv"] for name in names}


def read_velodyne_sync(path: str | Path) -> NDArray[np.float64]:
    """Points (n, 3) in metres of one scan: body frame, x forward, y left, z up, motion compensated.

    Raises LogError for a missing file or one that is no whole number of records.
    """
    data = log.read_bytes(Path(path), nclt.RECORD_BYTES, "hits")
    points: NDArray[np.float64] = nclt.decode(np.frombuffer(data, "<u2"))
    return points


def read_poses(path: str | Path, max_gap_s: float = 0.5) -> Trajectory:
    """Ground truth or odometry: poses of the z-up body in the z-up world; rows with NaN stay, as gaps."""
    path = Path(path)
    rows = log.table(path, 7, ",")
    stamps_ns = log.nanoseconds(path, rows[:, 0], "µs", 1000)
    known = np.isfinite(rows).all(axis=1)
    world_T_body = np.full((len(rows), 4, 4), np.nan)
    world_T_body[known] = flip_ned(pose(rows[known, 1:4], rows[known, 4:7]))
    return Trajectory(stamps_ns, world_T_body, max_gap_s)


def _scan_files(folder: Path, skipped: Counter[str]) -> list[Path]:
    """Scan files in order of time; counts those whose name or length cannot be right."""
    if not folder.is_dir():
        raise LogError(f"{folder}: no such folder of scans")
    good: list[Path] = []
    for path in folder.glob("*.bin"):
        length = path.stat().st_size
        if not path.is_file() or not path.stem.isdecimal() or path.stem[0] == "0" or int(path.stem) >= log.LATEST_NS // 1000:
            skipped["file name is no utime"] += 1
        elif length == 0:
            skipped["empty file"] += 1
        elif length % nclt.RECORD_BYTES:
            skipped["truncated record"] += 1
        else:
            good.append(path)
    if not good:
        raise LogError(f"{folder}: holds no readable scan (UTIME.bin)")
    return sorted(good, key=lambda path: int(path.stem))
