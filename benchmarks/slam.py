"""How well poses are estimated from scans: drift, loops and time on logs whose poses are known.

    python -m stages.logs sequence="'2012-01-15'" out=logs/2012-01-15
    python -m stages.logs dataset=suburb world=drive_10hz sequence="'00'" out=logs/00
    python -m benchmarks.slam campus=logs/2012-01-15 drive=logs/00 keys=data/nclt_keyframes

Each log is an NCLT sequence, simulated or recorded, a folder of key frames, or a simulated bag. It
is estimated with its own odometry as guess and without, and, where its points have times, without
deskewing. A peer, kiss-icp (Vizzo et al., RA-L 2023), runs beside where it is installed.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses, distance_and_turn, step_lengths_m
from pipeline.core.progress import Progress
from pipeline.core.schemas import Estimates
from pipeline.formats import bag_file
from pipeline.readers.bag import Bag
from pipeline.readers.keyframes import FILE, KeyFrames
from pipeline.readers.log import Log
from pipeline.readers.nclt import Nclt
from pipeline.slam.drive import Slam, without_ground_truth

BAD_M = 0.5
BAD_DEG = 5.0
"""A step with a larger error is bad."""
WRONG_M = 2.0
WRONG_DEG = 5.0
"""A loop with a larger error is wrong."""
PIECE_M = 100.0
HEAD = (
    "| log | poses by | path m | ATE m | before loops m | in 100 m | bad steps | CPU-ms a scan "
    "| breaks | loops | wrong | wrong and kept |\n|" + "---|" * 12
)


@dataclass(frozen=True)
class Errors:
    """Errors of estimated poses; scans without a pose are left out."""

    ate_m: float
    """Root mean square of the positions' errors after one rigid transform."""
    piece_m: float
    """Mean distance of the end of a piece of PIECE_M of path, seen from its start."""
    bad_steps: int


@dataclass(frozen=True)
class Score:
    """The scores of one estimate of one log."""

    log: str
    way: str
    path_m: float
    errors: Errors
    ms: float = 0.0
    """CPU time a scan, reading included."""
    before_loops_m: float = np.nan
    """The ATE of the odometry."""
    breaks: int = 0
    loops: int = 0
    wrong_loops: int = 0
    wrong_kept: int = 0

    def line(self) -> str:
        """A row of the table."""
        numbers = (
            f"{self.path_m:.0f}",
            f"{self.errors.ate_m:.3f}",
            "–" if np.isnan(self.before_loops_m) else f"{self.before_loops_m:.3f}",
            f"{self.errors.piece_m:.3f}",
            self.errors.bad_steps,
            f"{self.ms:.0f}" if self.ms > 1 else "–",
            self.breaks,
            self.loops,
            self.wrong_loops,
            self.wrong_kept,
        )
        return f"| {self.log} | {self.way} | {' | '.join(map(str, numbers))} |"


def scores(name: str, log: Log, only: list[str]) -> Iterator[Score]:
    """Score the log's own odometry, our poses with and without it, and kiss-icp if installed.

    If `only` is not empty, only the ways in it are scored.
    """
    ground_truth = log.world_T_scan
    path_m = float(steps_m(ground_truth).sum())
    for way, poses_of in ways(log).items():
        if only and way not in only:
            continue
        started_s = time.process_time()
        result = poses_of()
        ms = 1000 * (time.process_time() - started_s) / len(ground_truth)
        if not isinstance(result, Estimates):
            yield Score(name, way, path_m, errors(ground_truth, result), ms)
            continue
        wrong = is_wrong(ground_truth, result)
        yield Score(
            name,
            way,
            path_m,
            errors(ground_truth, result.world_T_scan),
            ms,
            errors(ground_truth, result.odom_T_scan).ate_m,
            len(result.breaks),
            len(wrong),
            int(wrong.sum()),
            int((wrong & result.used).sum()),
        )


def ways(log: Log) -> dict[str, Callable[[], Poses | Estimates]]:
    """The ways to estimate the poses of a log, by name."""
    has_odometry = bool(np.isfinite(log.odom_T_scan[1:]).all())
    skewed = replace(log, times_s=lambda row: None)
    versions = {"": log} if log.times_s(0) is None else {"": log, ", not deskewed": skewed}
    named: dict[str, Callable[[], Poses | Estimates]] = {}
    if has_odometry:
        named["the log's odometry"] = lambda: log.odom_T_scan
    for suffix, version in versions.items():
        if has_odometry:
            named["scans and odometry" + suffix] = partial(ours, version, True)
        named["scans alone" + suffix] = partial(ours, version, False)
        if find_spec("kiss_icp") is not None:
            named["kiss-icp" + suffix] = partial(by_kiss_icp, version)
    return named


def ours(log: Log, use_log_odometry: bool) -> Estimates:
    return Slam(use_log_odometry=use_log_odometry).estimate(without_ground_truth(log), Progress())


