"""Odometry by registration: the pose of each scan of a drive, aligned with the scans before it.

In: a log. Out: a `Track`, the poses of its scans in a frame that starts at the first scan (METHODS
12.1). Loops and a graph (loops.py, graph.py) then correct its drift. For each scan:

1. Move its points to its stamp, and thin them to voxels.
2. Guess the step since the scan before: the log's odometry, or the last step once more.
3. Align the scan with the map of the last scans from this guess, by voxelised GICP (Koide et al.,
   ICRA 2021, in small_gicp). This finds the nearest minimum, which may be the wrong one.
4. So check the step by the overlap with the scan before. If the overlap is low for this log, try
   further guesses, and take the one of the largest overlap.
5. If the scan hardly overlaps with either of the two scans before it, take the step of the log's
   odometry. If the log has none, the odometry breaks, and starts again at this scan.
6. Add the scan to the map.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import small_gicp
from numpy.typing import NDArray

from pipeline.core.errors import InputError, LogError
from pipeline.core.frames import Poses, distance_and_turn, interpolate, transformed, turns, yaw
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, Share, checked
from pipeline.matching.shifts import Spectra
from pipeline.posing.registration import Cloud, Points, Registration
from pipeline.readers.deskew import NO_BREAKS, deskewed, scan_at_stamp
from pipeline.readers.log import Log
from pipeline.views.scan_context import ScanContext

REMEMBERED_STEPS = 200
"""The usual overlap is the median over this many of the last steps."""
FIRST_OVERLAP = 0.4
"""The usual overlap before the first step."""
MOST_FACTOR = 3.0
"""After a gap the last step is extended by at most this factor."""
SKEWED_M = 0.05
SKEWED_DEG = 0.5
"""A scan is deskewed once more if its step differs from the guess by more than either of these."""
TURNS_DEG = (45.0, -45.0, 90.0, -90.0)
"""Turns to the left that are tried as guesses."""
REFINED_M = 0.3
REFINED_DEG = 2.0
"""Alignment with the map may move the best of several guesses by less than these; otherwise the
guess is kept."""
WRONG_DEG = 30.0
"""A step that turns against the log's odometry by more than this is refused."""
LYING_NORMAL_Z = 0.8
"""A voxel whose normal has an absolute z of this or more is ground or ceiling. Any other voxel is
standing: it is of a wall, a trunk or a similar object."""
FEWEST_STANDING = 30
"""If a scan has fewer standing voxels, all of its voxels are compared."""
SAMPLED_VOXELS = 500
"""Approximate number of voxels of a scan that are compared for an overlap."""


@dataclass(frozen=True)
class Track:
    """The odometry of one drive of n scans."""

    odom_T_scan: Poses
    """(n, 4, 4) poses; they start again at the identity after a break, and are NaN for a scan that
    cannot be registered."""
    overlap: NDArray[np.float64]
    """(n,) the overlap of each scan with the scan before (`share_standing`); NaN for the first scan
    and for a scan that cannot be registered."""
    by_log: NDArray[np.bool_]
    """(n,) True where the step to a scan is the log's odometry, since the overlap is too small."""
    breaks: NDArray[np.int64]
    """(k,) the scans that cannot be joined with the scan before; odometry starts again there."""
    skipped: dict[str, int]
    """The number of scans without a pose, by reason."""

    @property
    def parts(self) -> NDArray[np.int64]:
        """The part (n,) of each scan: 0 until the first break, then 1 and so on."""
        return np.searchsorted(self.breaks, np.arange(len(self.overlap)), side="right")

    @property
    def usual_overlap(self) -> float:
        """The median overlap of neighbouring scans; 0 if there is only one scan."""
        return float(np.nanmedian(self.overlap)) if len(self.overlap) > 1 else 0.0


