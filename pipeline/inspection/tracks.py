"""Describes text files of numbers: poses of NCLT, KITTI and TUM, times, and calibration."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import Trajectory
from pipeline.formats import kitti
from pipeline.inspection.inspection import Inspection, box, clock, duration, path_length
from pipeline.readers import log, vehicle
from pipeline.readers.folder import BODY_T_CAMERA, read_tum
from pipeline.readers.nclt import Nclt, read_poses

GAP_S = 1.0
"""Poses further apart than this in time are not compared."""
SCAN_NS = 100_000_000
"""The time from one KITTI scan to the next."""


def nclt_poses(path: Path, inspection: Inspection) -> None:
    """Describe groundtruth_*.csv or odometry*.csv of NCLT.

    Rows are utime, x, y, z, roll, pitch, heading; the frames are north-east-down.
    """
    if "cov" in path.stem:
        raise LogError(
            f"{path}: covariances, which nothing here reads; inspect the odometry beside it"
        )
    rows = log.table(path, 7, ",")
    if not np.isfinite(rows[:, 0]).all():
        raise LogError(
            f"{path}: row {int(np.flatnonzero(~np.isfinite(rows[:, 0]))[0]) + 1} has no stamp"
        )
    is_relative = path.stem.endswith("odometry_mu")
    finite = np.isfinite(rows).all(axis=1)
    times_s = rows[:, 0] * 1e-6
    xyz = rows[finite, 1:4]
    gap_s = Nclt().max_gap_s
    gaps = np.diff(times_s[finite])
    source = "wheel odometry" if path.name.startswith("odometry") else "ground truth"
    inspection.describe(
        f"NCLT {source}, {'motion between images' if is_relative else 'poses of the body'}",
        ("rows", f"{len(rows):,}, of which {int((~finite).sum()):,} hold a NaN"),
        *clock(times_s),
        ("path", path_length(xyz if is_relative else np.diff(xyz, axis=0))),
        ("frame", "north-east-down (x north, y east, z down), radians; the reader turns it z up"),
        *([] if is_relative else [("box", box(xyz, ("north", "east", "down")))]),
    )
    _warn_of_order(inspection, times_s)
    if not is_relative and not _back(times_s):
        inspection.warnings += vehicle.doubts("the poses", read_poses(path))
    inspection.warn(
        (gaps > gap_s).any(),
        f"{int((gaps > gap_s).sum())} gaps over {gap_s} s, the longest "
        f"{duration(float(gaps.max(initial=0)))}: scans there have no pose and are skipped; a log "
        "with sparser rows needs max_gap_s in its dataset's yaml",
    )
    nothing_solved = (
        "every row holds a NaN: there is no pose to read; was the file written before the drive "
        "was solved?"
    )
    inspection.warn(not finite.any(), nothing_solved)


def kitti_poses(path: Path, inspection: Inspection) -> None:
    """Describe poses/NN.txt: rows of 3×4 matrices, the left camera's pose in its first frame."""
    rows = log.table(path, 12)
    finite = np.isfinite(rows).all(axis=1)
    poses = kitti.matrix(rows[finite])
    xyz = poses[:, :3, 3]
    lacking = int((~finite).sum())
    skew = _skew(poses)
    inspection.describe(
        "KITTI ground truth, poses of camera 0",
        ("poses", f"{len(rows):,}"),
        ("path", path_length(np.diff(xyz, axis=0))),
        ("box", box(xyz, ("right", "down", "forward"))),
        (
            "frame",
            "camera 0 in its first frame: x right, y down, z forward; with calib.txt's Tr the "
            "reader turns it z up",
        ),
    )
    inspection.warn_of_small_site(xyz, (0, 2))
    stamps_ns = SCAN_NS * np.flatnonzero(finite)
    inspection.warnings += vehicle.doubts(
        "the poses", Trajectory(stamps_ns, BODY_T_CAMERA @ poses @ BODY_T_CAMERA.T, GAP_S)
    )
    inspection.warn(
        lacking, f"{lacking} rows hold a NaN: the reader refuses the file; cut them off"
    )
    not_orthonormal = (
        f"rotations are off by {skew:.2g} from orthonormal: not poses, or cut numbers; fetch the "
        "file anew"
    )
    inspection.warn(skew > 1e-3, not_orthonormal)
    times = path.parents[1] / kitti.TIMES.format(log=path.stem) if len(path.parents) > 1 else path
    if path.parent.name == "poses" and times.is_file():
        count = len(log.table(times, 1))
        count_mismatch = (
            f"{count} times in {times} for {len(rows)} poses: the reader refuses the log; one is "
            "cut short"
        )
        inspection.warn(count != len(rows), count_mismatch)


def first_row(path: Path) -> list[str]:
    """The words of the first row that is not a comment; empty for a file without rows."""
    with path.open(encoding="utf-8", errors="replace") as file:
        rows = (line.split("#")[0].replace(",", " ").split() for line in file)
        return next((words for words in rows if words), [])


