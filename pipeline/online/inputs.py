"""Scans to localise: files, folders of them, logs, ROS bags, standard input; each read only when it is asked for."""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError, LogError, YearlocError
from pipeline.formats import folder, nclt, records
from pipeline.formats.bag import CLOUD
from pipeline.formats.bag_file import BagFile, find
from pipeline.frames import Poses, Stamps
from pipeline.readers.bag_clouds import Clouds
from pipeline.readers.bag_poses import KINDS, Tree, track
from pipeline.readers.log import Log, raised
from pipeline.running.building import build

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
    """A scan that can be read."""

    name: str
    stamp_ns: int | None
    """None of a file whose name is no time."""
    points: Callable[[], NDArray[np.float64]]
    """Reads the points (n, 3) in metres, x forward, y left, z up, ground at z = 0; raises LogError for a damaged scan."""
    odom_T_scan: NDArray[np.float64]
    """(4, 4) by the log's odometry, NaN where there is none."""
    world_T_scan: NDArray[np.float64]
    """(4, 4) true pose, NaN where it is unknown."""


def scans(
    source: str, reader: Mapping[str, Any], lift_m: float, topic: str | None = None, odometry: str | None = None
) -> Iterator[Scan]:
    """The scans of a path, or of standard input for `-`.

    A log that the site's own reader can open has its poses with it. Otherwise files and messages are taken as x forward, y left,
    z up, and raised by `lift_m`; of a bag, `odometry` is a topic of poses or tf:PARENT>CHILD. Raises LogError where there is no
    scan, ConfigError for a topic that a bag has not.
    """
    if source == "-":
        data = sys.stdin.buffer.read(folder.LARGEST_BYTES + 1)
        yield _unposed("-", None, lambda: _raised(decoded(data, Path("standard input.bin")), lift_m))
        return
    path = Path(source).expanduser()
    if not path.exists():
        raise LogError(f"{source}: no such file or folder")
    if log := _log(path.resolve(), reader):
        for row, stamp_ns in enumerate(log.stamps_ns.tolist()):
            points = _of_log(log, row)
            yield Scan(f"{path.name} {row}", stamp_ns, points, log.odom_T_scan[row], log.world_T_scan[row])
    elif bags := find(path):
        yield from _messages(path, [BagFile(bag) for bag in bags], topic, odometry, lift_m)
    else:
        files = [path] if path.is_file() else _files(path)
        for file in files:
            yield _unposed(file.name, _stamp_ns(file.stem), _of_file(file, lift_m))


def is_log(source: str, reader: Mapping[str, Any]) -> bool:
    """Whether the site's own reader opens a path: then it raises the points itself, whatever `lift_m`."""
    return source != "-" and _log(Path(source).expanduser().resolve(), reader) is not None


def decoded(data: bytes, path: Path) -> NDArray[np.float64]:
    """Points (n, 3) of a scan file's bytes; a .bin may be NCLT's. Raises LogError for a damaged one."""
    if path.suffix == ".bin" and len(data) <= folder.LARGEST_BYTES and records.point_bytes(data) == records.NCLT_BYTES:
        return np.asarray(nclt.decode(np.frombuffer(data, "<u2")))
    return folder.points(data, path)


def _unposed(name: str, stamp_ns: int | None, points: Callable[[], NDArray[np.float64]]) -> Scan:
    return Scan(name, stamp_ns, points, NO_POSE, NO_POSE)


def _raised(points_m: NDArray[np.float64], lift_m: float) -> NDArray[np.float64]:
    return np.asarray(points_m + np.array([0.0, 0.0, lift_m]))


def _of_log(log: Log, row: int) -> Callable[[], NDArray[np.float64]]:
    return lambda: np.asarray(log.points(row), np.float64)


def _of_file(file: Path, lift_m: float) -> Callable[[], NDArray[np.float64]]:
    return lambda: _raised(decoded(file.read_bytes(), file), lift_m)


