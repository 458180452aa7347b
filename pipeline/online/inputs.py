"""Scans to localise, from files, folders, logs, ROS bags and standard input.

Each is read only when its points are asked for.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.building import build
from pipeline.core.errors import ConfigError, LogError, YearlocError
from pipeline.core.frames import Poses, Stamps
from pipeline.formats import bin_layout, carmen, folder, nclt
from pipeline.formats.bag import CLOUD, SWEEP
from pipeline.formats.bag_file import BagFile, find
from pipeline.readers import vehicle
from pipeline.readers.bag_clouds import Clouds
from pipeline.readers.bag_poses import KINDS, Tree, track
from pipeline.readers.deskew import NO_BREAKS, scan_at_stamp
from pipeline.readers.log import Log, raised
from pipeline.readers.log import extrinsic as given_extrinsic

READERS = ("pipeline.readers.",)
SCANS = ("velodyne_sync", "velodyne", "scans", "points")
"""Folders of a log that may hold its scan files."""
BODIES = ("base_footprint", "base_link", "body", "imu", "imu_link")
"""Frames that stand for the vehicle, the first that a bag's fixed transforms know."""
NO_POSE = np.full((4, 4), np.nan)
ODOMETRY_GAP_S = 1.0
"""Odometry is not interpolated over more."""


@dataclass(frozen=True)
class Scan:
    """A scan to localise, whose points are read only when asked for."""

    name: str
    stamp_ns: int | None
    """None of a file whose name is no time."""
    points: Callable[[], NDArray[np.float64]]
    """Reads the points (n, 3) in metres, x forward, y left, z up, ground at z = 0, as they lay at
    the stamp where the log has odometry and the times of points; raises LogError for a damaged
    scan."""
    odom_T_scan: NDArray[np.float64]
    """(4, 4) by the log's odometry, NaN where there is none."""
    world_T_scan: NDArray[np.float64]
    """(4, 4) true pose, NaN where it is unknown."""
    recording: str = ""
    """What the scan was read from: another recording has another odometry."""
    body_T_lidar: Poses | None = None
    """(4, 4) by which the points were placed; None of a log, which its reader places."""


def scans(
    source: str,
    reader: Mapping[str, Any],
    lift_m: float,
    topic: str | None = None,
    odometry: str | None = None,
    skipped: Counter[str] | None = None,
    body_T_lidar: Poses | None = None,
    is_level: bool = False,
) -> Iterator[Scan]:
    """The scans of a path, or of standard input for `-`; if `is_level`, the sweeps of bags.

    A log that the site's own reader can open has its poses with it. Otherwise files and messages
    are taken as x forward, y left, z up, and raised by `lift_m`; or placed by `body_T_lidar` (4,
    4), then also in place of a bag's transforms. Of a bag, `odometry` is a topic of poses or
    tf:PARENT>CHILD. What a log or a bag leaves out is counted in `skipped`, by reason. Raises
    LogError where there is no scan, ConfigError for a topic that a bag has not.
    """
    file_body_T_lidar = raised(lift_m) if body_T_lidar is None else body_T_lidar
    if source == "-":
        data = sys.stdin.buffer.read(folder.LARGEST_BYTES + 1)
        yield _unposed(
            "-", None, lambda: decoded(data, Path("standard input.bin")), file_body_T_lidar
        )
        return
    path = Path(source).expanduser()
    skipped = Counter() if skipped is None else skipped
    if not path.exists():
        raise LogError(f"{source}: no such file or folder")
    if log := _log(path.resolve(), reader):
        skipped.update(log.skipped)
        for row, stamp_ns in enumerate(log.stamps_ns.tolist()):
            points = _of_log(log, row)
            yield Scan(
                f"{path.name} {row}",
                stamp_ns,
                points,
                log.odom_T_scan[row],
                log.world_T_scan[row],
                str(path),
            )
    elif bags := find(path):
        yield from _messages(
            path,
            [BagFile(bag) for bag in bags],
            topic,
            odometry,
            lift_m,
            skipped,
            body_T_lidar,
            SWEEP if is_level else CLOUD,
        )
    else:
        files = [path] if path.is_file() else _files(path)
        for file in files:
            yield _unposed(file.name, _stamp_ns(file.stem), _of_file(file), file_body_T_lidar)


