"""Opens a drive that a user names by a path: a path in; its reader, root and sequence out.

What lies there decides which reader opens it. `yearloc inspect` opens a drive as it is, `yearloc
slam` without true poses (`unposed`), and the commands that ask a site as the reader of the site's
data set does (`by_reader`).
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.core.errors import LogError, YearlocError
from pipeline.core.frames import Poses, rpy
from pipeline.formats import carmen, nclt
from pipeline.formats import folder as files
from pipeline.formats.bag_file import find
from pipeline.formats.robotcar import LASERS
from pipeline.opening.bag_contents import Contents, drifting, gyroscope, points_source
from pipeline.readers import keyframes
from pipeline.readers.bag import Bag
from pipeline.readers.carmen import Carmen
from pipeline.readers.folder import Folder
from pipeline.readers.keyframes import KeyFrames
from pipeline.readers.kitti import Kitti
from pipeline.readers.log import Log, Reader
from pipeline.readers.mounting import BODIES
from pipeline.readers.nclt import Nclt
from pipeline.readers.robotcar import RobotCar

KEY_FRAMES = "key frames"
OTHER_ROBOT = "another robot's"
"""Names of the data sets that the readers KeyFrames and Folder open."""
ODOMETRY_FILES = ("odometry.txt", "odom.txt")
"""Names of files beside clouds that may hold their odometry."""


@dataclass(frozen=True)
class Opening:
    """A drive on disk, and the reader that opens it."""

    data_set: str
    """The name of the data set whose format it has."""
    reader: Reader
    root: Path
    """The folder of the data set."""
    sequence: str
    """The name of the drive in it."""
    notes: tuple[str, ...] = ()
    """Lines for the user on how it is opened."""

    def open(self) -> Log:
        """Its clouds, odometry and poses, and what was left out and why.

        Raises LogError if the reader cannot read it.
        """
        log = self.reader.open(self.root, self.sequence)
        return replace(log, notes=(*log.notes, *self.notes))


def at(path: Path) -> Opening | None:
    """The drive of a known data set at a path, by the names there.

    None for bags, for clouds alone, and for what is no drive.
    """
    path = path.resolve()
    root = path.parent
    if (path / nclt.SCANS).is_dir():
        return Opening("NCLT", Nclt(), root, path.name)
    if (path / "velodyne").is_dir():
        return Opening("KITTI", Kitti(), path.parents[1], path.name)
    if lasers := [laser for laser in LASERS if (path / laser).is_dir()]:
        return Opening("RobotCar", RobotCar(lasers), root, path.name)
    if (path / keyframes.FILE).is_file():
        return Opening(KEY_FRAMES, KeyFrames(), root, path.name)
    if path.is_file() and path.name.endswith(carmen.SUFFIXES):
        return Opening("CARMEN", Carmen(), root, _without_suffix(path.name))
    return None


def by_reader(path: Path, reader: Reader) -> Log | None:
    """Open the drive at a path as `reader` knows it; None if it cannot.

    The root of the data set may be the parent of the path, or that one's.
    """
    path = path.resolve()
    sequence = _without_suffix(path.name)
    for root in (path.parent, *path.parents[1:2]):
        with suppress(YearlocError, OSError):
            if reader.sequences(root).get(sequence) == []:
                return reader.open(root, sequence)
    return None


def unposed(path: Path, topic: str | None = None, odometry: str | None = None) -> Log:
    """Open the drive at a path, with all of its scans and without true poses.

    For a bag with several sources, `topic` names that of the clouds and `odometry` that of the
    odometry. Raises LogError if there is no drive, or one of level sweeps.
    """
    path = path.expanduser()
    if not path.exists():
        raise LogError(f"{path}: no such file or folder")
    path = path.resolve()
    if bags := find(path):
        return _bag(path, bags, topic, odometry).open()
    drive = at(path)
    reader = drive.reader if drive else None
    if isinstance(reader, Carmen):
        raise LogError(
            f"{path}: sweeps of a level 2-D LiDAR, of which no poses are estimated here; another "
            "program's poses can stand beside them"
        )
    if path.is_file():
        raise LogError(
            f"{path}: one file is no log: expected a bag, the folder of a log, or a folder of "
            f"clouds ({', '.join(files.SCANS)})"
        )
    if isinstance(reader, RobotCar):
        raise LogError(
            f"{path}: sweeps of 2-D LiDARs, of which no poses are estimated here; its own "
            "odometry, vo/vo.csv, has poses"
        )
    if isinstance(reader, Nclt):
        return Nclt(max_gap_s=3.0, poses=False).open(path.parent, path.name)
    if isinstance(reader, Kitti) and (path / files.TIMES).is_file():
        return Kitti(poses=False).open(path.parents[1], path.name)
    if isinstance(reader, KeyFrames):
        return reader.open(path.parent, path.name)
    return _clouds(path).open()


def scan_files(path: Path) -> list[Path]:
    """The scan files in a folder, or else in the first of SCAN_FOLDERS in it that has some."""
    for folder in (path, *(path / name for name in files.SCAN_FOLDERS)):
        scans = [file for file in folder.glob("*") if file.suffix in files.SCANS]
        scans = [file for file in scans if file.name != nclt.PACKETS]
        if scans:
            return scans
    return []


def _without_suffix(name: str) -> str:
    """The name of a drive, without the suffix that a CARMEN log may have."""
    suffix = next((suffix for suffix in carmen.SUFFIXES if name.endswith(suffix)), "")
    return name.removesuffix(suffix)


def _clouds(path: Path) -> Opening:
    """A folder of clouds alone, numbered or named by time; raises LogError without clouds."""
    scans = scan_files(path)
    if not scans:
        raise LogError(
            f"{path}: no log: neither a bag nor clouds ({', '.join(files.SCANS)}) in it or in "
            f"{', '.join(files.SCAN_FOLDERS)}"
        )
    odometry = next((name for name in ODOMETRY_FILES if (path / name).is_file()), None)
    folder = str(scans[0].parent.relative_to(path))
    reader = Folder(scans=folder, poses=None, odometry=odometry)
    return Opening("clouds", reader, path.parent, path.name)


def _bag(path: Path, bags: list[Path], topic: str | None, odometry: str | None) -> Opening:
    """The clouds of a bag, with its odometry, or without any with its IMU."""
    contents = Contents.read(bags)
    topics = {summary.name: summary for summary in contents.topics}
    points = topic or points_source(contents, None).name
    if not odometry:
        source = drifting(contents)
        odometry = source.name if source else None
    imu = None
    child = ""
    if not odometry:
        imu = gyroscope(contents)
    elif odometry in topics:
        child = topics[odometry].child
    else:  # tf:PARENT>CHILD
        child = odometry.rpartition(">")[2]
    bodies = (child, *BODIES) if child else BODIES
    lidar_frames = {topics[points].frame} if points in topics else set()
    body_T_lidar = contents.transforms.body_T_lidar(bodies, lidar_frames)
    notes: tuple[str, ...] = ()
    if odometry and body_T_lidar is None:
        notes = (
            f"no fixed transforms lead from {child or 'the frame'} of {odometry} to "
            f"{', '.join(lidar_frames)}: the LiDAR is taken for the vehicle",
        )
    reader = Bag(
        points=points,
        ground_truth=None,
        odometry=odometry,
        imu=imu.name if imu else None,
        body_T_lidar=_numbers(body_T_lidar),
    )
    sequence = path.stem if path.is_file() else path.name
    return Opening("bag", reader, path.parent, sequence, notes)


def _numbers(body_T_lidar: Poses | None) -> Sequence[float]:
    """x, y, z in metres and roll, pitch, yaw in degrees of a pose (4, 4); 0 where it is unknown."""
    if body_T_lidar is None:
        return (0.0,) * 6
    angles_deg = np.rad2deg(rpy(body_T_lidar[None])[0])
    return (*body_T_lidar[:3, 3].tolist(), *angles_deg.tolist())