def errors(ground_truth: Poses, estimate: Poses) -> Errors:
    """The errors of poses (n, 4, 4) after alignment with the true poses."""
    has_poses = np.isfinite(estimate).all((1, 2)) & np.isfinite(ground_truth).all((1, 2))
    ground_truth = ground_truth[has_poses]
    estimate = estimate[has_poses]
    off_m = distance_and_turn(alignment(estimate, ground_truth) @ estimate, ground_truth)[0]
    ate_m = float(np.sqrt((off_m**2).mean()))
    away_m, turn_deg = distance_and_turn(steps(ground_truth), steps(estimate))
    bad_steps = int(((away_m > BAD_M) | (turn_deg > BAD_DEG)).sum())
    return Errors(ate_m, piece_m(ground_truth, estimate), bad_steps)


def alignment(estimate: Poses, ground_truth: Poses) -> Poses:
    """The rigid transform (4, 4) that aligns poses (n, 4, 4) with true poses (Umeyama, 1991)."""
    estimate_m = estimate[:, :3, 3]
    true_m = ground_truth[:, :3, 3]
    covariance = (estimate_m - estimate_m.mean(axis=0)).T @ (true_m - true_m.mean(axis=0))
    U, _, Vt = np.linalg.svd(covariance)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))])
    true_T_estimate = np.eye(4)
    true_T_estimate[:3, :3] = Vt.T @ mirror @ U.T
    moved_m = true_T_estimate[:3, :3] @ estimate_m.mean(axis=0)
    true_T_estimate[:3, 3] = true_m.mean(axis=0) - moved_m
    return true_T_estimate


def piece_m(ground_truth: Poses, estimate: Poses) -> float:
    """The mean error of position of poses (n, 4, 4) after PIECE_M of path."""
    path_m = np.concatenate([[0.0], np.cumsum(steps_m(ground_truth))])
    ends = np.searchsorted(path_m, path_m + PIECE_M)
    starts = np.flatnonzero(ends < len(ground_truth))
    if not len(starts):
        return np.nan
    true = np.linalg.inv(ground_truth[starts]) @ ground_truth[ends[starts]]
    estimated = np.linalg.inv(estimate[starts]) @ estimate[ends[starts]]
    return float(np.linalg.norm((true - estimated)[:, :3, 3], axis=1).mean())


def steps_m(poses: Poses) -> NDArray[np.float64]:
    """Metres (n − 1,) between neighbouring poses."""
    return step_lengths_m(poses[:, :3, 3])


def steps(poses: Poses) -> Poses:
    """Each pose (n − 1, 4, 4) in the frame of the one before."""
    return np.asarray(np.linalg.inv(poses[:-1]) @ poses[1:])


def is_wrong(ground_truth: Poses, estimate: Estimates) -> NDArray[np.bool_]:
    """Which loops (k,) are wrong."""
    true = np.linalg.inv(ground_truth[estimate.earlier]) @ ground_truth[estimate.later]
    away_m, turn_deg = distance_and_turn(estimate.earlier_T_later, true)
    return np.asarray((away_m > WRONG_M) | (turn_deg > WRONG_DEG))


def by_kiss_icp(log: Log) -> Poses:
    """The poses (n, 4, 4) by the peer, with the settings of its authors but a range of 80 m."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range = 80.0
    config.data.deskew = log.times_s(0) is not None
    config.mapping.voxel_size = 0.8  # a hundredth of the range, as its command line takes
    odometry = KissICP(config)
    poses: list[NDArray[np.float64]] = []
    for row in range(len(log.stamps_ns)):
        times_s = log.times_s(row)
        times_s = np.empty(0) if times_s is None else times_s
        odometry.register_frame(np.asarray(log.points(row), np.float64), times_s)
        poses.append(odometry.last_pose.copy())
    return np.array(poses)


def opened(path: Path) -> Log:
    """An NCLT sequence, a folder of key frames, or a simulated bag, with its true poses."""
    if (path / FILE).is_file():
        turned = (0.0, 0.0, 0.0, 0.0, 0.0, 90.0)  # the stored frame drives along −y (METHODS 7.6)
        return KeyFrames(body_T_lidar=turned, lift_m=0.78).open(path.parent, path.name)
    if not path.is_dir():
        raise LogError(f"{path}: no such folder of a log")
    if bag_file.find(path):
        bag = Bag(ground_truth="/ground_truth", odometry="/odom")
        return bag.open(path.parent, path.name)
    return Nclt(max_gap_s=3.0).open(path.parent, path.name)


if __name__ == "__main__":
    parser = argparse.ArgumentParser("python -m benchmarks.slam", description=__doc__)
    parser.add_argument(
        "logs", nargs="+", metavar="NAME=FOLDER", help="A log's name in the table, and its folder"
    )
    parser.add_argument(
        "--way",
        action="append",
        default=[],
        help="Print only the row of this name; may be given several times [all rows]",
    )
    words = parser.parse_args()
    print(HEAD)
    for word in words.logs:
        log_name, _, folder = word.partition("=")
        for score in scores(log_name, opened(Path(folder).resolve()), words.way):
            print(score.line(), flush=True)