@dataclass(frozen=True)
@checked("odometry")
class ScanOdometry:
    """Aligns each scan with the voxel map of the last scans (conf/slam.yaml)."""

    registration: Registration = field(default_factory=Registration)
    """Thins the scans, and aligns a scan with the scan before when several guesses are tried."""
    range_m: Positive = 100.0
    """Points farther from the sensor are left out."""
    map_voxel_m: Positive = 1.0
    """The side of a voxel of the map, which holds one Gaussian."""
    reach_m: Positive = 4.0
    """Largest distance between a point and the mean of a voxel that it is paired with."""
    iterations: Count = 30
    """Largest number of iterations of an alignment."""
    forgotten: Count = 100
    """The map forgets a voxel that this many scans did not touch, so that memory is bounded."""
    usual: Share = 0.7
    """Further guesses are tried if the overlap is below this share of the usual overlap."""
    least: Share = 0.4
    """Two scans do not overlap if their overlap is below this share of the usual overlap."""
    trials: Count = 10
    """Number of first steps at which all guesses are tried, until the usual overlap is known."""

    def along(self, log: Log, watch: Progress, use_log_odometry: bool = True) -> Track:
        """Register all scans of a log, one after the other.

        Raises LogError if most scans have too few points.
        """
        return _DriveOdometry(self, log, use_log_odometry).run(watch)


@dataclass(frozen=True)
class _Step:
    """The motion of a scan since the scan before."""

    cloud: Cloud
    """The scan, deskewed by this motion."""
    last_T_scan: Poses | None
    """(4, 4) the scan's pose in the frame of the scan before; None if they cannot be joined."""
    overlap: float
    """The overlap with the scan before, or with the one before that if it is larger."""
    is_by_log: bool
    """Whether the step is the log's odometry, since the overlap is too small."""


