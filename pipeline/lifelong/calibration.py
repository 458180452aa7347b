"""Calibrates a site: the scans of a real drive in, a verdict learned from their fixes out.

A site of a 3-D map has the usual probabilities only (posing/map_verdict.py). A site that learned a
drive has a verdict of that day. A later drive says how well a real scan fits the map:

1. Each scan has a reference pose: one that is given, or one that other scans confirm. A scan is
   confirmed if odometry from the accepted fix before it reaches the accepted fix behind it, and its
   reference pose lies on this path. Its own fix has no say in it.
2. Each scan is localised alone, in the whole map, and once more in a map without its surroundings:
   a novel place.
3. The verdict is learned from these fixes (METHODS 9.5): of a 3-D map with its models, of a site
   that learned a drive its thresholds alone (posing/later_day.py). Scans of one stretch of some
   metres are one validation block.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, LogError
from pipeline.core.frames import Poses
from pipeline.core.progress import Progress
from pipeline.lifelong.pseudo_labels import accepts, bridged, spaced_rows
from pipeline.matching.ranking import Rows
from pipeline.online.inputs import NO_POSE, Scan
from pipeline.online.site import Site, finite
from pipeline.online.site_json import CalibratedDay, SiteDescription
from pipeline.posing.fix import ScanFix
from pipeline.posing.later_day import Renewed, renewed
from pipeline.posing.map_verdict import calibrated
from pipeline.posing.search import Answers
from pipeline.posing.verdict import OF_SCANS, FixEvidence, Verdict

BLOCK_M = 5.0
"""Scans nearer than this to the first scan of a block are of this block."""
AROUND_M = (20.0, 40.0, 80.0)
"""To make a novel place, the map of a scan lacks what is nearer than one of these distances; the
scans take the distances in turn."""
NOVEL_K = 100
"""Number of ranked positions of which those in the surroundings are left out."""
FEWEST_RIGHT = 0.2
"""If a smaller share of the fixes is right, the reference poses are taken to be of other scans."""
LONGEST_GAP = 20
"""Accepted fixes further apart than this many scans confirm nothing."""


@dataclass(frozen=True)
class Calibration:
    """What a drive taught."""

    verdict: Verdict
    scans: int
    """Number of scans with a reference pose that were localised."""
    right: int
    """How many of them have a right fix."""
    blocks: int
    """Number of validation blocks."""
    renewed: Renewed | None = None
    """What is new in the verdict of a site that learned a drive; None for a 3-D map."""

    @property
    def learned(self) -> tuple[float, ...]:
        """The target precisions whose thresholds the drive taught."""
        if self.renewed is not None:
            return self.renewed.learned
        return tuple(p for p in self.verdict.reachable if p not in self.verdict.usual)

    def line(self, name: str) -> str:
        """Describe it in a line."""
        words = [f"{self.right} of {self.scans} scans with a reference pose have a right fix"]
        words.append(f"{self.blocks} validation blocks")
        words.append(f"learned: {listed(self.learned)}")
        if self.verdict.usual:
            words.append(
                f"by the usual probabilities: {listed(self.verdict.usual)}, for which the blocks "
                "are too few"
            )
        if self.renewed is not None:
            kept = [p for p in self.verdict.reachable if p not in self.learned]
            if kept:
                words.append(f"by the site's own thresholds: {listed(kept)}")
            if self.renewed.lowered:
                words.append(
                    f"lowered, since the drive contradicts them: {listed(self.renewed.lowered)}"
                )
        return f"{name}: {'; '.join(words)}"


def calibration(
    site: Site, scans: Sequence[Scan], world_T_true: Poses, progress: Progress
) -> Calibration:
    """Learn the verdict of a site from scans with reference poses (scan, 4, 4), NaN where unknown.

    Of scans that stand close together the first is taken. Raises LogError if no scan has a
    reference pose, or if hardly any fix is right by them.
    """
    rows = spaced_rows(world_T_true)  # so a robot that stands still counts once
    if not rows:
        raise LogError(f"none of {len(scans)} scans has a reference pose in the map")
    fixes: list[ScanFix] = []
    for number, row in enumerate(progress.track(rows, len(rows), "localise the drive")):
        points_m = finite(scans[row].points())
        around_m = AROUND_M[number % len(AROUND_M)]
        fixes += both_fixes(site, points_m, world_T_true[row, :2, 3], around_m)
    evidence = FixEvidence(
        fixes=fixes,
        world_T_true=world_T_true[rows].repeat(2, axis=0),
        unseen=np.tile([False, True], len(rows)),
        block=blocks(world_T_true[rows, :2, 3]).repeat(2),
    )
    renewal = None
    if site.targets.is_map:
        verdict = calibrated(evidence)
    else:
        renewal = renewed(site.description.verdict, evidence)
        verdict = renewal.verdict
    poses = np.array([fix.ordered(verdict.pose).pose for fix in fixes[::2]])
    right = OF_SCANS.right(poses, world_T_true[rows])
    if right.mean() < FEWEST_RIGHT:
        raise LogError(
            f"{right.sum()} of {len(rows)} scans have a right fix by their reference poses: are "
            "these in the map's frame, and of these scans? Nothing was calibrated"
        )
    return Calibration(verdict, len(rows), int(right.sum()), evidence.blocks, renewal)


def both_fixes(
    site: Site,
    points_m: NDArray[np.float64],
    xy_m: NDArray[np.float64],
    around_m: float,
) -> tuple[ScanFix, ScanFix]:
    """The fix of a scan (n, 3) in the whole map, and in one without `around_m` of a position."""
    rows = Rows(site.view(points_m)[None], np.zeros(1, np.int64), np.eye(4)[None])
    answers = Answers.of(site.localizer(rows, NOVEL_K))
    is_novel = np.linalg.norm(answers.xy_m - xy_m, axis=1) >= around_m
    anchors_m = site.targets.world_T_anchor[:, :2, 3]
    left_out = np.linalg.norm(anchors_m - xy_m, axis=1) < around_m
    seen = Answers(answers.xy_m[: site.k], answers.heading_deg[: site.k])
    novel = Answers(answers.xy_m[is_novel][: site.k], answers.heading_deg[is_novel][: site.k])
    return (
        site.fixer.fix(points_m, site.targets, seen),
        site.fixer.fix(points_m, site.targets, novel, left_out),
    )


def confirmed(site: Site, scans: Sequence[Scan], target_precision: float) -> Poses:
    """The poses (scan, 4, 4) that odometry and other scans' accepted fixes give; NaN without.

    Raises LogError for a drive without odometry.
    """
    odom_T_scan = np.array([scan.odom_T_scan for scan in scans]).reshape(-1, 4, 4)
    if not np.isfinite(odom_T_scan).all(axis=(1, 2)).any():
        raise LogError(
            "the drive has neither reference poses nor odometry, which would confirm its fixes: "
            "give --poses, or --odometry for a bag"
        )
    # each scan alone: a tracked pose would lean on the scans that it is to confirm
    fixes = [site.localize(scan.points(), target_precision) for scan in scans]
    poses = np.array([fix.world_T_sensor for fix in fixes]).reshape(-1, 4, 4)
    poses[[not accepts(fix, target_precision) for fix in fixes]] = NO_POSE
    return between_others(poses, odom_T_scan)


def between_others(poses: Poses, odom_T_scan: Poses) -> Poses:
    """Poses (n, 4, 4) on the path by odometry between the poses before and behind each scan.

    A scan's own pose has no say; NaN where the path by odometry (n, 4, 4) misses the pose behind.
    """
    posed = np.flatnonzero(np.isfinite(poses).all(axis=(1, 2)))
    between = np.tile(NO_POSE, (len(poses), 1, 1))
    for row in range(len(poses)):
        before = posed[posed < row]
        behind = posed[posed > row]
        if not len(before) or not len(behind) or behind[0] - before[-1] > LONGEST_GAP:
            continue
        path = bridged(poses[before[-1]], poses[behind[0]], odom_T_scan[before[-1] : behind[0] + 1])
        if path is not None:
            between[row] = path[row - before[-1]]
    return between


def blocks(xy_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """The validation block (n,) of positions (n, 2) along a drive.

    A position nearer than BLOCK_M to the first of a block is of this block, whenever it was driven:
    a second round through the same streets is no further evidence.
    """
    numbers = np.zeros(len(xy_m), np.int64)
    firsts_m = np.empty((0, 2))
    for row, position_m in enumerate(xy_m):
        away_m = np.linalg.norm(firsts_m - position_m, axis=1)
        if not len(away_m) or away_m.min() >= BLOCK_M:
            numbers[row] = len(firsts_m)
            firsts_m = np.vstack([firsts_m, position_m])
        else:
            numbers[row] = away_m.argmin()
    return numbers


def check_day(site: Site, drive: str) -> None:
    """Raise ConfigError for a drive of a day that the site learned, by its name."""
    description = site.description
    learned_days = {description.provenance.train}
    if description.incremental_learning is not None:
        learned_days |= {day.day for day in description.incremental_learning.days}
    if drive in learned_days:
        raise ConfigError(
            f"{drive}: the site learned this day, so its scans fit better than those of a later "
            "day; calibrate with a day that it did not learn"
        )


def with_verdict(site: Site, learned: Calibration, drive: str) -> SiteDescription:
    """The description of a site with the verdict that a drive taught."""
    description = site.description
    if learned.renewed is None:
        provenance = replace(description.provenance, calibrated_on=drive)
        return replace(description, verdict=learned.verdict, provenance=provenance)
    day = CalibratedDay(drive, learned.blocks, learned.learned, learned.renewed.has_covariances)
    days = (*description.calibrated_days, day)
    return replace(description, verdict=learned.verdict, calibrated_days=days)


def listed(target_precisions: Sequence[float]) -> str:
    """Target precisions in words."""
    return ", ".join(map(str, target_precisions)) or "none"
