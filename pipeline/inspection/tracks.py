"""Text files of numbers: the poses of NCLT, the poses, times and calibration of KITTI, TUM trajectories."""

import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import LogError
from pipeline.formats import kitti
from pipeline.inspection.inspection import Inspection, Section, clock, duration, path_length, typographic
from pipeline.readers import log
from pipeline.readers.folder import read_tum

GAP_S = 0.5
"""Scans between rows further apart than this have no pose (max_gap_s of the NCLT reader)."""


def nclt_poses(path: Path) -> Inspection:
    """groundtruth_*.csv and odometry*.csv: utime, x, y, z, roll, pitch, heading; north-east-down."""
    if "cov" in path.stem:
        raise LogError(f"{path}: covariances, which nothing here reads; inspect the odometry beside it")
    rows = table(path, 7, ",")
    if not np.isfinite(rows[:, 0]).all():
        raise LogError(f"{path}: row {int(np.flatnonzero(~np.isfinite(rows[:, 0]))[0]) + 1} has no stamp")
    relative = path.stem.endswith("odometry_mu")
    known = np.isfinite(rows).all(axis=1)
    times_s, xyz = rows[:, 0] * 1e-6, rows[known, 1:4]
    gaps = np.diff(times_s[known])
    steps = np.linalg.norm(xyz if relative else np.diff(xyz, axis=0), axis=1)
    cells = [
        ("rows", f"{len(rows):,}, of which {int((~known).sum()):,} hold a NaN"),
        *clock(times_s),
        ("path", path_length(steps)),
        ("frame", "north-east-down (x north, y east, z down), radians; the reader turns it z up"),
    ]
    cells += [] if relative else [("box", box(xyz, "north", "east", "down"))]
    found = _order(times_s)
    if (gaps > GAP_S).any():
        found.append(
            f"{int((gaps > GAP_S).sum())} gaps over {GAP_S} s, the longest {duration(float(gaps.max()))}: scans there have "
            "no pose and are skipped; a log with sparser rows needs max_gap_s in its dataset's yaml"
        )
    if not known.any():
        found.append("every row holds a NaN: there is no pose to read; was the file written before the drive was solved?")
    what = "wheel odometry" if path.name.startswith("odometry") else "ground truth"
    kind = f"NCLT {what}, " + ("motion between images" if relative else "poses of the body")
    return Inspection(f"{path} — {kind}", (Section("", tuple(cells)),), tuple(found))


def kitti_poses(path: Path) -> Inspection:
    """poses/NN.txt: rows of 3×4 matrices, the left camera's pose in its first frame."""
    rows = table(path, 12)
    finite = np.isfinite(rows).all(axis=1)
    poses = kitti.matrix(rows[finite])
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    skew = np.abs(np.swapaxes(poses[:, :3, :3], 1, 2) @ poses[:, :3, :3] - np.eye(3)).max(initial=0.0)
    cells = (
        ("poses", f"{len(rows):,}"),
        ("path", path_length(steps)),
        ("box", box(poses[:, :3, 3], "right", "down", "forward")),
        ("frame", "camera 0 in its first frame: x right, y down, z forward; with calib.txt's Tr the reader turns it z up"),
    )
    found = [] if finite.all() else [f"{int((~finite).sum())} rows hold a NaN: the reader refuses the file; cut them off"]
    if skew > 1e-3:
        found.append(f"rotations are off by {skew:.2g} from orthonormal: not poses, or cut numbers; fetch the file anew")
    times = path.parents[1] / kitti.TIMES.format(log=path.stem) if len(path.parents) > 1 else path
    if path.parent.name == "poses" and times.is_file() and len(table(times, 1)) != len(rows):
        count = len(table(times, 1))
        found.append(f"{count} times in {times} for {len(rows)} poses: the reader refuses the log; one is cut short")
    return Inspection(f"{path} — KITTI ground truth, poses of camera 0", (Section("", cells),), tuple(found))


