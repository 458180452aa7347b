"""Pseudo-labels: the scans of a later day that a site learns, and their poses (METHODS 11.2).

With reference poses, scans are labelled by these. Without them, the site labels the drive itself:

1. Track the robot through the drive, once forwards and once backwards.
2. For each scan, take the more probable of its two fixes, if it is accepted.
3. Fill the gaps between accepted fixes by odometry, if it agrees with both ends of a gap.
4. Thin the scans that have a pose to one every STEP_M.

update.py then makes the site learn these scans.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses, Stamps, Trajectory, travelled_m
from pipeline.matching.ranking import Rows
from pipeline.online.inputs import NO_POSE, Scan
from pipeline.online.site import Fix, Site, finite
from pipeline.online.tracking import Tracker
from pipeline.posing.registration import Points
from pipeline.posing.verdict import OF_SCANS

STEP_M = 0.8
"""The least distance between two pseudo-labelled scans, a little less than between submaps."""
LOOSE_PRECISION = 0.95
"""The wanted precision of a tracker whose poses are used whether they are accepted or not, and of
fixes that others are to confirm."""


class NoPseudoLabelsError(LogError):
    """No scan of a drive can be learned."""


@dataclass(frozen=True)
class PseudoLabels:
    """The scans of one day that a site is to learn, with their poses."""

    points: tuple[Points, ...]
    """(n, 3) of each scan: x forward, y left, z up from the ground, in metres."""
    stamps_ns: Stamps
    world_T_scan: Poses
    """(scan, 4, 4) the pose of each scan."""
    probability: NDArray[np.float64]
    """(scan,) the probability that the pose is right; 1 for a reference pose."""
    wrong: NDArray[np.bool_]
    """(scan,) True if the pose is over 2 m or 5° off the log's true pose; False if it is unknown.
    """
    has_reference_poses: bool
    """Whether the poses are reference poses; only these can add new places to the site."""
    scan_count: int
    """The number of all scans of the day, pseudo-labelled or not."""

    def words(self, used: int) -> str:
        """How many scans are used, how they are labelled, and how many of them wrongly."""
        label = "with reference poses" if self.has_reference_poses else "pseudo-labelled"
        wrong = ""
        if self.wrong.any():
            wrong = f", {self.wrong.sum()} of them wrong by the log's own poses"
        return f"{used} of {self.scan_count} scans {label}{wrong}"

    def views(self, site: Site) -> Rows:
        """The scans as views of the site's method."""
        return Rows(
            np.stack([site.view(points_m) for points_m in self.points]),
            self.stamps_ns,
            self.world_T_scan,
        )


def from_site(
    site: Site, scans: Sequence[Scan], target_precision: float | None = 0.99
) -> PseudoLabels:
    """Pseudo-label scans of one drive by the site's own fixes that are accepted.

    If the site cannot keep the target precision, the largest below it that it can is used. Without
    a target precision, every fix with a pose is used. Raises NoPseudoLabelsError if no scan is
    pseudo-labelled, or if the site can keep no target precision.
    """
    if target_precision is not None:
        target_precision = site.kept_precision(target_precision)
        if target_precision is None:
            raise NoPseudoLabelsError(
                f"nothing to learn of {len(scans)} scans: the site can keep no target precision"
            )
    forwards = followed(site, scans, target_precision)
    backwards = followed(site, scans[::-1], target_precision)[::-1]
    poses = np.tile(NO_POSE, (len(scans), 1, 1))
    probability = np.zeros(len(scans))
    for row, two_fixes in enumerate(zip(forwards, backwards, strict=True)):
        accepted_fixes = [fix for fix in two_fixes if accepts(fix, target_precision)]
        if accepted_fixes:
            likelier_fix = min(accepted_fixes, key=lambda fix: fix.novelty)
            poses[row] = likelier_fix.world_T_sensor
            probability[row] = likelier_fix.probability
    odom_T_scan = np.array([scan.odom_T_scan for scan in scans]).reshape(-1, 4, 4)
    bridge(poses, probability, odom_T_scan)
    return spaced_labels(scans, poses, probability, False, "no fix is accepted")


def with_reference_poses(scans: Sequence[Scan], world_T_scan: Poses) -> PseudoLabels:
    """Label the scans of a drive by reference poses (scan, 4, 4), NaN where there is none.

    Raises NoPseudoLabelsError if no scan has a reference pose.
    """
    probability = np.ones(len(scans))
    return spaced_labels(scans, world_T_scan, probability, True, "the reference poses cover none")


def own_poses(scans: Sequence[Scan]) -> Poses:
    """The log's own true poses (scan, 4, 4) of its scans; NaN where unknown."""
    return np.array([scan.world_T_scan for scan in scans]).reshape(-1, 4, 4)


