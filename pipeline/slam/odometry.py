"""Odometry by registration: each scan is aligned with the voxels of those before it.

Voxelised GICP (Koide et al., ICRA 2021, in small_gicp) finds the nearest minimum from a first
guess, and says nothing where it is the wrong one. So each step is checked: by the overlap of
neighbouring scans, against what is usual in the same log.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import small_gicp
from numpy.typing import NDArray

from pipeline.core.errors import InputError, LogError
from pipeline.core.frames import Poses, distance_and_turn, interpolate, turns
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, Positive, Share, check
from pipeline.matching.shifts import Spectra
from pipeline.posing.registration import Cloud, Points, Registration, moved
from pipeline.readers.deskew import NO_BREAKS, deskewed, scan_at_stamp
from pipeline.readers.log import Log
from pipeline.views.scan_context import ScanContext

REMEMBERED = 200
"""Steps whose median overlap is the usual one."""
REFINED_M = 0.3
REFINED_DEG = 2.0
"""A step from a guess is refined on the map only as long as it stays so near."""
WRONG_DEG = 30.0
"""Odometry is not wrong by more than this in a step, nor by more than the reach."""
FIRST_OVERLAP = 0.4
"""Taken for usual before any step is known."""
MOST_CARRIED = 3.0
"""A last step is carried on at most so many times, over a gap."""
LYING = 0.8
"""A voxel whose normal is this upright or more is ground or ceiling."""
FEWEST_STANDING = 30
SAMPLED = 500
"""So many voxels tell an overlap."""
TURNS_DEG = (45.0, -45.0, 90.0, -90.0)
"""Turns that are guessed where nothing better is known."""
SKEWED_M = 0.05
SKEWED_DEG = 0.5
"""A scan is deskewed anew where its step turns out to be so far from the guess."""


@dataclass(frozen=True)
class Track:
    """The steps of one drive by registration; n scans."""

    odom_T_scan: Poses
    """(n, 4, 4); anew from the identity after a break, NaN of a scan that cannot be registered."""
    overlap: NDArray[np.float64]
    """(n,) share of what stands in a scan that the scan before has too, or the other way round,
    whichever is more; NaN of the first, and of a scan that cannot be registered."""
    by_log: NDArray[np.bool_]
    """(n,) whether the step to this scan is the log's odometry, as its neighbour shows too little
    of the same."""
    breaks: NDArray[np.int64]
    """(k,) scans that join the one before by nothing: there the odometry starts anew."""
    skipped: dict[str, int]
    """Scans without a pose: reason to count."""

    @property
    def parts(self) -> NDArray[np.int64]:
        """The part (n,) of each scan: 0 until the first break, then 1 and so on."""
        return np.searchsorted(self.breaks, np.arange(len(self.overlap)), side="right")


@dataclass(frozen=True)
class ScanOdometry:
    """Aligns each scan with the voxel map of the last ones (conf/slam.yaml)."""

    registration: Registration = field(default_factory=Registration)
    """How guesses are tried against the scan before, and how clouds are thinned."""
    range_m: Positive = 100.0
    """Points farther off are left out."""
    map_voxel_m: Positive = 1.0
    reach_m: Positive = 4.0
    """Largest distance of a point from its voxel's mean."""
    iterations: Count = 30
    forgotten: Count = 100
    """A voxel that so many scans did not touch is forgotten, so that memory is bounded."""
    usual: Share = 0.7
    """Several guesses are tried below this share of the log's median overlap."""
    least: Share = 0.4
    """Below this share neighbours do not overlap."""
    trials: Count = 10
    """First steps at which all guesses are tried, until a median is known."""

    def __post_init__(self) -> None:
        check(self, "odometry")

    def along(self, log: Log, watch: Progress, use_log_odometry: bool = True) -> Track:
        """Register all scans of a log, one after the other.

        Raises LogError where most of them have too few points.
        """
        return _Registering(self, log, use_log_odometry).track(watch)


