"""Adoption (METHODS 11.2): scans of a later day in; those that a site is to learn, with poses, out.

The poses are of a survey, or they are the site's own fixes where it believes them. `growth` makes
the site learn the scans.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from pipeline.core.errors import LogError
from pipeline.core.frames import Poses, Stamps, Trajectory, distance_and_turn
from pipeline.matching.ranking import Rows
from pipeline.online.inputs import NO_POSE, Scan
from pipeline.online.site import Fix, Site, finite
from pipeline.online.tracking import Tracker
from pipeline.posing.registration import Points
from pipeline.posing.verdict import RIGHT_DEG, RIGHT_M, right

STEP_M = 0.8
"""Least path from one adopted scan to the next: a little less than from one submap to the next."""


class NothingAdoptedError(LogError):
    """A drive of which no scan can be learned."""


@dataclass(frozen=True)
class Adoption:
    """Scans of one day that a site is to learn, a row each."""

    points: tuple[Points, ...]
    """(n, 3) each: x forward, y left, z up from the ground, in metres."""
    stamps_ns: Stamps
    world_T_scan: Poses
    chance: NDArray[np.float64]
    """(scan,) that the pose is right; 1 of a survey."""
    wrong: NDArray[np.bool_]
    """(scan,) whether the pose is over 2 m or 5° off the log's own, where it has one."""
    surveyed: bool
    """Whether the poses are given, so that places may be new."""
    scan_count: int
    """Scans of the day, adopted or not."""

    def views(self, site: Site) -> Rows:
        """The scans as the site's method looks at them."""
        return Rows(
            np.stack([site.view(points_m) for points_m in self.points]),
            self.stamps_ns,
            self.world_T_scan,
        )


def adopted(site: Site, scans: Sequence[Scan], promise: float | None = 0.99) -> Adoption:
    """Adopt the scans of one drive whose fixes keep a promise; without one, all that have a pose.

    The drive is followed there and back. Scans between two fixes are adopted where odometry leads
    from one to the other. Raises NothingAdoptedError where there is none, as where the site cannot
    make that promise.
    """
    if promise is not None and promise not in site.promises:
        raise NothingAdoptedError(
            f"nothing to learn of {len(scans)} scans: the site cannot promise {promise:g}"
        )
    passes = followed(site, scans, promise), followed(site, scans[::-1], promise)[::-1]
    believed_fixes = [
        [fix for fix in fixes if accepts(fix, promise)] for fixes in zip(*passes, strict=True)
    ]
    best_fixes = [min(fixes, key=lambda fix: fix.novelty, default=None) for fixes in believed_fixes]
    poses = np.array(
        [NO_POSE if fix is None else fix.world_T_sensor for fix in best_fixes]
    ).reshape(-1, 4, 4)
    chance = np.array([0.0 if fix is None else 1 - fix.novelty for fix in best_fixes])
    bridge(poses, chance, np.array([scan.odom_T_scan for scan in scans]).reshape(-1, 4, 4))
    return spaced_adoption(scans, poses, chance, False, "no fix is believed")


def surveyed(scans: Sequence[Scan], poses: Trajectory | None = None) -> Adoption:
    """Adopt the scans of a drive at surveyed poses, by stamps, or at the log's own poses.

    Raises NothingAdoptedError where none is known.
    """
    world_T_scan = np.array([scan.world_T_scan for scan in scans]).reshape(-1, 4, 4)
    if poses is not None:
        world_T_scan = poses.at(
            np.array([-1 if scan.stamp_ns is None else scan.stamp_ns for scan in scans], np.int64)
        )[0]
    return spaced_adoption(
        scans, world_T_scan, np.ones(len(scans)), True, "the survey has a pose of none"
    )


def followed(site: Site, scans: Sequence[Scan], promise: float | None) -> list[Fix]:
    """Track the scans one after the other, and give the fix of each."""
    tracker = Tracker(site, promise or min(site.promises, default=None))
    return [tracker.follow(scan, scan.points()) for scan in scans]


def accepts(fix: Fix, promise: float | None) -> bool:
    """Whether a fix is to be adopted: accepted, or without a promise, any that has a pose."""
    return fix.verdict == "accepted" if promise else fix.verdict != "no pose"


def bridge(poses: Poses, chance: NDArray[np.float64], odom_T_scan: Poses) -> None:
    """Fill gaps in poses (n, 4, 4) where odometry (n, 4, 4) leads from one known pose to the next.

    Where odometry misses the next pose by 2 m or 5° or more the gap stays. A smaller error is
    spread over the path. The chance (n,) of a filled pose is that of the less sure end.
    """
    posed_rows = np.flatnonzero(np.isfinite(poses).all((1, 2)))
    for first, last in zip(posed_rows[:-1].tolist(), posed_rows[1:].tolist(), strict=True):
        if last - first < 2:
            continue
        world_T_odom = poses[first] @ np.linalg.inv(odom_T_scan[first])
        onwards = world_T_odom @ odom_T_scan[first : last + 1]
        error_m, error_deg = distance_and_turn(onwards[-1:], poses[last][None])
        is_near_enough = error_m[0] < RIGHT_M and error_deg[0] < RIGHT_DEG
        if np.isfinite(onwards).all() and is_near_enough:
            between = slice(first + 1, last)
            poses[between] = _corrected(onwards, poses[last])[1:-1]
            chance[between] = min(chance[first], chance[last])


def _corrected(path: Poses, last: Poses) -> Poses:
    """A path (n, 4, 4) of odometry that ends at the pose `last` (4, 4).

    Its error at the end is spread in proportion to the length of path.
    """
    path_m = np.cumsum([0, *np.linalg.norm(np.diff(path[:, :3, 3], axis=0), axis=1)])
    share = path_m / max(path_m[-1], 1e-9)
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
    """Adopt the scans that have a pose and lie STEP_M or more from the one before.

    Raises NothingAdoptedError with the reason where there is none.
    """
    rows: list[int] = []
    for row in np.flatnonzero(np.isfinite(poses).all((1, 2))).tolist():
        if not rows or np.linalg.norm(poses[row, :2, 3] - poses[rows[-1], :2, 3]) >= STEP_M:
            rows.append(row)
    if not rows:
        raise NothingAdoptedError(f"nothing to learn of {len(scans)} scans: {reason}")
    stamps_ns = np.array([scans[row].stamp_ns or 0 for row in rows], np.int64)
    true = np.array([scans[row].world_T_scan for row in rows])
    wrong = np.isfinite(true).all((1, 2)) & ~right(poses[rows], true)
    points = tuple(finite(scans[row].points()) for row in rows)
    return Adoption(points, stamps_ns, poses[rows], chance[rows], wrong, surveyed, len(scans))
