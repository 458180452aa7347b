"""Opens a log whose poses are to be estimated, for `yearloc slam`: a path in; a Log out.

The log may be a bag, a log as a data set ships it, or a folder of clouds alone. Its reader is
chosen by what lies at the path, and its settings as `yearloc inspect` would propose them.
"""

from collections.abc import Sequence
from pathlib import Path

from pipeline.core.errors import LogError
from pipeline.formats import carmen
from pipeline.formats import folder as files
from pipeline.formats.bag_file import find
from pipeline.formats.robotcar import LASERS
from pipeline.inspection.bag_contents import Contents
from pipeline.inspection.bag_proposal import drifting, gyroscope, points_source
from pipeline.readers.bag import Bag
from pipeline.readers.folder import Folder
from pipeline.readers.keyframes import FILE, KeyFrames
from pipeline.readers.kitti import Kitti
from pipeline.readers.log import Log
from pipeline.readers.mounting import BODIES
from pipeline.readers.nclt import Nclt

ODOMETRY_FILES = ("odometry.txt", "odom.txt")
"""Names of files beside clouds that may hold their odometry."""


def open_unposed(path: Path, topic: str | None = None, odometry: str | None = None) -> Log:
    """Open the log at a path, with all of its scans and without true poses.

    For a bag with several sources, `topic` names that of the clouds and `odometry` that of the
    odometry. Raises LogError if there is no log, or one of level sweeps.
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
    """Open a folder of clouds alone, numbered or named by time; raises LogError without clouds."""
    for scans in (".", *files.SCAN_FOLDERS):
        folder = path / scans
        if folder.is_dir() and any(file.suffix in files.SCANS for file in folder.iterdir()):
            odometry = next((name for name in ODOMETRY_FILES if (path / name).is_file()), None)
            return Folder(scans=scans, poses=None, odometry=odometry).open(path.parent, path.name)
    raise LogError(
        f"{path}: no log: neither a bag nor clouds ({', '.join(files.SCANS)}) in it or in "
        f"{', '.join(files.SCAN_FOLDERS)}"
    )


def _bag(path: Path, bags: list[Path], topic: str | None, odometry: str | None) -> Log:
    """Open the clouds of a bag, with its odometry, or without any with its IMU."""
    contents = Contents.read(bags)
    topics = {summary.name: summary for summary in contents.topics}
    points = topic or points_source(contents, None).name
    lidar_frame = topics[points].frame if points in topics else ""
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
    reader = Bag(
        points=points,
        truth=None,
        odometry=odometry,
        imu=imu.name if imu else None,
        body_T_lidar=_body_T_lidar(contents, bodies, lidar_frame),
    )
    return reader.open(path.parent, path.stem if path.is_file() else path.name)


def _body_T_lidar(contents: Contents, bodies: Sequence[str], lidar_frame: str) -> tuple[float, ...]:
    """The x, y, z in metres and roll, pitch, yaw in degrees of the LiDAR in the vehicle.

    The vehicle is the first of the frames `bodies` from which fixed transforms lead to the LiDAR;
    without any, the LiDAR is the vehicle.
    """
    from scipy.spatial.transform import Rotation

    body_T_lidar = contents.transforms.body_T_lidar(bodies, {lidar_frame})
    if body_T_lidar is None:
        return (0.0,) * 6
    angles_deg = Rotation.from_matrix(body_T_lidar[:3, :3]).as_euler("xyz", degrees=True)
    return (*body_T_lidar[:3, 3].tolist(), *angles_deg.tolist())