def poses_at(scans: Sequence[Scan], poses: Trajectory) -> Poses:
    """The poses (scan, 4, 4) of a trajectory at the stamps of scans; NaN where it has none.

    Raises LogError if no scan has a stamp.
    """
    stamps_ns = np.array([scan.stamp_ns or 0 for scan in scans], np.int64)
    is_stamped = np.array([scan.stamp_ns is not None for scan in scans], bool)
    if not is_stamped.any():
        raise LogError(
            f"none of {len(scans)} scans has a stamp, such as {scans[0].name}, so stamped poses "
            "say nothing of them: give poses of one row a scan, 12 numbers as KITTI's"
        )
    world_T_scan, _ = poses.at(stamps_ns)
    return np.where(is_stamped[:, None, None], world_T_scan, np.nan)


def followed(site: Site, scans: Sequence[Scan], target_precision: float | None) -> list[Fix]:
    """The fix of each scan, by a tracker that gets the scans in this order."""
    tracker = Tracker(site, target_precision or LOOSE_PRECISION)
    return [tracker.follow(scan, scan.points()) for scan in scans]


def accepts(fix: Fix, target_precision: float | None) -> bool:
    """Whether a scan may be labelled by a fix: it is accepted or, without a target precision, has a
    pose."""
    return fix.verdict == "accepted" if target_precision else fix.verdict != "no pose"


def bridge(poses: Poses, probability: NDArray[np.float64], odom_T_scan: Poses) -> None:
    """Fill gaps (NaN) in poses (n, 4, 4) and their probabilities (n,) in place, by odometry.

    `odom_T_scan` (n, 4, 4) are the poses by odometry. A gap is filled if odometry from the pose
    before it reaches the pose after it within 2 m and 5°; the difference is spread over the path. A
    filled pose gets the smaller probability of the two ends.
    """
    posed_rows = np.flatnonzero(np.isfinite(poses).all((1, 2)))
    for first, last in zip(posed_rows[:-1].tolist(), posed_rows[1:].tolist(), strict=True):
        if last - first < 2:
            continue
        path = bridged(poses[first], poses[last], odom_T_scan[first : last + 1])
        if path is not None:
            between = slice(first + 1, last)
            poses[between] = path[1:-1]
            probability[between] = min(probability[first], probability[last])


def bridged(
    first: NDArray[np.float64], last: NDArray[np.float64], odom_T_scan: Poses
) -> Poses | None:
    """The path (n, 4, 4) by odometry (n, 4, 4) from one pose (4, 4) to another.

    It is None if odometry misses the last pose by more than 2 m or 5°. A smaller difference is
    spread over the path.
    """
    by_odometry = first @ np.linalg.inv(odom_T_scan[0]) @ odom_T_scan
    if not np.isfinite(by_odometry).all() or not OF_SCANS.right(by_odometry[-1:], last[None])[0]:
        return None
    return _corrected(by_odometry, last)


def _corrected(path: Poses, last: Poses) -> Poses:
    """A path (n, 4, 4) of odometry, corrected along its length so that it ends at `last` (4, 4)."""
    path_m = travelled_m(path[:, :3, 3])
    share = path_m / max(path_m[-1], 1e-9)  # 0 for a robot that stood still
    correction = last @ np.linalg.inv(path[-1])
    turns = Slerp([0, 1], Rotation.from_matrix([np.eye(3), correction[:3, :3]]))(share)
    shift_m = (correction @ path)[:, :3, 3] - path[:, :3, 3]
    corrected = np.tile(np.eye(4), (len(path), 1, 1))
    corrected[:, :3, :3] = turns.as_matrix() @ path[:, :3, :3]
    corrected[:, :3, 3] = path[:, :3, 3] + share[:, None] * shift_m
    return corrected


def spaced_labels(
    scans: Sequence[Scan],
    poses: Poses,
    probability: NDArray[np.float64],
    has_reference_poses: bool,
    reason: str,
) -> PseudoLabels:
    """Label the scans that have a pose (n, 4, 4), thinned to one every STEP_M.

    `probability` (n,) belongs to the poses. Raises NoPseudoLabelsError with the reason if no scan
    has a pose.
    """
    rows = spaced_rows(poses)
    if not rows:
        raise NoPseudoLabelsError(f"nothing to learn of {len(scans)} scans: {reason}")
    stamps_ns = np.array([scans[row].stamp_ns or 0 for row in rows], np.int64)
    true = np.array([scans[row].world_T_scan for row in rows])
    wrong = np.isfinite(true).all((1, 2)) & ~OF_SCANS.right(poses[rows], true)
    points = tuple(finite(scans[row].points()) for row in rows)
    return PseudoLabels(
        points, stamps_ns, poses[rows], probability[rows], wrong, has_reference_poses, len(scans)
    )


def spaced_rows(poses: Poses) -> list[int]:
    """The rows of known poses (n, 4, 4), each at least STEP_M from the row chosen before."""
    rows: list[int] = []
    for row in np.flatnonzero(np.isfinite(poses).all((1, 2))).tolist():
        if not rows or np.linalg.norm(poses[row, :2, 3] - poses[rows[-1], :2, 3]) >= STEP_M:
            rows.append(row)
    return rows