def is_log(source: str, reader: Mapping[str, Any]) -> bool:
    """Whether the site's own reader opens a path; it then raises the points, whatever `lift_m`."""
    return source != "-" and _log(Path(source).expanduser().resolve(), reader) is not None


def decoded(data: bytes, path: Path) -> NDArray[np.float64]:
    """Points (n, 3) of a scan file's bytes; a .bin may be NCLT's.

    Raises LogError for a damaged one.
    """
    if (
        path.suffix == ".bin"
        and len(data) <= folder.LARGEST_BYTES
        and bin_layout.point_bytes(data) == bin_layout.NCLT_BYTES
    ):
        return np.asarray(nclt.decode(np.frombuffer(data, "<u2")))
    return folder.points(data, path)


def _unposed(
    name: str, stamp_ns: int | None, points: Callable[[], NDArray[np.float64]], body_T_lidar: Poses
) -> Scan:
    return Scan(
        name, stamp_ns, lambda: placed(points(), body_T_lidar), NO_POSE, NO_POSE, name, body_T_lidar
    )


def placement(key: str, text: str) -> Poses:
    """Parse the pose (4, 4) of a lidar in the body: x,y,z,roll,pitch,yaw in metres and degrees.

    Raises ConfigError naming `key`.
    """
    try:
        return given_extrinsic(key, [float(word) for word in text.split(",")])
    except (ValueError, ConfigError):
        raise ConfigError(
            f"{key}={text:.60}: expected x,y,z,roll,pitch,yaw in metres and degrees"
        ) from None


def placed(points_m: NDArray[np.floating], body_T_lidar: Poses) -> NDArray[np.float64]:
    """Transform points (n, 3) of a lidar into the frame of the body, by a pose (4, 4)."""
    return np.asarray(
        np.asarray(points_m, np.float64) @ body_T_lidar[:3, :3].T + body_T_lidar[:3, 3]
    )


def _of_log(log: Log, row: int) -> Callable[[], NDArray[np.float64]]:
    return lambda: scan_at_stamp(log, log.odom_T_scan, NO_BREAKS, row)


def _of_file(file: Path) -> Callable[[], NDArray[np.float64]]:
    return lambda: decoded(file.read_bytes(), file)


def _log(path: Path, reader: Mapping[str, Any]) -> Log | None:
    """The log at a path, or None if the reader that the site was learned with cannot open it."""
    for root in (path.parent, *path.parents[1:2]):
        with suppress(YearlocError, OSError):
            opener = build(reader, READERS)
            name = _sequence(path)
            if opener.sequences(root).get(name) == []:
                log: Log = opener.open(root, name)
                return log
    return None


def _sequence(path: Path) -> str:
    """The sequence that a path names; a CARMEN log may be named with its suffix."""
    suffixes = (suffix for suffix in carmen.SUFFIXES if path.name.endswith(suffix))
    return path.name.removesuffix(next(suffixes, ""))


def _files(path: Path) -> list[Path]:
    """The scan files of a folder, or of a subfolder in SCANS, in the order of their numbers."""
    for place in (path, *(path / name for name in SCANS)):
        files = [
            file
            for file in place.glob("*")
            if file.suffix in folder.SCANS and file.name != "velodyne_hits.bin"
        ]
        if files:
            return sorted(files, key=lambda file: (_stamp_ns(file.stem) or 0, file.name))
    raise LogError(
        f"{path}: no scan there: no .bin, .npy or .pcd in it or in {', '.join(SCANS)}, and no bag"
    )


def _stamp_ns(stem: str) -> int | None:
    """The stamp in a file's name: seconds with a point, or whole micro- or nanoseconds.

    None for the number of a row.
    """
    whole = stem.isascii() and stem.isdecimal()
    unit = "s" if not whole else "ns" if len(stem) >= 18 else "us" if len(stem) >= 15 else ""
    return folder.stamp_ns(stem, unit) if unit and len(stem) <= 40 and stem[:1].isdigit() else None


