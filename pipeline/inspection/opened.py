"""Opens a log without true poses, for `yearloc slam`: a path in; a `Log` of any reader out.

It may be a bag, a log as a data set ships it, or a folder of clouds alone.
"""

from pathlib import Path

from pipeline.core.errors import LogError
from pipeline.formats import carmen
from pipeline.formats import folder as files
from pipeline.formats.bag_file import find
from pipeline.formats.robotcar import LASERS
from pipeline.inspection.bag_contents import Contents
from pipeline.inspection.bag_proposal import drifting, gyroscope, points_source
from pipeline.readers.bag import Bag
from pipeline.readers.bag_poses import Tree
from pipeline.readers.folder import Folder
from pipeline.readers.keyframes import FILE, KeyFrames
from pipeline.readers.kitti import Kitti
from pipeline.readers.log import Log
from pipeline.readers.nclt import Nclt

SCANS = ("scans", "points", "clouds", "velodyne", "velodyne_sync")
"""Folders of a log that may hold its scan files."""
BODIES = ("base_footprint", "base_link", "body", "imu", "imu_link")
"""Frames of a bag that may stand for the vehicle, the likeliest first."""
ODOMETRY = ("odometry.txt", "odom.txt")
"""Files beside clouds that may hold their odometry."""


def open_unposed(path: Path, topic: str | None = None, odometry: str | None = None) -> Log:
    """The log at a path with all of its scans, whether they have true poses or not.

    `topic` and `odometry` are of a bag, where it has several clouds or sources of poses. Raises
    LogError where there is no log, or one of level sweeps.
    """
    path = path.expanduser()
    if not path.exists():
        raise LogError(f"{path}: no such file or folder")
    path = path.resolve()
    if bags := find(path):
        return _bag(path, bags, topic, odometry)
    if path.is_file() and path.name.endswith(carmen.SUFFIXES):
        raise LogError(
            f"{path}: sweeps of a level 2-D LiDAR, of which no poses are estimated here; another "
            "program's poses can stand beside them"
        )
    if path.is_file():
        raise LogError(
            f"{path}: one file is no log: expected a bag, the folder of a log, or a folder of "
            f"clouds ({', '.join(files.SCANS)})"
        )
    if any((path / laser).is_dir() for laser in LASERS):
        raise LogError(
            f"{path}: sweeps of 2-D LiDARs, of which no poses are estimated here; its own "
            "odometry, vo/vo.csv, has poses"
        )
    if (path / "velodyne_sync").is_dir():
        return Nclt(max_gap_s=3.0, poses=False).open(path.parent, path.name)
    if (path / "velodyne").is_dir() and (path / files.TIMES).is_file():
        return Kitti(poses=False).open(path.parents[1], path.name)
    if (path / FILE).is_file():
        return KeyFrames().open(path.parent, path.name)
    return _clouds(path)


def _clouds(path: Path) -> Log:
    """A folder of clouds alone, numbered or named by time."""
    folders_of_clouds = (
        name
        for name in (".", *SCANS)
        if (path / name).is_dir()
        and any(file.suffix in files.SCANS for file in (path / name).iterdir())
    )
    scans = next(folders_of_clouds, None)
    if scans is None:
        raise LogError(
            f"{path}: no log: neither a bag nor clouds ({', '.join(files.SCANS)}) in it or in "
            f"{', '.join(SCANS)}"
        )
    odometry = next((name for name in ODOMETRY if (path / name).is_file()), None)
    return Folder(scans=scans, poses=None, odometry=odometry).open(path.parent, path.name)


def _bag(path: Path, bags: list[Path], topic: str | None, odometry: str | None) -> Log:
    """A bag's clouds, with the odometry that it has or that is named, else with its IMU."""
    contents = Contents.read(bags)
    points = topic or points_source(contents, None).name
    topics = {summary.name: summary for summary in contents.topics}
    source = drifting(contents)
    name = odometry or (source.name if source else None)
    # of tf:PARENT>CHILD, the transform's child
    child = topics[name].child if name in topics else (name or "").rpartition(">")[2]
    frame = topics[points].frame if points in topics else ""
    body_T_lidar = _extrinsic(contents.tree, [child, *BODIES], frame)
    imu = None if name else gyroscope(contents)
    reader = Bag(
        points=points,
        truth=None,
        odometry=name,
        imu=imu.name if imu else None,
        body_T_lidar=body_T_lidar,
    )
    return reader.open(path.parent, path.stem if path.is_file() else path.name)


def _extrinsic(tree: Tree, bodies: list[str], frame: str) -> tuple[float, ...]:
    """x, y, z and roll, pitch, yaw of the LiDAR in the first body that fixed transforms know."""
    from scipy.spatial.transform import Rotation

    for body in filter(None, bodies):
        body_T_lidar = tree.fixed(body, frame)
        if body_T_lidar is not None:
            angles = Rotation.from_matrix(body_T_lidar[:3, :3]).as_euler("xyz", degrees=True)
            return (*body_T_lidar[:3, 3].tolist(), *angles.tolist())
    return (0.0,) * 6