@dataclass
class _Registering:
    """The state of a drive that is being registered."""

    settings: ScanOdometry
    log: Log
    use_log_odometry: bool
    map: small_gicp.GaussianVoxelMap = field(init=False)
    last_cloud: Cloud = field(init=False)
    before_last: tuple[Poses, Cloud] | None = field(default=None, init=False)
    """The pose and the cloud of the scan before the last."""

    def __post_init__(self) -> None:
        count = len(self.log.stamps_ns)
        self.poses = np.full((count, 4, 4), np.nan)
        self.overlap = np.full(count, np.nan)
        self.by_log = np.zeros(count, bool)
        self.breaks: list[int] = []
        self.sparse = 0
        self.unreadable = 0
        self.usual_overlaps: deque[float] = deque(maxlen=REMEMBERED)
        self.last_row = -1
        self.last_step = np.eye(4)
        self.last_step_s = 0.0

    def track(self, watch: Progress) -> Track:
        count = len(self.log.stamps_ns)
        for row in watch.track(range(count), count, "odometry"):
            cloud = self._cloud(row)
            if cloud is not None:
                cloud = self._add(row, cloud)
                if self.last_row >= 0:
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
        """The scan's thinned points at its stamp; None where it has too few.

        It moved by `step` since the scan before, or as is guessed.
        """
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
        step = self._carried_on(row) if step is None else step
        return deskewed(points_m, self.log.times_s(row), step, self._seconds(row))

    def _is_deskewed_by_log(self, row: int) -> bool:
        return self.use_log_odometry and bool(np.isfinite(self.log.odom_T_scan[row]).all())

    def _add(self, row: int, cloud: Cloud) -> Cloud:
        """Find the scan's pose, and add it to the map; returns its points, deskewed by its step."""
        if self.last_row < 0:
            self._start(row, cloud)
            return cloud
        cloud, last_T_scan, overlap, is_by_log = self._step(row, cloud)
        self.overlap[row] = overlap
        if last_T_scan is None:
            self.breaks.append(row)
            self._start(row, cloud)
            return cloud
        self.poses[row] = self.poses[self.last_row] @ last_T_scan
        self.by_log[row] = is_by_log
        self.map.insert(cloud.points, self.poses[row])
        self.last_step = last_T_scan
        self.last_step_s = self._seconds(row)
        if not is_by_log:
            self.usual_overlaps.append(overlap)
        return cloud

    def _start(self, row: int, cloud: Cloud) -> None:
        """Begin a map at this scan."""
        self.poses[row] = np.eye(4)
        self.last_step = np.eye(4)
        self.last_step_s = 0.0
        self.map = small_gicp.GaussianVoxelMap(self.settings.map_voxel_m)
        self.map.set_lru(self.settings.forgotten, 10)
        self.map.insert(cloud.points, self.poses[row])

    def _step(self, row: int, cloud: Cloud) -> tuple[Cloud, Poses | None, float, bool]:
        """The scan deskewed by its step, that step, their overlap, whether it is the log's.

        The step is the scan's pose in the frame of the one before, None where nothing joins the
        two.
        """
        settings = self.settings
        odometry_step = self._odometry_step(row)
        first_guess = odometry_step if odometry_step is not None else self._carried_on(row)
        last_T_scan = self._aligned(cloud, first_guess)
        if self._is_skewed(row, first_guess, last_T_scan):
            cloud = self._cloud(row, last_T_scan) or cloud
            last_T_scan = self._aligned(cloud, last_T_scan)
        overlap = self._overlap(cloud, last_T_scan)
        usual = self._usual()
        if len(self.usual_overlaps) < settings.trials or overlap < settings.usual * usual:
            tried = self._by_guesses(cloud, first_guess)
            if tried[1] > overlap and self._may_be(tried[0], odometry_step):
                last_T_scan, overlap = tried
        if overlap < settings.least * usual:
            overlap = max(overlap, self._overlap_before_last(cloud, last_T_scan))
        if overlap >= settings.least * usual:
            return cloud, last_T_scan, overlap, False
        return cloud, odometry_step, overlap, odometry_step is not None

    def _is_skewed(self, row: int, guess: Poses, last_T_scan: Poses) -> bool:
        """Whether a scan was deskewed by a guess that its step is far from."""
        if self._is_deskewed_by_log(row) or self.log.times_s(row) is None:
            return False
        away_m, turn_deg = distance_and_turn(guess[None], last_T_scan[None])
        return bool(away_m[0] > SKEWED_M or turn_deg[0] > SKEWED_DEG)

    def _may_be(self, last_T_scan: Poses, odometry_step: Poses | None) -> bool:
        """Whether the log's odometry, if it has any, allows a step."""
        if odometry_step is None:
            return True
        away_m, turn_deg = distance_and_turn(last_T_scan[None], odometry_step[None])
        return bool(away_m[0] < self.settings.reach_m and turn_deg[0] < WRONG_DEG)

    def _by_guesses(self, cloud: Cloud, first_guess: Poses) -> tuple[Poses, float]:
        """The step of the most overlap from several guesses, refined on the map."""
        registration = self.settings.registration
        alignments = [
            registration.refine(self.last_cloud, cloud, self._brought_near(cloud, guess))
            for guess in self._guesses(cloud, first_guess)
        ]
        best = max(alignments, key=lambda alignment: alignment.overlap).target_T_source
        refined = self._aligned(cloud, best)
        moved_m, turned_deg = distance_and_turn(refined[None], best[None])
        is_same = moved_m[0] < REFINED_M and turned_deg[0] < REFINED_DEG
        kept = refined if is_same else best
        return kept, self._overlap(cloud, kept)

    def _brought_near(self, cloud: Cloud, guess: Poses) -> Poses:
        """A guess, aligned with the scan before by pairs of points as far apart as the reach.

        Gaussians of wide cells, with which poses are approached elsewhere, lose turns of 45°.
        """
        result = small_gicp.align(
            self.last_cloud.points,
            cloud.points,
            self.last_cloud.tree,
            guess,
            max_correspondence_distance=self.settings.reach_m,
            max_iterations=self.settings.iterations,
        )
        return np.asarray(result.T_target_source)

    def _guesses(self, cloud: Cloud, first_guess: Poses) -> Iterator[Poses]:
        """Where the scan may stand in the frame of the one before."""
        straight_on = np.eye(4)
        straight_on[:3, 3] = self.last_step[:3, 3]
        yield first_guess
        yield self.last_step
        yield straight_on
        yield np.eye(4)
        for turn_deg in (*self._likely_turns_deg(cloud), *TURNS_DEG):
            yield straight_on @ turns(np.deg2rad(np.array([turn_deg])))[0]

    def _likely_turns_deg(self, cloud: Cloud) -> list[float]:
        """The turn against the scan before by Scan Context (Kim and Kim, IROS 2018)."""
        view = ScanContext(voxel_m=0.0, min_points=1)
        spectra = Spectra.learned(view(self.last_cloud.xyz_m)[None])
        turn_deg = spectra.compare(view(cloud.xyz_m), np.array([0]))[1]
        return [float(turn) for turn in turn_deg if np.isfinite(turn)]

    def _aligned(self, cloud: Cloud, last_T_guess: Poses) -> Poses:
        """The scan's pose in the frame of the one before by the map, from a guess."""
        odom_T_last = self.poses[self.last_row]
        result = small_gicp.align(
            self.map,
            cloud.points,
            odom_T_last @ last_T_guess,
            max_correspondence_distance=self.settings.reach_m,
            max_iterations=self.settings.iterations,
        )
        return np.asarray(np.linalg.inv(odom_T_last) @ result.T_target_source)

    def _overlap(self, cloud: Cloud, last_T_scan: Poses) -> float:
        """The share of what stands in this scan or the last that the other has."""
        inlier_m = self.settings.registration.inlier_m
        return share_standing(self.last_cloud, cloud, last_T_scan, inlier_m)

    def _overlap_before_last(self, cloud: Cloud, last_T_scan: Poses) -> float:
        """The same with the scan before the last: a truck hides what one scan alone might see."""
        if self.before_last is None or self.last_row in self.breaks:
            return 0.0
        odom_T_before, before = self.before_last
        before_T_scan = np.linalg.inv(odom_T_before) @ self.poses[self.last_row] @ last_T_scan
        inlier_m = self.settings.registration.inlier_m
        return share_standing(before, cloud, before_T_scan, inlier_m)

    def _usual(self) -> float:
        return float(np.median(self.usual_overlaps)) if self.usual_overlaps else FIRST_OVERLAP

    def _odometry_step(self, row: int) -> Poses | None:
        """The step from the scan before by the log's odometry; None where it has none."""
        if not self.use_log_odometry:
            return None
        between = self.log.odom_T_scan[self.last_row + 1 : row + 1]
        if not np.isfinite(between).all():  # NaN marks a break in the odometry, too
            return None
        step = np.linalg.inv(self.log.odom_T_scan[self.last_row]) @ between[-1]
        return step if np.isfinite(step).all() else None

    def _carried_on(self, row: int) -> Poses:
        """The last step once more, longer or shorter by the time that has passed.

        Where the log has an IMU it turns as that says.
        """
        seconds = self._seconds(row)
        step = self.last_step
        if self.last_step_s > 0 and seconds > 0:
            share = np.array([min(seconds / self.last_step_s, MOST_CARRIED)])
            step = np.asarray(interpolate(np.eye(4)[None], self.last_step[None], share)[0])
        turn_rad = self._turn_rad(row)
        return step if turn_rad is None else turned_by(step, turn_rad)

    def _turn_rad(self, row: int) -> float | None:
        """How far the vehicle turned to its left since the last scan, by the log's IMU, if any."""
        if self.log.heading_rad is None or not self.use_log_odometry:
            return None
        headings_rad = self.log.heading_rad[self.last_row : row + 1]
        if not np.isfinite(headings_rad).all():  # NaN marks a gap, too
            return None
        return float(headings_rad[-1] - headings_rad[0])

    def _seconds(self, row: int) -> float:
        return float(self.log.stamps_ns[row] - self.log.stamps_ns[self.last_row]) / 1e9