def _messages(
    path: Path,
    files: list[BagFile],
    topic: str | None,
    odometry: str | None,
    lift_m: float,
    skipped: Counter[str],
    body_T_lidar: Poses | None,
    kind: str,
) -> Iterator[Scan]:
    """The clouds or sweeps of bags, with the odometry interpolated at their stamps."""
    cloud_counts = Counter(
        {
            name: bag_topic.count
            for file in files
            for name, bag_topic in file.topics.items()
            if bag_topic.kind == kind
        }
    )
    if topic is None and not cloud_counts:
        raise LogError(
            f"{path}: no {kind.rpartition('/')[2]} in it; `yearloc inspect {path.name}` says what "
            "it holds"
        )
    if topic is not None and topic not in cloud_counts:
        kinds = "sweeps" if kind == SWEEP else "clouds"
        raise ConfigError(
            f"--topic {topic}: {path} has the {kinds} {', '.join(cloud_counts) or 'none'}"
        )
    clouds = Clouds.read(files, topic or cloud_counts.most_common(1)[0][0], skipped)
    tree = Tree.read(files, moving=False)
    body_T_lidar = (
        raised(lift_m) @ extrinsic(tree, clouds.frames) if body_T_lidar is None else body_T_lidar
    )
    odom_T_body = _odometry(path, files, tree, odometry, clouds.stamps_ns)
    log = Log(
        clouds.stamps_ns,
        np.full_like(odom_T_body, np.nan),
        odom_T_body,
        lambda row: placed(clouds.points(row), body_T_lidar),
        Counter(),
        times_s=clouds.times_s,
    )
    for row, stamp_ns in enumerate(clouds.stamps_ns.tolist()):
        recording = str(clouds.messages[row].file.path)
        yield Scan(
            f"{path.name} {row}",
            stamp_ns,
            _of_log(log, row),
            odom_T_body[row],
            NO_POSE,
            recording,
            body_T_lidar,
        )


def extrinsic(tree: Tree, frames: set[str]) -> NDArray[np.float64]:
    """The pose (4, 4) of the lidar in the vehicle by the bags' fixed transforms.

    The identity where they do not give it.
    """
    poses = (tree.fixed(body, *frames) for body in BODIES if len(frames) == 1)
    return next((pose for pose in poses if pose is not None), raised(0.0))


def _odometry(
    path: Path, files: list[BagFile], tree: Tree, name: str | None, stamps_ns: Stamps
) -> Poses:
    """Poses (n, 4, 4) of the vehicle at these stamps; NaN where there is no odometry."""
    if name is None:
        return np.tile(NO_POSE, (len(stamps_ns), 1, 1))
    pose_topics = sorted(
        {
            topic
            for file in files
            for topic, bag_topic in file.topics.items()
            if bag_topic.kind in KINDS
        }
    )
    if name not in pose_topics and not name.startswith("tf:"):
        raise ConfigError(
            f"--odometry {name}: {path} has the poses {', '.join(pose_topics) or 'none'}; or "
            "tf:PARENT>CHILD"
        )
    odometry_track = track(files, name, ODOMETRY_GAP_S)
    trajectory, _ = vehicle.split_at_jumps(name, odometry_track.trajectory)
    restarts_ns = odometry_track.trajectory.stamps_ns[vehicle.jumps(odometry_track.trajectory)]
    return np.asarray(
        vehicle.odometry_at(trajectory, stamps_ns, restarts_ns)
        @ child_T_body(tree, odometry_track.child)
    )


def child_T_body(tree: Tree, child: str | None) -> NDArray[np.float64]:
    """The pose (4, 4) of the vehicle in the frame that odometry moves, by fixed transforms.

    The identity where they do not give it.
    """
    bodies = (tree.fixed(child, body) for body in BODIES if child)
    return next((pose for pose in bodies if pose is not None), np.eye(4))