class _DriveOdometry:
    """Registers the scans of one drive in their order, and keeps what the next one needs."""

    def __init__(self, settings: ScanOdometry, log: Log, use_log_odometry: bool) -> None:
        count = len(log.stamps_ns)
        self.settings = settings
        self.log = log
        self.use_log_odometry = use_log_odometry
        # the result, as Track has it
        self.poses = np.full((count, 4, 4), np.nan)
        self.overlap = np.full(count, np.nan)
        self.by_log = np.zeros(count, bool)
        self.breaks: list[int] = []
        self.sparse = 0
        self.unreadable = 0
        # what the next scan's guess, alignment and overlap need
        self.map: small_gicp.GaussianVoxelMap
        self.last_row = -1
        self.last_cloud: Cloud
        self.last_step = np.eye(4)
        self.last_step_s = 0.0
        self.before_last: tuple[Poses, Cloud] | None = None  # pose and cloud
        self.last_overlaps: deque[float] = deque(maxlen=REMEMBERED_STEPS)

    def run(self, watch: Progress) -> Track:
        """Register all scans; raises LogError if most of them have too few points."""
        count = len(self.log.stamps_ns)
        for row in watch.track(range(count), count, "odometry"):
            cloud = self._cloud(row)
            if cloud is None:
                continue
            if self.last_row < 0:
                self._start(row, cloud)
            else:
                step = self._step(row, cloud)
                cloud = step.cloud
                self._add(row, step)
                self.before_last = (self.poses[self.last_row], self.last_cloud)
            self.last_row = row
            self.last_cloud = cloud
        if self.sparse > count / 2:
            raise LogError(
                f"{self.sparse} of {count} scans have fewer than "
                f"{self.settings.registration.least_voxels} voxels of "
                f"{self.settings.registration.voxel_m} m within {self.settings.range_m:g} m: too "
                "few points, or points not in metres (millimetres leave none in range)"
            )
        reasons = {"too few points": self.sparse, "unreadable scan": self.unreadable}
        return Track(
            self.poses,
            self.overlap,
            self.by_log,
            np.array(self.breaks, np.int64),
            {reason: number for reason, number in reasons.items() if number},
        )

    def _cloud(self, row: int, step: Poses | None = None) -> Cloud | None:
        """The scan's points at its stamp, thinned; None if it has too few or cannot be read."""
        try:
            points_m = self._points(row, step)
        except LogError:
            self.unreadable += 1
            return None
        near = np.linalg.norm(points_m, axis=1) < self.settings.range_m
        try:
            return self.settings.registration.prepare(np.ascontiguousarray(points_m[near]))
        except InputError:
            self.sparse += 1
            return None

    def _points(self, row: int, step: Poses | None) -> Points:
        """The scan's points (n, 3) at its stamp, by the log's odometry or by steady motion."""
        if self._is_deskewed_by_log(row):
            return scan_at_stamp(self.log, self.log.odom_T_scan, NO_BREAKS, row)
        points_m = self.log.points(row)
        if self.last_row < 0:
            return np.asarray(points_m, np.float64)
        if step is None:
            step = self._carried_on(row)
        return deskewed(points_m, self.log.times_s(row), step, self._seconds(row))

    def _is_deskewed_by_log(self, row: int) -> bool:
        return self.use_log_odometry and bool(np.isfinite(self.log.odom_T_scan[row]).all())

    def _start(self, row: int, cloud: Cloud) -> None:
        """Begin the odometry and its map at this scan."""
        self.poses[row] = np.eye(4)
        self.last_step = np.eye(4)
        self.last_step_s = 0.0
        self.map = small_gicp.GaussianVoxelMap(self.settings.map_voxel_m)
        self.map.set_lru(self.settings.forgotten, 10)  # it forgets voxels at every 10th scan
        self.map.insert(cloud.points, self.poses[row])

    def _add(self, row: int, step: _Step) -> None:
        """Put the scan after the last one, by its step, and into the map."""
        self.overlap[row] = step.overlap
        if step.last_T_scan is None:
            self.breaks.append(row)
            self._start(row, step.cloud)
            return
        self.poses[row] = self.poses[self.last_row] @ step.last_T_scan
        self.by_log[row] = step.is_by_log
        self.map.insert(step.cloud.points, self.poses[row])
        self.last_step = step.last_T_scan
        self.last_step_s = self._seconds(row)
        if not step.is_by_log:
            self.last_overlaps.append(step.overlap)

    def _step(self, row: int, cloud: Cloud) -> _Step:
        """Find the scan's step since the one before: steps 2 to 5 of this module's docstring."""
        settings = self.settings
        # guess and align
        odometry_step = self._odometry_step(row)
        first_guess = odometry_step if odometry_step is not None else self._carried_on(row)
        last_T_scan = self._aligned(cloud, first_guess)
        # deskew once more, by the step itself, if it was deskewed by a guess far from it
        if self._is_skewed(row, first_guess, last_T_scan):
            cloud = self._cloud(row, last_T_scan) or cloud
            last_T_scan = self._aligned(cloud, last_T_scan)
        # try further guesses if the overlap is low, or the usual overlap not yet known
        overlap = self._overlap(cloud, last_T_scan)
        usual_overlap = float(np.median(self.last_overlaps or FIRST_OVERLAP))
        is_low = overlap < settings.usual * usual_overlap
        if is_low or len(self.last_overlaps) < settings.trials:
            other_step, other_overlap = self._by_guesses(cloud, first_guess)
            if other_overlap > overlap and self._is_allowed(other_step, odometry_step):
                last_T_scan = other_step
                overlap = other_overlap
        # if the scans do not overlap, only the log's odometry can join them
        least_overlap = settings.least * usual_overlap
        if overlap < least_overlap:
            overlap = max(overlap, self._overlap_before_last(cloud, last_T_scan))
        if overlap < least_overlap:
            return _Step(cloud, odometry_step, overlap, is_by_log=odometry_step is not None)
        return _Step(cloud, last_T_scan, overlap, is_by_log=False)

    def _odometry_step(self, row: int) -> Poses | None:
        """The step (4, 4) since the scan before by the log's odometry; None if it has none."""
        if not self.use_log_odometry:
            return None
        between = self.log.odom_T_scan[self.last_row + 1 : row + 1]
        if not np.isfinite(between).all():  # a break in between is marked by NaN, too
            return None
        step = np.linalg.inv(self.log.odom_T_scan[self.last_row]) @ between[-1]
        return step if np.isfinite(step).all() else None

    def _carried_on(self, row: int) -> Poses:
        """The last step (4, 4) once more, scaled by the elapsed time, and turned as by an IMU."""
        seconds = self._seconds(row)
        step = self.last_step
        if self.last_step_s > 0 and seconds > 0:
            factor = np.array([min(seconds / self.last_step_s, MOST_FACTOR)])
            step = np.asarray(interpolate(np.eye(4)[None], self.last_step[None], factor)[0])
        turn_rad = self._imu_turn_rad(row)
        return step if turn_rad is None else turned_by(step, turn_rad)

    def _imu_turn_rad(self, row: int) -> float | None:
        """The angle by which the vehicle turned left since the last scan; None without an IMU."""
        if self.log.heading_rad is None or not self.use_log_odometry:
            return None
        headings_rad = self.log.heading_rad[self.last_row : row + 1]
        if not np.isfinite(headings_rad).all():  # a gap in between is marked by NaN, too
            return None
        return float(headings_rad[-1] - headings_rad[0])

    def _seconds(self, row: int) -> float:
        """The time since the last scan."""
        return float(self.log.stamps_ns[row] - self.log.stamps_ns[self.last_row]) / 1e9

    def _aligned(self, cloud: Cloud, last_T_guess: Poses) -> Poses:
        """The scan's pose in the frame of the scan before, aligned with the map from a guess."""
        odom_T_last = self.poses[self.last_row]
        result = small_gicp.align(
            self.map,
            cloud.points,
            odom_T_last @ last_T_guess,
            max_correspondence_distance=self.settings.reach_m,
            max_iterations=self.settings.iterations,
        )
        return np.asarray(np.linalg.inv(odom_T_last) @ result.T_target_source)

    def _is_skewed(self, row: int, guess: Poses, last_T_scan: Poses) -> bool:
        """Whether a scan was deskewed by a guess that differs much from its step."""
        if self._is_deskewed_by_log(row) or self.log.times_s(row) is None:
            return False
        away_m, turn_deg = distance_and_turn(guess, last_T_scan)
        return bool(away_m > SKEWED_M or turn_deg > SKEWED_DEG)

    def _overlap(self, cloud: Cloud, last_T_scan: Poses) -> float:
        """The overlap of a scan with the scan before."""
        inlier_m = self.settings.registration.inlier_m
        return share_standing(self.last_cloud, cloud, last_T_scan, inlier_m)

    def _overlap_before_last(self, cloud: Cloud, last_T_scan: Poses) -> float:
        """The overlap of a scan with the scan before the last, in case a truck hid the last."""
        if self.before_last is None or self.last_row in self.breaks:
            return 0.0
        odom_T_before, cloud_before = self.before_last
        before_T_scan = np.linalg.inv(odom_T_before) @ self.poses[self.last_row] @ last_T_scan
        inlier_m = self.settings.registration.inlier_m
        return share_standing(cloud_before, cloud, before_T_scan, inlier_m)

    def _is_allowed(self, last_T_scan: Poses, odometry_step: Poses | None) -> bool:
        """Whether a step is within the error of the log's odometry, if the log has any."""
        if odometry_step is None:
            return True
        away_m, turn_deg = distance_and_turn(last_T_scan, odometry_step)
        return bool(away_m < self.settings.reach_m and turn_deg < WRONG_DEG)

    def _by_guesses(self, cloud: Cloud, first_guess: Poses) -> tuple[Poses, float]:
        """Try several guesses; returns the step (4, 4) of the largest overlap, and this overlap."""
        registration = self.settings.registration
        alignments = [
            registration.refine(self.last_cloud, cloud, self._brought_near(cloud, guess))
            for guess in self._guesses(cloud, first_guess)
        ]
        best = max(alignments, key=lambda alignment: alignment.overlap).target_T_source
        by_map = self._aligned(cloud, best)
        moved_m, turned_deg = distance_and_turn(by_map, best)
        step = by_map if moved_m < REFINED_M and turned_deg < REFINED_DEG else best
        return step, self._overlap(cloud, step)

    def _guesses(self, cloud: Cloud, first_guess: Poses) -> Iterator[Poses]:
        """Poses (4, 4) that the scan may have in the frame of the scan before."""
        straight_on = np.eye(4)
        straight_on[:3, 3] = self.last_step[:3, 3]
        standing_still = np.eye(4)
        yield first_guess
        yield self.last_step
        yield straight_on
        yield standing_still
        for turn_deg in (*self._likely_turns_deg(cloud), *TURNS_DEG):
            yield straight_on @ turns(np.deg2rad(np.array([turn_deg])))[0]

    def _likely_turns_deg(self, cloud: Cloud) -> list[float]:
        """The turn since the scan before by Scan Context (Kim and Kim, IROS 2018), if any."""
        view = ScanContext(voxel_m=0.0, min_points=1)
        spectra = Spectra.learned(view(self.last_cloud.xyz_m)[None])
        _, turn_deg = spectra.compare(view(cloud.xyz_m), np.array([0]))
        return [float(turn) for turn in turn_deg if np.isfinite(turn)]

    def _brought_near(self, cloud: Cloud, guess: Poses) -> Poses:
        """A guess, aligned with the scan before by pairs of points: `refine` fails if 45° off."""
        result = small_gicp.align(
            self.last_cloud.points,
            cloud.points,
            self.last_cloud.tree,
            guess,
            max_correspondence_distance=self.settings.reach_m,
            max_iterations=self.settings.iterations,
        )
        return np.asarray(result.T_target_source)