def turned_by(step: Poses, turn_rad: float) -> Poses:
    """A step (4, 4) as long, on an arc that turns to the left by so much; it keeps its slope."""
    was_rad = float(np.arctan2(step[1, 0], step[0, 0]))
    more = turns(np.array([turn_rad - was_rad]))[0]
    half = turns(np.array([(turn_rad - was_rad) / 2]))[0]
    turned = more @ step
    turned[:3, 3] = half[:3, :3] @ step[:3, 3]
    return np.asarray(turned)


def standing(cloud: Cloud) -> Points:
    """A sample (m, 3) of the voxels of a cloud that stand: neither ground nor ceiling.

    Ground lies on ground wherever a scan is laid, and so says nothing. Where hardly anything
    stands, all voxels are taken.
    """
    upright = np.abs(cloud.normals[:, 2]) < LYING
    points_m = cloud.xyz_m[upright] if upright.sum() >= FEWEST_STANDING else cloud.xyz_m
    return points_m[:: max(len(points_m) // SAMPLED, 1)]


def share_standing(target: Cloud, source: Cloud, target_T_source: Poses, inlier_m: float) -> float:
    """The share of one cloud's standing voxels that the other has nearer than `inlier_m`.

    The larger share of the two, for a truck that stands before the sensor hides from one what the
    other saw.
    """
    source_T_target = np.asarray(np.linalg.inv(target_T_source))
    return max(
        _share(target, moved(target_T_source, standing(source)), inlier_m),
        _share(source, moved(source_T_target, standing(target)), inlier_m),
    )


def _share(cloud: Cloud, points_m: Points, inlier_m: float) -> float:
    """The share of points (n, 3) that lie nearer than `inlier_m` to a voxel of a cloud."""
    return float((cloud.nearest(points_m)[1] < inlier_m).mean())