def is_tum(path: Path) -> bool:
    """Whether the first row that is not a comment has the eight words of a TUM trajectory."""
    with path.open(errors="replace") as file:
        rows = (line.split("#")[0].replace(",", " ").split() for line in file)
        return len(next((words for words in rows if words), [])) == 8


def tum_poses(path: Path) -> Inspection:
    """A TUM trajectory: stamp in s, x, y, z in m, quaternion x, y, z, w."""
    stamps_ns, poses = read_tum(path)
    known = np.isfinite(poses).all(axis=(1, 2))
    xyz = poses[known, :3, 3]
    steps = np.linalg.norm(np.diff(xyz, axis=0), axis=1)
    lacking = int((~known).sum())
    cells = (
        ("rows", f"{len(stamps_ns):,}" + (f", of which {lacking:,} hold a NaN: gaps" if lacking else "")),
        *clock(stamps_ns * 1e-9),
        ("path", path_length(steps)),
        ("box", box(xyz, "x", "y", "z")),
        ("frame", "as the file has it; conf/dataset/folder.yaml's poses_frame says which"),
    )
    return Inspection(f"{path} — TUM trajectory", (Section("", cells),))


def kitti_times(path: Path) -> Inspection:
    """times.txt: seconds from the start of the log, one row per scan."""
    times_s = table(path, 1)[:, 0]
    rows = (("rows", f"{len(times_s):,}"), *clock(times_s))
    return Inspection(f"{path} — KITTI times", (Section("", rows),), tuple(_order(times_s)))


def kitti_calib(path: Path) -> Inspection:
    """calib.txt: camera projections P0–P3 and Tr = cam0 <- velodyne."""
    try:
        lines = [line.partition(":") for line in path.read_text().splitlines() if ":" in line]
        entries = {name: np.array([float(number) for number in numbers.split()]) for name, _, numbers in lines}
    except (UnicodeDecodeError, ValueError):
        raise LogError(f"{path}: expected rows 'NAME: 12 numbers', as in KITTI's calib.txt") from None
    if "Tr" not in entries or entries["Tr"].shape != (12,):
        raise LogError(f"{path}: expected a row 'Tr:' with 12 numbers, the camera's frame from the Velodyne's")
    cam_T_velo = kitti.matrix(entries["Tr"][None])[0]
    forward = -cam_T_velo[:3, :3].T @ cam_T_velo[:3, 3]
    cells = (
        ("entries", ", ".join(entries)),
        ("camera 0", "at x {:.3f}, y {:.3f}, z {:.3f} m in the Velodyne's frame".format(*forward)),
        ("frame", "Tr maps Velodyne coordinates (x forward, y left, z up) into camera 0's (x right, y down, z forward)"),
    )
    skew = np.abs(cam_T_velo[:3, :3].T @ cam_T_velo[:3, :3] - np.eye(3)).max()
    found = (f"Tr's rotation is off by {skew:.2g} from orthonormal: every pose would be sheared; fetch the file anew",)
    return Inspection(f"{path} — KITTI calibration", (Section("", cells),), found if skew > 1e-3 else ())


def table(path: Path, columns: int, delimiter: str | None = None) -> NDArray[np.float64]:
    """`log.table` without the warning of numpy at an empty file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return log.table(path, columns, delimiter)


def _order(times_s: NDArray[np.float64]) -> list[str]:
    back = np.flatnonzero(~(np.diff(times_s) > 0))
    rows = f"row {int(back[0]) + 2} and {len(back) - 1} more" if len(back) else ""
    return [f"stamps do not increase at {rows}: the reader refuses the file; sort its rows"] if rows else []


def box(xyz: NDArray[np.float64], *names: str) -> str:
    """The extent of positions (n, 3) along each named axis."""
    if not len(xyz):
        return "unknown"
    ends = zip(names, xyz.min(axis=0), xyz.max(axis=0), strict=True)
    return typographic(", ".join(f"{name} {low:.1f} … {high:.1f} m" for name, low, high in ends))
