"""Opens what a user wants to localise: a log, ROS bags, a folder of scans, a file, standard input.

`ScanOptions.scans` yields a `Scan` for each. It holds the stamp, and the poses by odometry and by
the reference if there are any; its points are read only when they are needed.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.building import build
from pipeline.core.datum import Datum
from pipeline.core.errors import ConfigError, InputError, LogError, YearlocError
from pipeline.core.frames import ROUNDED_NS, Poses, Stamps, transformed
from pipeline.formats import bin_layout, folder, nclt
from pipeline.formats.bag import CLOUD, NAV_SAT_FIX, SWEEP
from pipeline.formats.bag_file import BagFile, find
from pipeline.online.gnss import GnssPriors
from pipeline.opening.opening import by_reader, scan_files
from pipeline.posing.prior import Prior
from pipeline.readers import vehicle
from pipeline.readers.bag_clouds import Clouds
from pipeline.readers.bag_gnss import read_gnss
from pipeline.readers.bag_poses import KINDS, Track, read_track
from pipeline.readers.deskew import NO_BREAKS, scan_at_stamp
from pipeline.readers.log import READERS, Log, parse_extrinsic, raised
from pipeline.readers.mounting import BODIES, Transforms

NO_POSE = np.full((4, 4), np.nan)
"""An unknown pose."""
ODOMETRY_GAP_S = 1.0
"""Odometry is not interpolated over a longer gap."""


@dataclass(frozen=True)
class Scan:
    """A scan to localise, whose points are read only when they are needed."""

    name: str
    stamp_ns: int | None
    """None for a file whose name is not a time."""
    points: Callable[[], NDArray[np.float64]]
    """Reads the points (n, 3) in metres: x forward, y left, z up, ground at z = 0. They are
    deskewed to the stamp if the log has odometry and the time of each point. Raises LogError for a
    damaged scan."""
    odom_T_scan: NDArray[np.float64]
    """(4, 4) the pose by odometry; NaN if there is no odometry."""
    world_T_scan: NDArray[np.float64]
    """(4, 4) the true pose; NaN if it is unknown."""
    recording: str = ""
    """The file or folder that the scan was read from. Each recording has its own odometry frame."""
    body_T_lidar: Poses | None = None
    """(4, 4) the pose of the lidar in the vehicle, by which the points were transformed; None for a
    log, whose reader transforms its points."""
    prior: Prior | None = None
    """Where the robot is by GNSS; None if that is unknown."""


@dataclass(frozen=True)
class ScanOptions:
    """How scans are read for a site: by the site's description, and by the user's options."""

    reader: Mapping[str, Any]
    """Settings of the reader of the site's data set, which opens logs with their poses."""
    lift_m: float = 0.0
    """How far the points of files and bags are raised, so that the ground is at z = 0."""
    topic: str | None = None
    """The topic of a bag to read; None is the topic with most messages."""
    odometry: str | None = None
    """The odometry of a bag: a topic of poses, or tf:PARENT>CHILD."""
    body_T_lidar: Poses | None = None
    """The pose (4, 4) of the lidar in the vehicle, instead of `lift_m` and a bag's transforms."""
    message: str = CLOUD
    """The kind of a bag's messages to read: clouds, or sweeps for a level site."""
    gnss: str | None = None
    """The topic of a bag with positions of GNSS, which become priors of the scans."""
    datum: Datum | None = None
    """Where the site's world lies on the Earth; needed for `gnss`."""

    def scans(self, source: str, skipped: Counter[str]) -> Iterator[Scan]:
        """The scans at a path, or of standard input for `-`.

        A path is opened as the first of these that fits:

        - a log in the format of the site's data set, by its `reader`, with the log's poses;
        - ROS bags, with the poses of their odometry;
        - a folder of scan files, or one such file.

        Points of bags and files are x forward, y left, z up. Scans that a log or a bag leaves out
        are counted in `skipped`, by reason. Raises LogError if there is no scan, ConfigError for a
        topic that a bag does not have, and for GNSS of what is no bag.
        """
        priors = self._gnss_priors(source)
        for scan in self._scans(source, skipped):
            yield scan if priors is None else replace(scan, prior=priors.at(scan.stamp_ns))

    def _scans(self, source: str, skipped: Counter[str]) -> Iterator[Scan]:
        """The scans at a path, or of standard input, without priors; raises as `scans`."""
        placement = raised(self.lift_m) if self.body_T_lidar is None else self.body_T_lidar
        if source == "-":
            data = sys.stdin.buffer.read(folder.LARGEST_BYTES + 1)
            points = partial(decoded, data, Path("standard input.bin"))
            yield _unposed("-", None, points, placement)
            return
        path = Path(source).expanduser()
        if not path.exists():
            raise LogError(f"{source}: no such file or folder")
        if log := self._log(path):
            skipped.update(log.skipped)
            for row in range(len(log.stamps_ns)):
                yield _of_log(log, row, path, str(path))
        elif bags := find(path):
            yield from self._of_bags(path, [BagFile(bag) for bag in bags], skipped)
        else:
            for file in [path] if path.is_file() else _files(path):
                points = partial(points_of_file, file)
                yield _unposed(file.name, _stamp_ns(file.stem), points, placement)

    def is_log(self, source: str) -> bool:
        """Whether the site's own reader opens a path, and so transforms its points itself."""
        return source != "-" and self._log(Path(source).expanduser()) is not None

    def lidar_on_vehicle(
        self, transforms: Transforms, lidar_frames: set[str], child: str | None
    ) -> Poses:
        """The pose (4, 4) of a bag's lidar in the vehicle.

        `lidar_frames` are the frames of the clouds, and `child` the frame that odometry moves. If
        no frame of the vehicle is known, the lidar's frame is taken for the vehicle's. Raises
        LogError if the vehicle's frame is known, but no transforms connect the lidar with it.
        """
        if self.body_T_lidar is not None:
            return self.body_T_lidar
        bodies = (*BODIES, child) if child else BODIES
        body_T_lidar = transforms.body_T_lidar(bodies, lidar_frames)
        if body_T_lidar is not None:
            return raised(self.lift_m) @ body_T_lidar
        if body := child or transforms.vehicle():
            raise LogError(
                f"{transforms.static.where}: no fixed transforms lead from {body} to "
                f"{', '.join(sorted(lidar_frames)):.80}, the frame of its points; give "
                "--body-T-lidar"
            )
        return raised(self.lift_m)

    def _log(self, path: Path) -> Log | None:
        """The log at a path; None if the reader that the site was learned with cannot open it."""
        with suppress(YearlocError, OSError):
            return by_reader(path, build(self.reader, READERS))
        return None

    def _of_bags(self, path: Path, files: list[BagFile], skipped: Counter[str]) -> Iterator[Scan]:
        """The clouds or sweeps of bags, with odometry at their stamps."""
        clouds = Clouds.read(files, self._topic(path, files), skipped)
        transforms = Transforms.read(files)
        odometry = self._odometry(path, files)
        child = odometry.child if odometry else None
        body_T_lidar = self.lidar_on_vehicle(transforms, clouds.frames, child)
        odom_T_body = np.tile(NO_POSE, (len(clouds.stamps_ns), 1, 1))
        if odometry:
            odom_T_child = _poses_at(odometry, clouds.stamps_ns)
            odom_T_body = odom_T_child @ child_T_body(transforms, child)
        log = Log(
            clouds.stamps_ns,
            np.full_like(odom_T_body, np.nan),
            odom_T_body,
            lambda row: transformed(body_T_lidar, clouds.points(row)),
            Counter(),
            times_s=clouds.times_s,
        )
        for row in range(len(clouds.stamps_ns)):
            recording = str(clouds.messages[row].file.path)
            yield _of_log(log, row, path, recording, body_T_lidar)

    def _topic(self, path: Path, files: list[BagFile]) -> str:
        """The topic of bags to read: the user's, or the topic with most messages."""
        counts = Counter[str]()
        for file in files:
            for name, topic in file.topics.items():
                if topic.kind == self.message:
                    counts[name] += topic.count
        if self.topic is None and not counts:
            raise LogError(
                f"{path}: no {self.message.rpartition('/')[2]} in it; `yearloc inspect "
                f"{path.name}` says what it holds"
            )
        if self.topic is not None and self.topic not in counts:
            kinds = "sweeps" if self.message == SWEEP else "clouds"
            raise ConfigError(
                f"--topic {self.topic}: {path} has the {kinds} {', '.join(counts) or 'none'}"
            )
        return self.topic or counts.most_common(1)[0][0]

    def _gnss_priors(self, source: str) -> GnssPriors | None:
        """The priors of the user's topic of GNSS; None without the option."""
        if self.gnss is None or self.datum is None:
            return None
        paths = [] if source == "-" else find(Path(source).expanduser())
        if not paths:
            raise ConfigError(f"--gnss {self.gnss}: {source} is no bag")
        files = [BagFile(bag) for bag in paths]
        topics = set[str]()
        for file in files:
            topics |= {name for name, topic in file.topics.items() if topic.kind == NAV_SAT_FIX}
        if self.gnss not in topics:
            raise ConfigError(
                f"--gnss {self.gnss}: {source} has the NavSatFix "
                f"{', '.join(sorted(topics)) or 'none'}"
            )
        return GnssPriors(read_gnss(files, self.gnss), self.datum)

    def _odometry(self, path: Path, files: list[BagFile]) -> Track | None:
        """The poses of the user's odometry topic; None without the option."""
        if self.odometry is None:
            return None
        pose_topics = set[str]()
        for file in files:
            pose_topics |= {topic for topic, at in file.topics.items() if at.kind in KINDS}
        if self.odometry not in pose_topics and not self.odometry.startswith("tf:"):
            raise ConfigError(
                f"--odometry {self.odometry}: {path} has the poses "
                f"{', '.join(sorted(pose_topics)) or 'none'}; or tf:PARENT>CHILD"
            )
        return read_track(files, self.odometry, ODOMETRY_GAP_S)


