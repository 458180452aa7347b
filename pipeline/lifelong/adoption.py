"""Adoption: which scans of a later day a site is to learn, and at which poses (METHODS 11.2).

With a survey, scans are adopted at its poses. Without one, the site localises the drive itself:

1. Follow the drive through the site, once as it came and once backwards.
2. Take for each scan the surer of its two fixes, if it keeps the promise.
3. Fill the gaps between two fixes by odometry, where it leads from the one to the other.
4. Thin the scans that have a pose to one every STEP_M.

growth.py then makes the site learn these scans.
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
"""Adopted scans are at least this far apart: a little less than two submaps are."""


class NothingAdoptedError(LogError):
    """No scan of a drive can be learned."""


@dataclass(frozen=True)
class Adoption:
    """Scans of one day that a site is to learn, a row each."""

    points: tuple[Points, ...]
    """(n, 3) each: x forward, y left, z up from the ground, in metres."""
    stamps_ns: Stamps
    world_T_scan: Poses
    """(scan, 4, 4) the poses that they are learned at."""
    chance: NDArray[np.float64]
    """(scan,) the chance that the pose is right; 1 for a pose of a survey."""
    wrong: NDArray[np.bool_]
    """(scan,) True where the pose is over 2 m or 5° off the log's true one; False if unknown."""
    surveyed: bool
    """Whether the poses are of a survey: only these can bring places that the site does not have.
    """
    scan_count: int
    """The number of all scans of the day, adopted or not."""

    def views(self, site: Site) -> Rows:
        """What the site's method sees in each scan."""
        return Rows(
            np.stack([site.view(points_m) for points_m in self.points]),
            self.stamps_ns,
            self.world_T_scan,
        )


def adopted(site: Site, scans: Sequence[Scan], promise: float | None = 0.99) -> Adoption:
    """Adopt scans of one drive at the site's own fixes, where these keep a promise.

    Without a promise every fix that has a pose will do. Raises NothingAdoptedError where no scan is
    adopted, or the site cannot make that promise.
    """
    if promise is not None and promise not in site.promises:
        raise NothingAdoptedError(
            f"nothing to learn of {len(scans)} scans: the site cannot promise {promise:g}"
        )
    forwards = followed(site, scans, promise)
    backwards = followed(site, scans[::-1], promise)[::-1]
    poses = np.tile(NO_POSE, (len(scans), 1, 1))
    chance = np.zeros(len(scans))
    for row, two_fixes in enumerate(zip(forwards, backwards, strict=True)):
        believed_fixes = [fix for fix in two_fixes if accepts(fix, promise)]
        if believed_fixes:
            surer_fix = min(believed_fixes, key=lambda fix: fix.novelty)
            poses[row] = surer_fix.world_T_sensor
            chance[row] = surer_fix.chance
    odom_T_scan = np.array([scan.odom_T_scan for scan in scans]).reshape(-1, 4, 4)
    bridge(poses, chance, odom_T_scan)
    return spaced_adoption(scans, poses, chance, False, "no fix is believed")


def surveyed(scans: Sequence[Scan], poses: Trajectory | None = None) -> Adoption:
    """Adopt the scans of a drive at the poses of a survey.

    These are `poses` at the stamps of the scans, or the log's own true poses. Raises
    NothingAdoptedError where no scan has one.
    """
    if poses is None:
        world_T_scan = np.array([scan.world_T_scan for scan in scans]).reshape(-1, 4, 4)
    else:
        # no survey has a pose at −1
        stamps_ns = [-1 if scan.stamp_ns is None else scan.stamp_ns for scan in scans]
        world_T_scan, _ = poses.at(np.array(stamps_ns, np.int64))
    chance = np.ones(len(scans))
    return spaced_adoption(scans, world_T_scan, chance, True, "the survey has a pose of none")


def followed(site: Site, scans: Sequence[Scan], promise: float | None) -> list[Fix]:
    """The fix of each scan, by a tracker that follows them in this order."""
    tracker = Tracker(site, promise or min(site.promises, default=None))
    return [tracker.follow(scan, scan.points()) for scan in scans]


def accepts(fix: Fix, promise: float | None) -> bool:
    """Whether a scan may be adopted at a fix: it is accepted, or if no promise is asked, a pose."""
    return fix.verdict == "accepted" if promise else fix.verdict != "no pose"


def bridge(poses: Poses, chance: NDArray[np.float64], odom_T_scan: Poses) -> None:
    """Fill gaps (NaN) in poses (n, 4, 4), and their chances (n,), by odometry (n, 4, 4), in place.

    A gap is filled where odometry leads from the pose before it to the one after it within 2 m and
    5°. What it is off is spread over the path. The chance of a filled pose is that of the less sure
    end.
    """
    posed_rows = np.flatnonzero(np.isfinite(poses).all((1, 2)))
    for first, last in zip(posed_rows[:-1].tolist(), posed_rows[1:].tolist(), strict=True):
        if last - first < 2:
            continue
        world_T_odom = poses[first] @ np.linalg.inv(odom_T_scan[first])
        by_odometry = world_T_odom @ odom_T_scan[first : last + 1]
        is_near_enough = OF_SCANS.right(by_odometry[-1:], poses[last][None])[0]
        if np.isfinite(by_odometry).all() and is_near_enough:
            between = slice(first + 1, last)
            poses[between] = _corrected(by_odometry, poses[last])[1:-1]
            chance[between] = min(chance[first], chance[last])


def _corrected(path: Poses, last: Poses) -> Poses:
    """A path (n, 4, 4) of odometry, bent in proportion to its length to end at `last` (4, 4)."""
    path_m = travelled_m(path[:, :3, 3])
    share = path_m / max(path_m[-1], 1e-9)  # a robot that stood still gets none
    correction = last @ np.linalg.inv(path[-1])
    turns = Slerp([0, 1], Rotation.from_matrix([np.eye(3), correction[:3, :3]]))(share)
    shift_m = (correction @ path)[:, :3, 3] - path[:, :3, 3]
    corrected = np.tile(np.eye(4), (len(path), 1, 1))
    corrected[:, :3, :3] = turns.as_matrix() @ path[:, :3, :3]
    corrected[:, :3, 3] = path[:, :3, 3] + share[:, None] * shift_m
    return corrected


def spaced_adoption(
    scans: Sequence[Scan], poses: Poses, chance: NDArray[np.float64], surveyed: bool, reason: str
) -> Adoption:
    """Adopt the scans that have a pose (n, 4, 4) and lie STEP_M or more from the last adopted one.

    `chance` (n,) is that of the poses. Raises NothingAdoptedError with the reason where no scan has
    a pose.
    """
    rows: list[int] = []
    for row in np.flatnonzero(np.isfinite(poses).all((1, 2))).tolist():
        if not rows or np.linalg.norm(poses[row, :2, 3] - poses[rows[-1], :2, 3]) >= STEP_M:
            rows.append(row)
    if not rows:
        raise NothingAdoptedError(f"nothing to learn of {len(scans)} scans: {reason}")
    stamps_ns = np.array([scans[row].stamp_ns or 0 for row in rows], np.int64)
    true = np.array([scans[row].world_T_scan for row in rows])
    wrong = np.isfinite(true).all((1, 2)) & ~OF_SCANS.right(poses[rows], true)
    points = tuple(finite(scans[row].points()) for row in rows)
    return Adoption(points, stamps_ns, poses[rows], chance[rows], wrong, surveyed, len(scans))
