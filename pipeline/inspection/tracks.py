"""Describes text files of poses, times or calibration for `yearloc inspect`.

A path in; rows of text and warnings out. The formats are those of NCLT, KITTI and TUM.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import Trajectory
from pipeline.formats import kitti
from pipeline.inspection.inspection import Inspection, box, duration, path_length, stamp_rows
from pipeline.readers import log, vehicle
from pipeline.readers.folder import BODY_T_CAMERA, read_tum
from pipeline.readers.kitti import MAX_GAP_S, read_calibration, read_camera_poses, read_times
from pipeline.readers.nclt import Nclt, read_poses

SCAN_NS = 100_000_000
"""The time from one KITTI scan to the next."""


def describe_numbers(path: Path, inspection: Inspection) -> None:
    """Describe a text of poses or times; the count of its columns says which, else its name.

    Raises ConfigError for any other file.
    """
    words = first_row(path)
    try:
        column_count = len([float(word) for word in words])
    except ValueError:
        column_count = 0
    by_column_count = {
        1: describe_kitti_times,
        7: describe_nclt_poses,
        8: describe_tum_poses,
        12: describe_kitti_poses,
        13: describe_tum_poses,  # whose reader says what to do with such rows
    }
    by_name = {
        "groundtruth*.csv": describe_nclt_poses,
        "odometry*.csv": describe_nclt_poses,
        "times.txt": describe_kitti_times,
        "[0-9][0-9].txt": describe_kitti_poses,
    }
    describe = by_column_count.get(column_count)
    patterns = [pattern for pattern in by_name if path.match(pattern)]
    if describe is None and patterns:
        describe = by_name[patterns[0]]
    if describe is None:
        expected = "poses have 7 (NCLT), 8 (TUM) or 12 (KITTI) numbers a row, times have 1"
        raise ConfigError(f"{path}: no kind of file that inspect knows: {expected}")
    describe(path, inspection)


def first_row(path: Path) -> list[str]:
    """The words of the first row that is not a comment; empty for a file without rows."""
    with path.open(encoding="utf-8", errors="replace") as file:
        rows = (line.split("#")[0].replace(",", " ").split() for line in file)
        return next((words for words in rows if words), [])


def describe_nclt_poses(path: Path, inspection: Inspection) -> None:
    """Describe groundtruth_*.csv or odometry*.csv of NCLT.

    Rows are utime, x, y, z, roll, pitch, heading; the frames are north-east-down. The rows of
    odometry_mu.csv are motions between images, not poses. Raises LogError where the reader does.
    """
    if "cov" in path.stem:
        raise LogError(
            f"{path}: covariances, which the reader uses but inspect does not describe; inspect "
            "the odometry beside it"
        )
    is_relative = path.stem.endswith("odometry_mu")
    track = read_poses(path, Nclt().max_gap_s)
    is_finite = np.isfinite(track.world_T_body[:, 0, 0])
    north_east_down = (1, -1, -1)
    xyz_m = track.world_T_body[is_finite, :3, 3] * north_east_down + 0.0  # makes −0 a 0
    source = "wheel odometry" if path.name.startswith("odometry") else "ground truth"
    content = "motion between images" if is_relative else "poses of the body"
    rows = [
        ("rows", f"{len(is_finite):,}, of which {int((~is_finite).sum()):,} hold a NaN"),
        *stamp_rows(track.stamps_ns * 1e-9),
        ("path", path_length(xyz_m if is_relative else np.diff(xyz_m, axis=0))),
        ("frame", "north-east-down (x north, y east, z down), radians; the reader turns it z up"),
    ]
    inspection.kind = f"NCLT {source}, {content}"
    if not is_relative:
        rows.append(("box", box(xyz_m, ("north", "east", "down"))))
        inspection.warnings += vehicle.describe_faults("the poses", track)
    inspection.add("", *rows)
    warn_of_gaps(
        inspection,
        np.diff(track.stamps_ns[is_finite]) * 1e-9,
        track.max_gap_s,
        "gaps",
        "scans there have no pose and are skipped; a log with sparser rows needs max_gap_s in its "
        "dataset's yaml",
    )
    inspection.warn_if(
        not is_finite.any(),
        "every row holds a NaN: there is no pose to read; was the file written before the drive "
        "was solved?",
    )


def warn_of_gaps(
    inspection: Inspection, steps_s: NDArray[np.float64], max_gap_s: float, name: str, effect: str
) -> None:
    """Warn of `steps_s` (n,) over `max_gap_s`, which are called `name` and have this effect."""
    gap_count = int((steps_s > max_gap_s).sum())
    longest = duration(float(steps_s.max(initial=0)))
    inspection.warn_if(
        gap_count, f"{gap_count} {name} over {max_gap_s} s, the longest {longest}: {effect}"
    )


def describe_kitti_poses(path: Path, inspection: Inspection) -> None:
    """Describe poses/NN.txt: rows of 3×4 matrices, the left camera's pose in its first frame.

    Raises LogError where the reader does.
    """
    poses = read_camera_poses(path)
    xyz_m = poses[:, :3, 3]
    inspection.kind = "KITTI ground truth, poses of camera 0"
    inspection.add(
        "",
        ("poses", f"{len(poses):,}"),
        ("path", path_length(np.diff(xyz_m, axis=0))),
        ("box", box(xyz_m, ("right", "down", "forward"))),
        (
            "frame",
            "camera 0 in its first frame: x right, y down, z forward; with calib.txt's Tr the "
            "reader turns it z up",
        ),
    )
    inspection.warn_of_small_site(xyz_m, (0, 2))
    world_T_body = BODY_T_CAMERA @ poses @ BODY_T_CAMERA.T
    trajectory = Trajectory(SCAN_NS * np.arange(len(poses)), world_T_body, MAX_GAP_S)
    inspection.warnings += vehicle.describe_faults("the poses", trajectory)
    if path.parent.name == "poses" and len(path.parents) > 1:
        times_path = path.parents[1] / kitti.TIMES.format(log=path.stem)
        _warn_of_count(inspection, times_path, len(poses))


def _warn_of_count(inspection: Inspection, times_path: Path, pose_count: int) -> None:
    """Warn if the file of times of a KITTI log exists, but has not as many rows as the poses."""
    if not times_path.is_file():
        return
    count = len(log.read_table(times_path, 1))
    inspection.warn_if(
        count != pose_count,
        f"{count} times in {times_path} for {pose_count} poses: the reader refuses the log; one is "
        "cut short",
    )


def describe_tum_poses(path: Path, inspection: Inspection) -> None:
    """Describe a TUM trajectory: stamp in s, x, y, z in m, quaternion x, y, z, w."""
    stamps_ns, poses = read_tum(path)
    is_finite = np.isfinite(poses).all(axis=(1, 2))
    xyz_m = poses[is_finite, :3, 3]
    nan_count = int((~is_finite).sum())
    rows_text = f"{len(stamps_ns):,}"
    if nan_count:
        rows_text += f", of which {nan_count:,} hold a NaN: gaps"
    inspection.kind = "TUM trajectory"
    inspection.add(
        "",
        ("rows", rows_text),
        *stamp_rows(stamps_ns * 1e-9),
        ("path", path_length(np.diff(xyz_m, axis=0))),
        ("box", box(xyz_m, "xyz")),
        ("frame", "as the file has it; conf/dataset/folder.yaml's poses_frame says which"),
    )
    inspection.warn_of_small_site(xyz_m)
    inspection.warnings += vehicle.describe_faults(
        "the poses", Trajectory(stamps_ns, poses, MAX_GAP_S)
    )


def describe_kitti_times(path: Path, inspection: Inspection) -> None:
    """Describe times.txt: seconds from the start of the log, one row per scan."""
    stamps_ns = read_times(path)
    inspection.kind = "KITTI times"
    inspection.add("", ("rows", f"{len(stamps_ns):,}"), *stamp_rows(stamps_ns * 1e-9))


def describe_kitti_calib(path: Path, inspection: Inspection) -> None:
    """Describe calib.txt: camera projections P0–P3, and Tr, the Velodyne's pose in camera 0."""
    cam_T_velo = read_calibration(path)
    lines = path.read_text(encoding="utf-8").splitlines()
    camera_m = -cam_T_velo[:3, :3].T @ cam_T_velo[:3, 3]
    inspection.kind = "KITTI calibration"
    inspection.add(
        "",
        ("entries", ", ".join(line.partition(":")[0] for line in lines if ":" in line)),
        ("camera 0", "at x {:.3f}, y {:.3f}, z {:.3f} m in the Velodyne's frame".format(*camera_m)),
        (
            "frame",
            "Tr maps Velodyne coordinates (x forward, y left, z up) into camera 0's (x right, y "
            "down, z forward)",
        ),
    )