def decoded(data: bytes, path: Path) -> NDArray[np.float64]:
    """The points (n, 3) in the bytes of a scan file.

    The ending of `path` tells the format; a .bin is NCLT's or KITTI's, whichever its bytes look
    like. Raises LogError for a damaged file.
    """
    may_be_nclt = path.suffix == ".bin" and len(data) <= folder.LARGEST_BYTES
    if may_be_nclt and bin_layout.point_bytes(data) == bin_layout.NCLT_BYTES:
        return np.asarray(nclt.decode(np.frombuffer(data, "<u2")))
    return folder.points(data, path)


def placement(key: str, text: str) -> Poses:
    """The pose (4, 4) of a lidar in the vehicle, parsed from x,y,z,roll,pitch,yaw.

    The numbers are in metres and degrees. Raises ConfigError, which names the option `key`.
    """
    try:
        return parse_extrinsic(key, [float(word) for word in text.split(",")])
    except (ValueError, ConfigError):
        raise ConfigError(
            f"{key}={text:.60}: expected x,y,z,roll,pitch,yaw in metres and degrees"
        ) from None


def parse_prior(key: str, text: str | None, sigma_key: str, sigma: str | None) -> Prior | None:
    """The prior parsed from x,y[,heading] and its standard deviations from METRES[,DEGREES].

    It is None if both are None. Without standard deviations, those of Prior.at are taken. Raises
    InputError, which names the options `key` and `sigma_key`.
    """
    if text is None:
        if sigma is not None:
            raise InputError(f"{sigma_key}={sigma:.60}: needs {key}")
        return None
    numbers = _numbers(text)
    if len(numbers) not in (2, 3):
        raise InputError(f"{key}={text:.60}: expected x,y or x,y,heading in metres and degrees")
    sigmas = [] if sigma is None else _numbers(sigma)
    if sigma is not None and not 1 <= len(sigmas) <= len(numbers) - 1:
        form = (
            "METRES,DEGREES or METRES"
            if len(numbers) == 3
            else f"METRES, since {key} has no heading"
        )
        raise InputError(f"{sigma_key}={sigma:.60}: expected {form}")
    x_m, y_m, *heading_deg = numbers
    names = ("sigma_m", "sigma_deg")
    return Prior.at(x_m, y_m, *heading_deg, **dict(zip(names, sigmas, strict=False)))