def turned_by(step: Poses, turn_rad: float) -> Poses:
    """A step (4, 4) bent to an arc that turns to the left by `turn_rad`; length and slope stay."""
    more_rad = turn_rad - float(yaw(step))
    bent = turns(np.array([more_rad]))[0] @ step
    # the chord of an arc turns by half as much as its end
    half_turn = turns(np.array([more_rad / 2]))[0]
    bent[:3, 3] = half_turn[:3, :3] @ step[:3, 3]
    return np.asarray(bent)


def share_standing(target: Cloud, source: Cloud, target_T_source: Poses, inlier_m: float) -> float:
    """The overlap of two scans: the share of one scan's standing voxels that the other has too.

    A standing voxel (LYING_NORMAL_Z) counts if it has a voxel of the other scan nearer than
    `inlier_m`. The share is computed in both directions and the larger one counts, since a truck
    before one sensor hides what the other saw.
    """
    source_T_target = np.asarray(np.linalg.inv(target_T_source))
    of_source = _share(target, transformed(target_T_source, standing(source)), inlier_m)
    of_target = _share(source, transformed(source_T_target, standing(target)), inlier_m)
    return max(of_source, of_target)


def standing(cloud: Cloud) -> Points:
    """A sample (m, 3) of the standing voxels of a cloud, which are neither ground nor ceiling.

    Ground fits on ground at any pose, and so is no evidence. If there are few standing voxels, all
    voxels are sampled.
    """
    points_m = cloud.xyz_m
    is_standing = np.abs(cloud.normals[:, 2]) < LYING_NORMAL_Z
    if is_standing.sum() >= FEWEST_STANDING:
        points_m = points_m[is_standing]
    return points_m[:: max(len(points_m) // SAMPLED_VOXELS, 1)]


def _share(cloud: Cloud, points_m: Points, inlier_m: float) -> float:
    """The share of points (n, 3) that lie nearer than `inlier_m` to a voxel of a cloud."""
    _, away_m = cloud.nearest(points_m)
    return float((away_m < inlier_m).mean())
