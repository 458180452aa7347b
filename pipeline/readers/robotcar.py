"""Reads a sequence of Oxford RobotCar, sweeps of upright 2-D lasers, as a Log (METHODS 7.2, 2.9).

The true poses are by inertial navigation (INS), the odometry by the stereo camera. A row of the Log
is one sweep, or the sweeps of both lasers if they have the same stamp. The frames in the files are
z-down; all results are x forward, y left, z up. The origin of the vehicle is the stereo camera, so
the ground lies below 0; the world is UTM (x north, y west).
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import NED_FLIP
from pipeline.core.settings import Positive, checked
from pipeline.formats import robotcar
from pipeline.readers import log, vehicle
from pipeline.readers.columns import utimes_ns
from pipeline.readers.log import Log
from pipeline.readers.robotcar_poses import read_extrinsics, read_ins, read_vo

NEAREST_M = 0.01
FARTHEST_M = 1000.0
"""The lasers reach 50 m: a nearer point means no return, a farther one a damaged file."""


@dataclass(frozen=True)
@checked("reader")
class RobotCar:
    """A folder of RobotCar sequences, with the extrinsics of the SDK beside them."""

    lasers: Sequence[str] = robotcar.LASERS[:1]
    """lms_front, lms_rear or both; the sweeps of both are merged in order of time."""
    extrinsics: str = "extrinsics"
    """Folder below the root with the SDK's pose files of the sensors; {sequence} is replaced by the
    name of the sequence."""
    max_vo_gap_s: Positive = 0.5
    """Poses of the visual odometry further apart than this are a gap; a sweep in it has no
    odometry."""
    max_ins_gap_s: Positive = 0.5
    """Good rows of the inertial navigation further apart than this are an outage; a sweep in it has
    no true pose."""
    lift_m: float = 0.0
    """Added to z."""

    def __post_init__(self) -> None:
        lasers = list(self.lasers) if isinstance(self.lasers, Iterable) else []
        are_lasers = all(laser in robotcar.LASERS for laser in lasers)
        if not lasers or not are_lasers or len(set(lasers)) < len(lasers):
            raise ConfigError(
                f"reader.lasers={self.lasers}: expected a list of {' or '.join(robotcar.LASERS)}, "
                "or of both"
            )

    def open(self, root: Path, sequence: str) -> Log:
        """Open a sequence below `root`; raises LogError if it cannot be read."""
        folder = root / sequence
        skipped: Counter[str] = Counter()
        notes: list[str] = []

        # sweeps of all lasers, merged by stamp
        utimes_by_laser = {
            laser: sweep_utimes(folder, laser, skipped, notes) for laser in self.lasers
        }
        all_utimes = np.unique(np.concatenate(list(utimes_by_laser.values())))

        # poses
        extrinsics = root / self.extrinsics.replace("{sequence}", sequence)
        zup_T_lasers = {
            laser: NED_FLIP @ read_extrinsics(extrinsics, laser) for laser in self.lasers
        }
        vehicle_T_ins = read_extrinsics(extrinsics, "ins")
        ground_truth = read_ins(folder / robotcar.INS, vehicle_T_ins, self.max_ins_gap_s)
        notes += vehicle.describe_faults("the true poses", ground_truth)
        odometry = read_vo(folder / robotcar.VO, self.max_vo_gap_s)
        world_T_scan, has_ground_truth = ground_truth.at(all_utimes * 1000)
        odom_T_scan = odometry.at(all_utimes * 1000, has_ground_truth)

        # sweeps that have a pose
        is_posed = has_ground_truth | np.isfinite(odom_T_scan).all(axis=(1, 2))
        skipped["neither odometry nor a true pose"] = int((~is_posed).sum())
        utimes = all_utimes[is_posed]
        unplaced_count = int((~has_ground_truth[is_posed]).sum())
        if unplaced_count:
            begins_outage = ~has_ground_truth & np.append(True, has_ground_truth[:-1])
            notes.append(
                f"{unplaced_count:,} of {len(utimes):,} sweeps have no place (INS outages: "
                f"{int(begins_outage.sum())})"
            )
        if len(odometry.breaks_ns):
            notes.append(
                f"the visual odometry breaks off {len(odometry.breaks_ns)} times: no submap "
                "reaches across"
            )
        lift_xyz_m = np.array([0.0, 0.0, self.lift_m])
        has_sweep = {
            laser: np.isin(utimes, laser_utimes) for laser, laser_utimes in utimes_by_laser.items()
        }

        def points(row: int) -> NDArray[np.float64]:
            clouds = [
                read_sweep(folder / laser / f"{utimes[row]}.bin", zup_T_lasers[laser])
                for laser in self.lasers
                if has_sweep[laser][row]
            ]
            return np.asarray(np.concatenate(clouds) + lift_xyz_m)

        return Log(
            stamps_ns=utimes * 1000,
            world_T_scan=world_T_scan[is_posed],
            odom_T_scan=odom_T_scan[is_posed],
            points=points,
            skipped=+skipped,  # without the reasons that were counted as 0
            notes=tuple(notes),
        )

    def sequences(self, root: Path) -> dict[str, list[str]]:
        """The sequences below `root`, each with the files that it lacks."""
        names = sorted(
            {
                path.parent.name
                for laser in robotcar.LASERS
                for path in root.glob(f"*/{laser}")
                if path.is_dir()
            }
        )
        needed_places = [
            f"{{sequence}}/{place}" for place in (*self.lasers, robotcar.VO, robotcar.INS)
        ]
        needed_places += [f"{self.extrinsics}/{sensor}.txt" for sensor in (*self.lasers, "ins")]
        missing: dict[str, list[str]] = {}
        for name in names:
            places = [place.replace("{sequence}", name) for place in needed_places]
            missing[name] = [place for place in places if not (root / place).exists()]
        return missing


def read_sweep(path: str | Path, zup_T_laser: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (n, 3) in metres of one sweep in the z-up vehicle frame.

    `zup_T_laser` (4, 4) is NED_FLIP @ the file's extrinsics. Beams without a return (range 0, or
    not finite) are dropped, so there may be fewer rows than the 541 beams. Raises LogError for a
    missing file, one that ends within a record, or a return beyond the reach of any laser.
    """
    data = log.read_bytes(Path(path), robotcar.RECORD_BYTES, "returns")
    xy_m = robotcar.decode_sweep(data)[:, :2]
    xy_m = xy_m[np.isfinite(xy_m).all(axis=1) & (np.abs(xy_m) > NEAREST_M).any(axis=1)]
    if (np.abs(xy_m) > FARTHEST_M).any():
        raise LogError(
            f"{path}: a return lies {np.abs(xy_m).max():.3g} m away, where no laser reaches; the "
            "file is damaged"
        )
    # without the third column, since z is 0 in the scan plane
    return xy_m @ zup_T_laser[:3, :2].T + zup_T_laser[:3, 3]