def _numbers(text: str) -> list[float]:
    """The numbers between commas; empty if there is something else."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        return []


def _of_log(
    log: Log, row: int, path: Path, recording: str, body_T_lidar: Poses | None = None
) -> Scan:
    """One scan of a log that was opened at `path`."""
    return Scan(
        f"{path.name} {row}",
        int(log.stamps_ns[row]),
        partial(scan_at_stamp, log, log.odom_T_scan, NO_BREAKS, row),
        log.odom_T_scan[row],
        log.world_T_scan[row],
        recording,
        body_T_lidar,
    )


def _unposed(
    name: str, stamp_ns: int | None, points: Callable[[], NDArray[np.float64]], body_T_lidar: Poses
) -> Scan:
    """A scan without poses, whose points are transformed by `body_T_lidar` (4, 4)."""
    return Scan(
        name=name,
        stamp_ns=stamp_ns,
        points=lambda: transformed(body_T_lidar, points()),
        odom_T_scan=NO_POSE,
        world_T_scan=NO_POSE,
        recording=name,
        body_T_lidar=body_T_lidar,
    )


def points_of_file(file: Path) -> NDArray[np.float64]:
    """The points (n, 3) of a scan file, as `decoded` finds them."""
    return decoded(file.read_bytes(), file)


def _files(path: Path) -> list[Path]:
    """The scan files of a folder or its subfolders, in the order of their numbers."""
    files = scan_files(path)
    if not files:
        raise LogError(
            f"{path}: no scan there: no .bin, .npy or .pcd in it or in "
            f"{', '.join(folder.SCAN_FOLDERS)}, and no bag"
        )
    return sorted(files, key=lambda file: (_stamp_ns(file.stem) or 0, file.name))


def _stamp_ns(stem: str) -> int | None:
    """The stamp in a file's name, if that is a time since 1970; None otherwise."""
    # a name with a point is in seconds; a whole number is in micro- or nanoseconds, or a row
    if not stem[:1].isdigit() or len(stem) > 40:
        return None
    is_whole = stem.isascii() and stem.isdecimal()
    unit = folder.unit_of(stem) if is_whole else "s"
    return folder.parse_stamp_ns(stem, unit) if unit in folder.UNIT_NS else None


def _poses_at(odometry: Track, stamps_ns: Stamps) -> Poses:
    """The poses (n, 4, 4) by odometry at stamps (n,); NaN where there is none."""
    trajectory, _ = vehicle.split_at_jumps(odometry.name, odometry.trajectory)
    odom_T_child, _ = trajectory.at(stamps_ns)
    # The odometry starts again after each jump: the first scan after it gets no pose, as in a log.
    # A gap needs no such mark: no scan within it has a pose, and drives in several files are
    # distinguished by their recording.
    restarts_ns = odometry.trajectory.stamps_ns[vehicle.find_jumps(odometry.trajectory)]
    first_rows = np.searchsorted(stamps_ns, restarts_ns - ROUNDED_NS)
    odom_T_child[first_rows[first_rows < len(stamps_ns)]] = np.nan
    return odom_T_child


def child_T_body(transforms: Transforms, child: str | None) -> NDArray[np.float64]:
    """The pose (4, 4) of the vehicle in the frame that odometry moves; the identity if unknown."""
    pose = transforms.fixed(*((child, body) for body in BODIES)) if child else None
    return np.eye(4) if pose is None else pose
