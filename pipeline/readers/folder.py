"""Reads a drive of the user's own robot, a folder of scan files and a pose file, as a Log.

A sequence has one of two layouts:

    ROOT/SEQUENCE/scans/1326652795.280148.pcd …    scans named by their stamps
    ROOT/SEQUENCE/poses.txt                        TUM poses of any rate

    ROOT/SEQUENCE/scans/000000.bin …               scan n belongs to row n of both files below
    ROOT/SEQUENCE/poses.txt                        KITTI poses
    ROOT/SEQUENCE/times.txt                        a time for each pose

Frames and units are settings; conf/dataset/folder.yaml explains them.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import Poses, Stamps, Trajectory, transformed
from pipeline.core.settings import Positive, checked
from pipeline.formats import bin_layout, kitti
from pipeline.formats import folder as files
from pipeline.readers import log
from pipeline.readers.log import Log

BODY_T_CAMERA = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Turns axes x right, y down, z forward into x forward, y left, z up."""
MAX_EXAMPLES = 20
"""The bytes of a point are found from the content of at most this many files."""
FARTHEST_M = 1e6
"""Points beyond this are dropped: no lidar sees 1,000 km."""


@dataclass(frozen=True)
@checked("reader")
class Folder:
    """A root with one folder per sequence, each with scans and poses."""

    scans: str = "scans"
    """Below the sequence: a subfolder with .bin, .npy and .pcd scans, or a pattern such as
    clouds/*.pcd; a dot for the sequence's own folder."""
    poses: str | None = "poses.txt"
    """Below the sequence: the true poses of the body. None: all scans are taken, without poses;
    then the name of a scan ends in a stamp of any unit, or in a number that is taken as seconds."""
    poses_format: Literal["tum", "kitti"] = "tum"
    """Format of both pose files."""
    poses_frame: Literal["body", "camera"] = "body"
    """Axes of both pose files: body is x forward, y left, z up; camera is x right, y down, z
    forward."""
    odometry: str | None = None
    """Below the sequence: the body's poses by odometry, in the same format; a row of NaN is a break
    in the odometry."""
    stamps: Literal["s", "us", "ns"] = "s"
    """Unit of the scans' names beside TUM poses; beside KITTI poses, names are row numbers from
    0."""
    point_bytes: int = 0
    """Bytes of a point in a .bin, which begins with x, y, z as 32-bit floats; 0: they are found
    from the content of the files."""
    body_T_lidar: Sequence[float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """x, y, z in metres and roll, pitch, yaw in degrees of the lidar in the body's frame."""
    lift_m: float = 0.0
    """Height of the origin of the body above the ground, added to z."""
    max_gap_s: Positive = 0.5
    """Poses further apart than this are a gap; a scan in it is skipped."""

    def __post_init__(self) -> None:
        if self.point_bytes and self.point_bytes < 12:
            raise ConfigError(
                f"reader.point_bytes={self.point_bytes}: expected 12 or more, x, y and z first, or "
                "0"
            )
        log.parse_extrinsic("reader.body_T_lidar", self.body_T_lidar)
        for name in ("scans", "poses", "odometry"):
            place = getattr(self, name)
            if place is None and name != "scans":
                continue
            if not _is_below(place):
                raise ConfigError(
                    f"reader.{name}={place}: expected a path below the sequence's folder"
                )

    def open(self, root: Path, sequence: str) -> Log:
        """Open a sequence below `root`; raises LogError if it cannot be read."""
        folder = root / sequence
        skipped = Counter[str]()
        if not folder.is_dir():
            raise LogError(f"{folder}: no such folder of a sequence")
        ground_truth = None if self.poses is None else self._trajectory(folder, self.poses)
        odometry = None if self.odometry is None else self._trajectory(folder, self.odometry)
        pose_stamps_ns = np.empty(0, np.int64) if ground_truth is None else ground_truth.stamps_ns

        # the scan files that can be used, by stamp
        scan_paths = sorted(self._scan_files(folder))
        width, width_notes = self._width(scan_paths)
        path_by_stamp = self._usable_files(folder, scan_paths, width, pose_stamps_ns, skipped)
        stamps_ns = np.array(sorted(path_by_stamp), np.int64)

        # the scans that have a pose
        question = f"is reader.stamps={self.stamps} the unit of the scans' names?"
        posed = log.rows_with_poses(
            folder,
            stamps_ns,
            ground_truth=ground_truth,
            odometry=odometry,
            skipped=skipped,
            question=question,
        )
        stamps_ns = stamps_ns[posed.rows]
        posed_paths = [path_by_stamp[stamp] for stamp in stamps_ns.tolist()]

        body_T_lidar = log.parse_extrinsic("reader.body_T_lidar", self.body_T_lidar)
        vehicle_T_lidar = log.raised(self.lift_m) @ body_T_lidar
        return Log(
            stamps_ns=stamps_ns,
            world_T_scan=log.lifted(posed.world_T_scan, self.lift_m),
            odom_T_scan=log.lifted(posed.odom_T_scan, self.lift_m),
            points=lambda row: read_scan(posed_paths[row], vehicle_T_lidar, width),
            skipped=+skipped,  # without the reasons that were counted as 0
            notes=width_notes + posed.notes,
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        """The sequences below `root`, each with the files that it lacks."""
        needed_files = [self.poses, self.odometry]
        if self.poses and self.poses_format == "kitti":
            needed_files.insert(1, files.TIMES)
        names = sorted(
            path.name for path in root.glob("*") if path.is_dir() and self._scan_files(path)
        )
        return {
            name: [file for file in needed_files if file and not (root / name / file).is_file()]
            for name in names
        }

    def _scan_files(self, folder: Path) -> list[Path]:
        """The scan files of a sequence, in any order."""
        is_pattern = "*" in self.scans or "?" in self.scans
        paths = folder.glob(self.scans if is_pattern else f"{self.scans}/*")
        return [path for path in paths if path.suffix in files.SCANS]

    def _width(self, paths: Sequence[Path]) -> tuple[int | None, tuple[str, ...]]:
        """Bytes of a point in the .bin files or None, and a note where they are a guess."""
        bin_files = (
            path
            for path in paths
            if path.suffix == ".bin"
            and path.is_file()
            and 0 < path.stat().st_size <= files.LARGEST_BYTES
        )
        guess: tuple[int, Path] | None = None
        for path in islice(bin_files, MAX_EXAMPLES):
            data = path.read_bytes()
            bin_layout.refuse_planar(data, path)
            if self.point_bytes:
                return self.point_bytes, ()
            width, is_certain = bin_layout.width_of(data)
            if width and is_certain:
                return width, ()
            if width and guess is None:
                guess = (width, path)
        if self.point_bytes or guess is None:
            return self.point_bytes or None, ()
        width, path = guess
        return width, (
            f"{path.name} fits points of several sizes: {width} bytes are assumed; say "
            "reader.point_bytes",
        )

    def _usable_files(
        self,
        folder: Path,
        scan_paths: Sequence[Path],
        width: int | None,
        pose_stamps_ns: Stamps,
        skipped: Counter[str],
    ) -> dict[int, Path]:
        """The scan files that can be used, by stamp in ns; `width` is the bytes of a point."""
        name_fault = "file name is no stamp"
        if self.poses_format == "kitti":
            name_fault = "file name is no row of the poses"
        path_by_stamp: dict[int, Path] = {}
        for path in scan_paths:
            stamp_ns = self._stamp_ns(path.stem, pose_stamps_ns)
            if stamp_ns is None or not path.is_file():
                skipped[name_fault] += 1
            elif not path.stat().st_size:
                skipped["empty file"] += 1
            elif path.suffix == ".bin" and width and path.stat().st_size % width:
                skipped["truncated record"] += 1
            elif stamp_ns in path_by_stamp:
                skipped["a second file of one stamp"] += 1
            else:
                path_by_stamp[stamp_ns] = path
        if not path_by_stamp:
            raise LogError(
                f"{folder}: holds no readable scan in {self.scans} (named by "
                f"{self._naming()}; .bin, .npy or .pcd{self._naming_hint(scan_paths)})"
            )
        return path_by_stamp

    def _stamp_ns(self, stem: str, pose_stamps_ns: Stamps) -> int | None:
        """The stamp in ns of a scan by its file's name without suffix; None for a wrong name."""
        if self.poses is None:
            return files.stamp_at_end(stem)
        points_allowed = 1 if self.stamps == "s" else 0
        is_number = stem.isascii() and stem.replace(".", "", points_allowed).isdecimal()
        if not is_number or len(stem) > 40:  # so long a number would be slow to convert
            return None
        if self.poses_format == "tum":
            return files.parse_stamp_ns(stem, self.stamps)
        if stem.isdecimal() and int(stem) < len(pose_stamps_ns):
            return int(pose_stamps_ns[int(stem)])
        return None

    def _naming(self) -> str:
        """How scans are to be named, for an error."""
        if self.poses is None:
            return "a number or a stamp at the end"
        if self.poses_format == "kitti":
            return "row numbers of the poses"
        return f"stamps in {self.stamps}"

    def _naming_hint(self, scan_paths: Sequence[Path]) -> str:
        """An example of a wrong name, and the setting that may help; empty without a file."""
        if not scan_paths:
            return ""
        hint = f"; {scan_paths[0].name} is none"
        unit = files.unit_of(scan_paths[0].stem)
        if self.poses and unit in files.UNIT_NS and unit != self.stamps:
            hint += f": is it in {unit}? Then say reader.stamps={unit} in the dataset's yaml"
        return hint

    def _trajectory(self, folder: Path, place: str) -> Trajectory:
        """The poses of the body in a pose file of a sequence."""
        path = folder / place
        if self.poses_format == "tum":
            stamps_ns, poses = read_tum(path)
        else:
            stamps_ns, poses = read_kitti(path, folder / files.TIMES)
        if self.poses_frame == "camera":
            poses = BODY_T_CAMERA @ poses @ BODY_T_CAMERA.T
        return Trajectory(stamps_ns, poses, self.max_gap_s)


def read_scan(
    path: Path, vehicle_T_lidar: NDArray[np.float64], point_bytes: int | None = None
) -> NDArray[np.float64]:
    """Points (n, 3) in metres of one .bin, .npy or .pcd, in the vehicle frame.

    `point_bytes` are the bytes of a point in a .bin; None: they are found from its content. Points
    that are not finite or lie beyond FARTHEST_M are dropped. Raises LogError for a missing or
    damaged file.
    """
    points = files.points(log.read_bytes(path, 1, "bytes"), path, point_bytes)
    points = points[(np.abs(points) < FARTHEST_M).all(axis=1)]
    return transformed(vehicle_T_lidar, points)


def read_tum(path: Path) -> tuple[Stamps, Poses]:
    """Stamps (n,) and poses (n, 4, 4) of a TUM file, NaN where a row has NaN.

    Raises LogError naming the wrong row.
    """
    stamps, rows = files.parse_tum(
        path, log.read_bytes(path, 1, "bytes").decode("utf-8-sig", "replace")
    )
    if not stamps:
        raise LogError(f"{path}: holds no rows")
    stamps_ns = np.array(stamps, np.int64)
    backward_steps = np.flatnonzero(np.diff(stamps_ns) <= 0)
    if len(backward_steps):
        row = backward_steps[0] + 1
        raise LogError(
            f"{path}: row {row + 1} is stamped {stamps_ns[row] / 1e9:.9f} s, not after the row "
            "before it"
        )
    return stamps_ns, from_quaternions(path, rows)


def read_pose_rows(path: Path, count: int) -> Poses | None:
    """Poses (count, 4, 4) of a file of one row a scan, the 12 numbers of KITTI, NaN where unknown.

    It is None if the first row has not 12 numbers. Raises LogError for another count of rows, and
    for a row that is not 12 numbers.
    """
    text = log.read_bytes(path, 1, "bytes").decode("utf-8-sig", "replace")
    rows = [words for line in text.splitlines() if (words := line.split("#")[0].split())]
    if not rows or len(rows[0]) != 12:
        return None
    if len(rows) != count:
        raise LogError(f"{path}: {len(rows)} rows of poses for {count} scans; expected one a scan")
    try:
        numbers = np.array([[float(word) for word in words] for words in rows])
    except ValueError:
        raise LogError(f"{path}: expected 12 numbers in each row, as KITTI's poses have") from None
    poses: Poses = kitti.to_poses(numbers)
    return poses


def from_quaternions(path: Path, rows: NDArray[np.float64]) -> Poses:
    """Poses (n, 4, 4) from rows (n, 7) of x y z in metres and qx qy qz qw.

    A row with NaN becomes a NaN pose. Raises LogError naming a wrong row of the file `path`.
    """
    is_finite: NDArray[np.bool_] = np.all(np.isfinite(rows), axis=1)
    norms = np.linalg.norm(rows[:, 3:].clip(-2, 2), axis=1)  # clipped, or they could overflow
    bad_rows = np.flatnonzero(is_finite & ~(np.abs(norms - 1) < 1e-3))  # files round their numbers
    if len(bad_rows):
        raise LogError(
            f"{path}: row {bad_rows[0] + 1} has a quaternion qx qy qz qw whose length is not 1"
        )
    poses = np.full((len(rows), 4, 4), np.nan)
    poses[is_finite] = np.eye(4)
    if is_finite.any():
        poses[is_finite, :3, :3] = Rotation.from_quat(rows[is_finite, 3:]).as_matrix()
    poses[is_finite, :3, 3] = rows[is_finite, :3]
    log.refuse_poses(path, poses, is_finite)
    return poses


def read_kitti(path: Path, times_path: Path) -> tuple[Stamps, Poses]:
    """Stamps (n,) and poses (n, 4, 4) of a KITTI pose file and its times.txt.

    NaN where a row has NaN. Raises LogError for files that do not fit each other or are damaged.
    """
    rows = log.read_table(path, 12)
    times_s = log.read_table(times_path, 1)[:, 0]
    if len(rows) != len(times_s):
        raise LogError(f"{times_path}: {len(times_s)} times for {len(rows)} poses in {path}")
    poses = kitti.to_poses(rows)
    is_finite: NDArray[np.bool_] = np.all(np.isfinite(rows), axis=1)
    log.refuse_poses(path, poses, is_finite)
    poses[~is_finite] = np.nan
    return log.to_nanoseconds(times_path, times_s, "s", 10**9), poses


def _is_below(place: object) -> bool:
    """Whether a setting is a path or pattern that stays below the folder that it starts from."""
    if not isinstance(place, str) or not place or place[0] == "/":
        return False
    return not {"..", "**"} & set(Path(place).parts)