def sweep_utimes(
    sequence_folder: Path, laser: str, skipped: Counter[str], notes: list[str]
) -> NDArray[np.int64]:
    """The utimes (n,) of the sweeps of a laser: of its whole files that its list of stamps names.

    Without the list, all whole files are taken, which adds a note. Counts in `skipped` files
    without a stamp and stamps without a file. Raises LogError if there is no sweep.
    """
    folder = sequence_folder / laser
    path = sequence_folder / robotcar.STAMPS.format(laser=laser)
    if not folder.is_dir():
        raise LogError(f"{folder}: no such folder of sweeps")
    files = log.numbered_files(
        folder, robotcar.RECORD_BYTES, log.is_utime, "file name is no utime", skipped
    )
    utimes = files.usable
    if path.is_file():
        stamps = utimes_ns(path, log.read_table(path, 2)[:, 0]) // 1000
        has_stamp = np.isin(utimes, stamps)
        skipped["stamp without a file"] += int((~np.isin(stamps, files.named)).sum())
        skipped["file without a stamp"] += int((~has_stamp).sum())
        utimes = utimes[has_stamp]
    else:
        notes.append(f"no {path.name}: the sweeps of {laser} are those whose files are there")
    if not len(utimes):
        raise LogError(f"{folder}: holds no readable sweep (UTIME.bin, its utime in {path.name})")
    return utimes
