"""How well poses are estimated from scans: drift, loops and time on logs whose poses are known.

    python -m benchmarks.slam campus=artifacts/logs/campus/2012-01-15 keyframes=data/nclt_keyframes

Each log is an NCLT sequence, simulated or recorded, or a folder of key frames. It is estimated with
its own odometry as guess and without. A peer, kiss-icp (Vizzo et al., RA-L 2023), runs beside where
it is installed.
"""

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses, apart
from pipeline.core.progress import Progress
from pipeline.readers.keyframes import FILE, KeyFrames
from pipeline.readers.log import Log
from pipeline.readers.nclt import Nclt
from pipeline.slam.drive import Estimate, Slam, without_truth

BAD_M = 0.5
BAD_DEG = 5.0
"""A step off by more is bad."""
WRONG_M = 2.0
WRONG_DEG = 5.0
"""A loop off by more is wrong."""
HEAD = (
    f"{'log':<24} {'poses by':<22} {'path m':>7} {'ATE m':>7} {'/100 m':>7} {'bad':>4} "
    f"{'ms/scan':>7} {'breaks':>6} {'loops':>5} {'wrong':>5}"
)


@dataclass(frozen=True)
class Score:
    """What one estimate of one log is worth."""

    log: str
    way: str
    path_m: float
    ate_m: float
    """Root mean square of the positions' errors after one rigid transform."""
    bad_steps: int
    ms: float
    """CPU time a scan, reading included."""
    breaks: int = 0
    loops: int = 0
    wrong_loops: int = 0

    def line(self) -> str:
        """A row of the table."""
        return (
            f"{self.log:<24} {self.way:<22} {self.path_m:>7.0f} {self.ate_m:>7.3f} "
            f"{100 * self.ate_m / self.path_m:>7.3f} {self.bad_steps:>4} {self.ms:>7.0f} "
            f"{self.breaks:>6} {self.loops:>5} {self.wrong_loops:>5}"
        )


def scores(name: str, log: Log) -> Iterator[Score]:
    """Score the log's own odometry, ours with and without it, and kiss-icp where installed."""
    truth = log.world_T_scan
    path_m = float(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1).sum())
    if np.isfinite(log.odom_T_scan).all():
        yield Score(name, "the log's odometry", path_m, *errors(truth, log.odom_T_scan), 0.0)
    for use in (True, False):
        started_s = time.process_time()
        estimate = Slam(use_log_odometry=use).estimate(without_truth(log), Progress())
        ms = 1000 * (time.process_time() - started_s) / len(truth)
        way = "with odometry" if use else "without"
        loops = len(estimate.loops.used)
        wrong = wrong_loops(truth, estimate)
        counts = (len(estimate.breaks), loops, wrong)
        before = errors(truth, estimate.odom_T_scan)
        yield Score(name, f"{way}, before loops", path_m, *before, ms, *counts)
        yield Score(name, way, path_m, *errors(truth, estimate.world_T_scan), ms, *counts)
    if peer := kiss_icp():
        started_s = time.process_time()
        poses = peer(log)
        ms = 1000 * (time.process_time() - started_s) / len(truth)
        yield Score(name, "kiss-icp", path_m, *errors(truth, poses), ms)


def errors(truth: Poses, estimate: Poses) -> tuple[float, int]:
    """The ATE in metres of poses (n, 4, 4) and the number of bad steps; unknown ones are left out.

    Umeyama's rigid transform (PAMI 1991) lays them on the truth.
    """
    known = np.isfinite(estimate).all((1, 2)) & np.isfinite(truth).all((1, 2))
    estimate_m = estimate[known, :3, 3] - estimate[known, :3, 3].mean(axis=0)
    truth_m = truth[known, :3, 3] - truth[known, :3, 3].mean(axis=0)
    U, _, Vt = np.linalg.svd(estimate_m.T @ truth_m)
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))])
    off_m = estimate_m @ (Vt.T @ mirror @ U.T).T - truth_m
    ate_m = float(np.sqrt((off_m**2).sum(axis=1).mean()))
    away_m, turn_deg = apart(steps(truth[known]), steps(estimate[known]))
    return ate_m, int(((away_m > BAD_M) | (turn_deg > BAD_DEG)).sum())


def steps(poses: Poses) -> Poses:
    """Each pose (n − 1, 4, 4) in the frame of the one before."""
    return np.asarray(np.linalg.inv(poses[:-1]) @ poses[1:])


def wrong_loops(truth: Poses, estimate: Estimate) -> int:
    """How many loops that are used are wrong."""
    loops = estimate.loops
    true = np.linalg.inv(truth[loops.earlier]) @ truth[loops.later]
    away_m, turn_deg = apart(loops.earlier_T_later, true)
    return int((((away_m > WRONG_M) | (turn_deg > WRONG_DEG)) & loops.used).sum())


def kiss_icp() -> Callable[[Log], Poses] | None:
    """The peer as a function of a log; None where it is not installed."""
    try:
        from kiss_icp.config import KISSConfig
        from kiss_icp.kiss_icp import KissICP
    except ImportError:
        return None

    def estimated(log: Log) -> Poses:
        config = KISSConfig()
        config.data.max_range = 80.0
        config.data.deskew = False
        config.mapping.voxel_size = 0.5
        odometry = KissICP(config)
        poses: list[NDArray[np.float64]] = []
        for row in range(len(log.stamps_ns)):
            odometry.register_frame(np.asarray(log.points(row), np.float64), np.empty(0))
            poses.append(odometry.last_pose.copy())
        return np.array(poses)

    return estimated


def opened(path: Path) -> Log:
    """An NCLT sequence or a folder of key frames with its true poses."""
    if (path / FILE).is_file():
        turned = (0.0, 0.0, 0.0, 0.0, 0.0, 90.0)  # the stored frame drives along −y (METHODS 7.6)
        return KeyFrames(body_T_lidar=turned, lift_m=0.78).open(path.parent, path.name)
    if not path.is_dir():
        raise LogError(f"{path}: no such folder of a log")
    return Nclt(max_gap_s=3.0).open(path.parent, path.name)


if __name__ == "__main__":
    parser = argparse.ArgumentParser("python -m benchmarks.slam", description=__doc__)
    parser.add_argument("logs", nargs="+", metavar="NAME=FOLDER")
    print(HEAD)
    for word in parser.parse_args().logs:
        log_name, _, folder = word.partition("=")
        for score in scores(log_name, opened(Path(folder).resolve())):
            print(score.line(), flush=True)
