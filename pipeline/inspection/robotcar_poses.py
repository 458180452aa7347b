"""Oxford RobotCar's vo.csv and ins.csv: the share of a drive that has poses."""

from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.formats import robotcar
from pipeline.inspection.inspection import Inspection, Section, clock, duration, metres
from pipeline.inspection.tracks import box
from pipeline.readers.columns import columns, numbers
from pipeline.readers.robotcar import RobotCar
from pipeline.readers.robotcar_poses import read_ins, read_vo


def vo(path: Path) -> Inspection:
    """vo/vo.csv: the motion of the vehicle from one image to the next, chained by the reader."""
    gap_s = RobotCar().max_vo_gap_s
    odometry = read_vo(path, gap_s)
    stamps_s, poses = odometry.trajectory.stamps_ns * 1e-9, odometry.trajectory.world_T_body
    known: NDArray[np.bool_] = np.all(np.isfinite(poses), axis=(1, 2))
    steps_m = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    moved_m = steps_m[np.isfinite(steps_m)]
    wide_s = np.diff(stamps_s)[known[1:] & known[:-1]]
    cells = (
        ("knots", f"{int(known.sum()):,}, in {len(odometry.breaks_ns) + 1} chains"),
        *clock(stamps_s[known]),
        ("path", f"{metres(float(moved_m.sum()))}, longest step {metres(float(moved_m.max(initial=0.0)))}"),
        ("frame", "the vehicle (stereo camera): x forward, y right, z down, radians; the reader turns it z up"),
    )
    found = []
    if len(odometry.breaks_ns):
        found.append(
            f"breaks: {len(odometry.breaks_ns)} rows start elsewhere than where the row before them ended; "
            "no accumulated submap reaches across one"
        )
    if (wide_s > gap_s).any():
        found.append(
            f"{int((wide_s > gap_s).sum())} steps over {gap_s} s, the longest {duration(float(wide_s.max()))}: sweeps there have "
            "no odometry; sparser odometry needs max_vo_gap_s in the dataset's yaml"
        )
    return Inspection(f"{path} — RobotCar visual odometry", (Section("", cells),), tuple(found))


def ins(path: Path) -> Inspection:
    """gps/ins.csv: the INS unit's poses, of which the reader takes those of status INS_SOLUTION_GOOD."""
    gap_s = RobotCar().max_ins_gap_s
    track = read_ins(path, np.eye(4), gap_s)
    table = columns(path, ("ins_status", "utm_zone", *robotcar.INS_POSE))
    statuses, zones = Counter(table["ins_status"]), sorted(set(table["utm_zone"]))
    good: NDArray[np.bool_] = np.all(np.isfinite(track.world_T_body), axis=(1, 2))
    stamps_s, xyz = track.stamps_ns * 1e-9, numbers(path, table, robotcar.INS_POSE)[good, :3]
    steps_m, gaps_s = np.linalg.norm(np.diff(xyz, axis=0), axis=1), np.diff(stamps_s[good])
    cells = (
        ("rows", f"{len(good):,}, of which {100 * good.mean():.1f} % are {robotcar.INS_GOOD}"),
        ("statuses", ", ".join(f"{status[:40]} {count:,}" for status, count in statuses.most_common(5))),
        *clock(stamps_s),
        ("path", metres(float(steps_m[gaps_s <= gap_s].sum()))),
        ("box", box(xyz, "northing", "easting", "down")),
        ("UTM zone", ", ".join(zones)[:60]),
        ("frame", "the INS unit in north-east-down, radians; the reader converts it to the z-up vehicle by the extrinsics"),
    )
    found = []
    if not good.any():
        found.append(f"no row is {robotcar.INS_GOOD}: no sweep has a true pose")
    if (gaps_s > gap_s).any():
        found.append(
            f"outages: {int((gaps_s > gap_s).sum())} over {gap_s} s without a good row, the longest "
            f"{duration(float(gaps_s.max()))}: sweeps there have no place, but go into the submaps around"
        )
    return Inspection(f"{path} — RobotCar inertial navigation", (Section("", cells),), tuple(found))