def numbers(path: Path, inspection: Inspection) -> None:
    """Describe a text of poses or times, told by the count of its columns, else by its name.

    Raises ConfigError for any other file.
    """
    words = first_row(path)
    try:
        [float(word) for word in words]
    except ValueError:
        words = []
    by_columns = {1: kitti_times, 7: nclt_poses, 8: tum_poses, 12: kitti_poses, 13: tum_poses}
    by_name = {
        "groundtruth*.csv": nclt_poses,
        "odometry*.csv": nclt_poses,
        "times.txt": kitti_times,
        "[0-9][0-9].txt": kitti_poses,
    }
    look = by_columns.get(len(words)) or next(
        (look for name, look in by_name.items() if path.match(name)), None
    )
    if look is None:
        expected = "poses have 7 (NCLT), 8 (TUM) or 12 (KITTI) numbers a row, times have 1"
        raise ConfigError(f"{path}: no kind of file that inspect knows: {expected}")
    look(path, inspection)


def tum_poses(path: Path, inspection: Inspection) -> None:
    """Describe a TUM trajectory: stamp in s, x, y, z in m, quaternion x, y, z, w."""
    stamps_ns, poses = read_tum(path)
    finite = np.isfinite(poses).all(axis=(1, 2))
    xyz = poses[finite, :3, 3]
    lacking = int((~finite).sum())
    inspection.describe(
        "TUM trajectory",
        (
            "rows",
            f"{len(stamps_ns):,}" + (f", of which {lacking:,} hold a NaN: gaps" if lacking else ""),
        ),
        *clock(stamps_ns * 1e-9),
        ("path", path_length(np.diff(xyz, axis=0))),
        ("box", box(xyz, "xyz")),
        ("frame", "as the file has it; conf/dataset/folder.yaml's poses_frame says which"),
    )
    inspection.warn_of_small_site(xyz)
    inspection.warnings += vehicle.doubts("the poses", Trajectory(stamps_ns, poses, GAP_S))


def kitti_times(path: Path, inspection: Inspection) -> None:
    """Describe times.txt: seconds from the start of the log, one row per scan."""
    times_s = log.table(path, 1)[:, 0]
    log.refuse_times(path, times_s, "s", 10**9)
    inspection.describe("KITTI times", ("rows", f"{len(times_s):,}"), *clock(times_s))
    _warn_of_order(inspection, times_s)


def kitti_calib(path: Path, inspection: Inspection) -> None:
    """Describe calib.txt: camera projections P0–P3 and Tr = cam0 <- velodyne."""
    try:
        lines = [
            line.partition(":")
            for line in path.read_text(encoding="utf-8").splitlines()
            if ":" in line
        ]
        entries = {
            name: np.array([float(number) for number in numbers.split()])
            for name, _, numbers in lines
        }
    except (UnicodeDecodeError, ValueError):
        raise LogError(
            f"{path}: expected rows 'NAME: 12 numbers', as in KITTI's calib.txt"
        ) from None
    if "Tr" not in entries or entries["Tr"].shape != (12,):
        raise LogError(
            f"{path}: expected a row 'Tr:' with 12 numbers, the camera's frame from the Velodyne's"
        )
    cam_T_velo = kitti.matrix(entries["Tr"][None])
    camera_m = -cam_T_velo[0, :3, :3].T @ cam_T_velo[0, :3, 3]
    inspection.describe(
        "KITTI calibration",
        ("entries", ", ".join(entries)),
        ("camera 0", "at x {:.3f}, y {:.3f}, z {:.3f} m in the Velodyne's frame".format(*camera_m)),
        (
            "frame",
            "Tr maps Velodyne coordinates (x forward, y left, z up) into camera 0's (x right, y "
            "down, z forward)",
        ),
    )
    skew = _skew(cam_T_velo)
    not_orthonormal = (
        f"Tr's rotation is off by {skew:.2g} from orthonormal: every pose would be sheared; fetch "
        "the file anew"
    )
    inspection.warn(skew > 1e-3, not_orthonormal)


def _skew(poses: NDArray[np.float64]) -> float:
    """The largest deviation of the rotations of poses (n, 4, 4) from orthonormal."""
    R = poses[:, :3, :3]
    return float(np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(initial=0.0))


def _back(times_s: NDArray[np.float64]) -> list[int]:
    """The rows, from 1 on, whose stamps are not after the row before."""
    return [int(row) for row in np.flatnonzero(~(np.diff(times_s) > 0)) + 2]


def _warn_of_order(inspection: Inspection, times_s: NDArray[np.float64]) -> None:
    disordered = _back(times_s)
    rows = f"row {disordered[0]} and {len(disordered) - 1} more" if disordered else ""
    inspection.warn(
        disordered, f"stamps do not increase at {rows}: the reader refuses the file; sort its rows"
    )
