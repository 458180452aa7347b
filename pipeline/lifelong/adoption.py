"""Adoption: which scans of a later day a site learns, and at which poses (METHODS 11.2).

The poses are known by survey, or found by the site itself and believed.
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

    It may miss the next pose by 2 m and 5°, an error that is spread over the way. The chance is
    that of the less sure end.
    """
    posed_rows = np.flatnonzero(np.isfinite(poses).all((1, 2)))
    for first, last in zip(posed_rows[:-1].tolist(), posed_rows[1:].tolist(), strict=True):
        onwards = poses[first] @ np.linalg.inv(odom_T_scan[first]) @ odom_T_scan[first : last + 1]
        away_m, turn_deg = distance_and_turn(onwards[-1:], poses[last][None])
        if last - first < 2 or not (
            np.isfinite(onwards).all() and away_m[0] < RIGHT_M and turn_deg[0] < RIGHT_DEG
        ):
            continue
        way_m = np.cumsum(np.linalg.norm(np.diff(onwards[:, :3, 3], axis=0), axis=1))
        share = way_m[:-1] / max(way_m[-1], 1e-9)
        between = slice(first + 1, last)
        correction = poses[last] @ np.linalg.inv(onwards[-1])
        turned = Slerp([0, 1], Rotation.from_matrix([np.eye(3), correction[:3, :3]]))(
            share
        ).as_matrix()
        corrected = (correction @ onwards[1:-1])[:, :3, 3]
        poses[between] = np.eye(4)
        poses[between, :3, :3] = turned @ onwards[1:-1, :3, :3]
        poses[between, :3, 3] = onwards[1:-1, :3, 3] + share[:, None] * (
            corrected - onwards[1:-1, :3, 3]
        )
        chance[between] = min(chance[first], chance[last])


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