def _log(path: Path, reader: Mapping[str, Any]) -> Log | None:
    """The log at a path, if the reader that the site was learned with can open it."""
    for root in (path.parent, *path.parents[1:2]):
        with suppress(YearlocError, OSError):
            opener = build(reader, READERS)
            if opener.sequences(root).get(path.name) == []:
                found: Log = opener.open(root, path.name)
                return found
    return None


def _files(path: Path) -> list[Path]:
    """The scan files of a folder, or of the folder in it that is known to hold some; in the order of their numbers."""
    for place in (path, *(path / name for name in SCANS)):
        found = [file for file in place.glob("*") if file.suffix in folder.SCANS and file.name != "velodyne_hits.bin"]
        if found:
            return sorted(found, key=lambda file: (_stamp_ns(file.stem) or 0, file.name))
    raise LogError(f"{path}: no scan there: no .bin, .npy or .pcd in it or in {', '.join(SCANS)}, and no bag")


def _stamp_ns(stem: str) -> int | None:
    """The time that a file is named by: seconds with a point, or whole micro- or nanoseconds; None of a number of a row."""
    whole = stem.isascii() and stem.isdecimal()
    unit = "s" if not whole else "ns" if len(stem) >= 18 else "us" if len(stem) >= 15 else ""
    return folder.stamp_ns(stem, unit) if unit and len(stem) <= 40 and stem[:1].isdigit() else None


def _messages(path: Path, files: list[BagFile], topic: str | None, odometry: str | None, lift_m: float) -> Iterator[Scan]:
    """The clouds of bags, with the odometry interpolated at their stamps."""
    held = Counter({name: one.count for file in files for name, one in file.topics.items() if one.kind == CLOUD})
    if topic is None and not held:
        raise LogError(f"{path}: no PointCloud2 in it; `yearloc inspect {path.name}` says what it holds")
    if topic is not None and topic not in held:
        raise ConfigError(f"--topic {topic}: {path} has the clouds {', '.join(held) or 'none'}")
    clouds = Clouds.read(files, topic or held.most_common(1)[0][0], Counter())
    tree = Tree.read(files, moving=False)
    body_T_lidar = extrinsic(tree, clouds.frames)
    odom_T_body = _odometry(path, files, tree, odometry, clouds.stamps_ns)
    for row, stamp_ns in enumerate(clouds.stamps_ns.tolist()):

        def points(row: int = row) -> NDArray[np.float64]:
            return np.asarray(clouds.points(row), np.float64) @ body_T_lidar[:3, :3].T + body_T_lidar[:3, 3]

        read = lambda points=points: _raised(points(), lift_m)  # noqa: E731
        yield Scan(f"{path.name} {row}", stamp_ns, read, odom_T_body[row], NO_POSE)


def extrinsic(tree: Tree, frames: set[str]) -> NDArray[np.float64]:
    """The pose (4, 4) of the lidar in the vehicle by the bags' fixed transforms; where they tell nothing, it is not turned."""
    known = (tree.fixed(body, *frames) for body in BODIES if len(frames) == 1)
    return next((found for found in known if found is not None), raised(0.0))


def _odometry(path: Path, files: list[BagFile], tree: Tree, name: str | None, stamps_ns: Stamps) -> Poses:
    """Poses (n, 4, 4) of the vehicle at these stamps; NaN without odometry, and where it tells none."""
    if name is None:
        return np.tile(NO_POSE, (len(stamps_ns), 1, 1))
    held = sorted({topic for file in files for topic, one in file.topics.items() if one.kind in KINDS})
    if name not in held and not name.startswith("tf:"):
        raise ConfigError(f"--odometry {name}: {path} has the poses {', '.join(held) or 'none'}; or tf:PARENT>CHILD")
    found = track(files, name, ODOMETRY_GAP_S)
    bodies = (tree.fixed(found.child, body) for body in BODIES if found.child)
    child_T_body = next((known for known in bodies if known is not None), np.eye(4))
    return np.asarray(found.trajectory.at(stamps_ns)[0] @ child_T_body)
