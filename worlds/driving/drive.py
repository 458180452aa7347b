"""Drives a robot along a plan: a polyline in, its true poses and the stamps of its scans out.

1. Round the corners of the plan, and leave its middle: the robot keeps to the right and weaves, so
   that it never drives twice on the same line.
2. Let it rock: roll, pitch and heading wander as it goes.
3. Interpolate its poses at the knots: at equal times, and at the stamp of each scan. A car also
   follows the slope of the ground there.
4. Let the pilot walk behind it, if it has one.

`reference_poses` gives the poses as a SLAM solution would report them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.core.frames import Poses, Stamps, Trajectory, pose
from worlds import Floats
from worlds.layout.ground import Ground
from worlds.layout.streets import driven_m, points_along
from worlds.seeds import Stream, generator

KNOTS_HZ = 10
"""Knots per second: a knot is a time at which the true pose is given. Each scan has one more."""
LEAD_S = 2.0
"""Seconds of true poses before the first scan and after the last one."""
DEPARTURE = time(14, tzinfo=UTC)
"""Time of a drive whose name is only a date."""

LINE_STEP_M = 0.25
"""Distance between the points of the driven path."""
OFFSET_CORRELATION_M = 25.0
"""Length over which the lateral offset is correlated."""
OFFSET_CLIP_M = 3.0
"""Largest lateral offset, either way."""
OFFSET_SMOOTHING_M = 20.0
"""Length over which the offset is smoothed, so that the robot weaves and does not jitter."""
OFFSET_RESTORED = 1.25
"""Factor that restores the standard deviation which smoothing takes away."""

TILT_CORRELATION_M = 3.0
TILT_CLIP_DEG = 5.0
HEADING_CORRELATION_M = 6.0
HEADING_CLIP_DEG = 11.5
ROCKING_SMOOTHING_S = 1.0
"""Time over which rocking is smoothed if wanted. A body has mass: between moments a tenth of a
second apart it does not start and stop turning."""

PILOT_BEHIND_M = 1.7
"""Mean distance of the pilot from the robot."""
PILOT_RANGE_SD_M = 0.3
PILOT_RANGE_CORRELATION_M = 10.0
PILOT_RANGE_CLIP_M = 0.6
PILOT_BIAS_SD_DEG = 20.0
"""Standard deviation of a constant bearing of the pilot, off straight behind, for each drive."""
PILOT_WANDER_SD_DEG = 17.0
"""Standard deviation of the bearing's wandering within a drive."""
PILOT_WANDER_CORRELATION_M = 15.0
PILOT_WANDER_CLIP_DEG = 69.0

REFERENCE_STEP_M = 10.0
"""Distance between the points at which the error of the reference poses is drawn."""
REFERENCE_CORRELATION_M = 100.0


@dataclass(frozen=True)
class Motion:
    """How a robot moves and rocks; `sd` stands for a standard deviation."""

    speed_mps: float
    corner_m: float
    """Length over which corners are rounded."""
    keep_right_m: float
    """Mean distance to the right of the middle of the street."""
    bias_sd_m: float
    """sd of a constant offset from this distance, for each drive."""
    weave_sd_m: float
    """sd of the weaving about it within a drive."""
    roll_sd_deg: float
    pitch_sd_deg: float
    heading_sd_deg: float
    wheelbase_m: float
    """Length over which it follows the slope of the ground; 0 if it balances upright."""
    keep_off_m: float
    """People and cars do not come nearer than this to its centre."""
    pilot: bool
    """Whether a person walks behind it."""

    @property
    def knot_m(self) -> float:
        """Distance between two true poses."""
        return self.speed_mps / KNOTS_HZ


SEGWAY = Motion(
    speed_mps=1.3,
    corner_m=7.0,
    keep_right_m=0.8,
    bias_sd_m=0.5,
    weave_sd_m=0.8,
    roll_sd_deg=1.2,
    pitch_sd_deg=1.8,
    heading_sd_deg=3.0,
    wheelbase_m=0.0,
    keep_off_m=0.3,
    pilot=True,
)
CAR = Motion(
    speed_mps=8.0,
    corner_m=9.0,
    keep_right_m=1.7,
    bias_sd_m=0.15,
    weave_sd_m=0.25,
    roll_sd_deg=0.4,
    pitch_sd_deg=0.5,
    heading_sd_deg=0.5,
    wheelbase_m=2.7,
    keep_off_m=2.5,
    pilot=False,
)


@dataclass(frozen=True)
class Drive:
    """The true poses of a drive, at KNOTS_HZ and also at the stamp of each scan.

    So poses interpolated at the stamps of scans are exact.
    """

    utimes: Stamps
    """(k,) microseconds since 1970, increasing."""
    world_T_body: Poses
    """(k, 4, 4) poses of the body, z up, whose origin is on the ground under the robot."""
    scan_rows: NDArray[np.int64]
    """(n,) the rows of the poses at which scans are taken."""
    pilot_m: Floats | None = None
    """(n, 2) position of the pilot in the world at each scan; None if there is no pilot."""

    @property
    def scan_utimes(self) -> Stamps:
        """(n,) the stamps of the scans in microseconds."""
        return self.utimes[self.scan_rows]

    def at(self, utimes: Stamps) -> Poses:
        """True poses (m, 4, 4) at any stamps (m,) of the drive, interpolated."""
        trajectory = Trajectory(self.utimes * 1000, self.world_T_body, max_gap_s=LEAD_S)
        world_T_body, _ = trajectory.at(utimes * 1000)
        return world_T_body

    def time_s(self, scan: int) -> float:
        """Seconds from the first true pose to a scan."""
        return float(self.utimes[self.scan_rows[scan]] - self.utimes[0]) / 1e6

    @property
    def length_m(self) -> float:
        """Path length from the first scan to the last."""
        places = self.world_T_body[self.scan_rows[0] : self.scan_rows[-1] + 1, :2, 3]
        return float(np.hypot(*np.diff(places, axis=0).T).sum())


def drive(
    seed: int,
    when: date,
    line_m: Floats,
    ground: Ground,
    route_m: float,
    step_m: float,
    motion: Motion,
    lateral_m: float = 0.0,
    rocks_smoothly: bool = False,
) -> Drive:
    """Drive along the polyline `line_m` (n, 2), with a scan every `step_m`.

    The drive is `route_m` long, or ends with the line. It departs at `when`, or at DEPARTURE if
    that is only a date. It keeps `lateral_m` further to the left than usual, but on the street.
    With `rocks_smoothly` roll, pitch and heading are smoothed in time; scans that are taken on the
    move need that.
    """
    # 1. Find the path, and how many scans fit on it.
    rng = generator(seed, Stream.DRIVE, when)
    path_m, heading = _path(rng, line_m, motion, lateral_m)
    length_m = LINE_STEP_M * (len(path_m) - 1)
    lead_m = motion.speed_mps * LEAD_S
    scanned_m = min(route_m, length_m - 2 * lead_m)
    n_scans = max(1, int(np.floor((scanned_m + 1e-6) / step_m)))  # 1e-6 m against rounding
    end_m = min(2 * lead_m + n_scans * step_m, length_m)

    # 2. Let the robot rock, from one of the knots at equal times to the next.
    grid_m = np.arange(0, end_m, motion.knot_m)
    rocking = _rocking(rng, len(grid_m), motion)
    if rocks_smoothly:
        window = round(ROCKING_SMOOTHING_S * KNOTS_HZ)
        smooth_rocking = _by_column(rocking, lambda angle: _smooth(angle, window))
        # Smoothing takes some of the standard deviations away, which are restored.
        rocking = smooth_rocking * rocking.std(axis=0) / smooth_rocking.std(axis=0)

    # 3. Interpolate its poses at the knots: equal times, and the stamps of the scans.
    scan_m = lead_m + np.arange(n_scans) * step_m
    scan_us = np.rint(1e6 * scan_m / motion.speed_mps).astype(np.int64)
    grid_us = np.rint(1e6 * grid_m / motion.speed_mps).astype(np.int64)
    knots_us = np.union1d(grid_us, scan_us)
    knots_m = knots_us * 1e-6 * motion.speed_mps
    stations_m = LINE_STEP_M * np.arange(len(path_m))
    xy_m = _by_column(path_m, lambda axis_m: np.interp(knots_m, stations_m, axis_m))
    angles = _by_column(rocking, lambda angle: np.interp(knots_m, grid_m, angle))
    angles[:, 2] += np.interp(knots_m, stations_m, heading)
    if motion.wheelbase_m:
        angles[:, :2] += _slope(ground, xy_m, angles[:, 2], motion.wheelbase_m)
    poses = pose(np.column_stack([xy_m, ground.at(*xy_m.T)]), angles)
    rows = np.searchsorted(knots_us, scan_us)
    departure = when if isinstance(when, datetime) else datetime.combine(when, DEPARTURE)
    utimes = int(departure.timestamp()) * 1_000_000 + knots_us

    # 4. Let the pilot walk behind it.
    if not motion.pilot:
        return Drive(utimes, poses, rows)
    pilot_m = _pilot(
        generator(seed, Stream.PILOT, when),
        xy_m[rows],
        np.interp(knots_m[rows], stations_m, heading),
        step_m,
    )
    return Drive(utimes, poses, rows, pilot_m)


def reference_poses(driven: Drive, rng: np.random.Generator, sd_m: float) -> Drive:
    """The drive as a SLAM solution would report it.

    Its positions wander about the true ones, with the standard deviation `sd_m` in x and in y.
    """
    knots_m = driven_m(driven.world_T_body[:, :2, 3])
    world_T_reported = driven.world_T_body.copy()
    count = int(knots_m[-1] / REFERENCE_STEP_M) + 2  # up to beyond the last knot
    points_m = REFERENCE_STEP_M * np.arange(count)
    for axis in (0, 1):
        error_m = _wander(
            rng, count, REFERENCE_STEP_M, sd_m, REFERENCE_CORRELATION_M, clip=3 * sd_m
        )
        world_T_reported[:, axis, 3] += np.interp(knots_m, points_m, error_m)
    return replace(driven, world_T_body=world_T_reported)


def _path(
    rng: np.random.Generator, line_m: Floats, motion: Motion, lateral_m: float
) -> tuple[Floats, Floats]:
    """The driven path: places (n, 2) in metres every LINE_STEP_M, and headings (n,)."""
    middle_m = _resample(line_m)
    corner_samples = round(motion.corner_m / LINE_STEP_M)
    middle_m = _by_column(middle_m, lambda axis_m: _smooth(axis_m, corner_samples))
    along = np.gradient(middle_m, axis=0)
    along /= np.hypot(*along.T)[:, None] + 1e-9  # not 0 where the middle stands still
    weave_m = _wander(
        rng, len(middle_m), LINE_STEP_M, motion.weave_sd_m, OFFSET_CORRELATION_M, OFFSET_CLIP_M
    )
    weave_m = OFFSET_RESTORED * _smooth(weave_m, round(OFFSET_SMOOTHING_M / LINE_STEP_M))
    mean_left_m = lateral_m - motion.keep_right_m + rng.normal(0, motion.bias_sd_m)
    left_m = (mean_left_m + weave_m).clip(-OFFSET_CLIP_M, OFFSET_CLIP_M)
    left = np.stack([-along[:, 1], along[:, 0]], 1)
    path_m = _resample(middle_m + left_m[:, None] * left)
    tangent = np.gradient(path_m, axis=0)
    return path_m, np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))


def _resample(line_m: Floats) -> Floats:
    """Points (m, 2) every LINE_STEP_M along a polyline (n, 2)."""
    return points_along(line_m, np.arange(0, driven_m(line_m)[-1], LINE_STEP_M))


def _by_column(table: Floats, function: Callable[[Floats], Floats]) -> Floats:
    """The columns of a table (n, c), each changed by a function of one column."""
    return np.stack([function(column) for column in table.T], 1)


def _rocking(rng: np.random.Generator, count: int, motion: Motion) -> Floats:
    """Random roll, pitch and heading (count, 3) in radians, at knots `motion.knot_m` apart."""
    tilts_deg = [
        _wander(rng, count, motion.knot_m, sd_deg, TILT_CORRELATION_M, TILT_CLIP_DEG)
        for sd_deg in (motion.roll_sd_deg, motion.pitch_sd_deg)
    ]
    heading_deg = _wander(
        rng, count, motion.knot_m, motion.heading_sd_deg, HEADING_CORRELATION_M, HEADING_CLIP_DEG
    )
    return np.deg2rad(np.stack([*tilts_deg, heading_deg], 1))


def _slope(ground: Ground, xy_m: Floats, heading: Floats, wheelbase_m: float) -> Floats:
    """Roll and pitch (n, 2) in radians of a body that stands on the ground at `xy_m` (n, 2)."""
    ahead_m = wheelbase_m / 2 * np.stack([np.cos(heading), np.sin(heading)], 1)
    left_m = ahead_m[:, ::-1] * (-1, 1)
    rise_to_left_m = ground.at(*(xy_m + left_m).T) - ground.at(*(xy_m - left_m).T)
    rise_ahead_m = ground.at(*(xy_m + ahead_m).T) - ground.at(*(xy_m - ahead_m).T)
    # Roll is positive if the left side is higher, pitch if the front is lower.
    return np.arctan2(np.stack([rise_to_left_m, -rise_ahead_m], 1), wheelbase_m)


def _pilot(rng: np.random.Generator, xy_m: Floats, heading: Floats, step_m: float) -> Floats:
    """Positions (n, 2) in metres of the pilot, who walks at a random place behind the robot."""
    bias_deg = rng.normal(0, PILOT_BIAS_SD_DEG)
    wander_deg = _wander(
        rng,
        len(xy_m),
        step_m,
        PILOT_WANDER_SD_DEG,
        PILOT_WANDER_CORRELATION_M,
        PILOT_WANDER_CLIP_DEG,
    )
    range_m = PILOT_BEHIND_M + _wander(
        rng, len(xy_m), step_m, PILOT_RANGE_SD_M, PILOT_RANGE_CORRELATION_M, PILOT_RANGE_CLIP_M
    )
    bearing = heading + np.deg2rad(180.0 + bias_deg + wander_deg)
    return np.asarray(xy_m + range_m[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], 1))


def _wander(
    rng: np.random.Generator,
    count: int,
    step_m: float,
    sd: float,
    correlation_m: float,
    clip: float,
) -> Floats:
    """A stationary Gauss–Markov process (count,) with the standard deviation `sd`."""
    # value[i] = memory · value[i − 1] + noise[i]; the variance stays the same if that of the noise
    # is 1 − memory² of it.
    memory = np.exp(-step_m / correlation_m)
    noise = rng.normal(0, sd * np.sqrt(1 - memory**2), count)
    noise[0] = rng.normal(0, sd)
    return np.asarray(lfilter([1.0], [1.0, -memory], noise)).clip(-clip, clip)


def _smooth(values: Floats, samples: int) -> Floats:
    """Values (n,) smoothed by a Hann window; beyond the ends the last value goes on."""
    window = np.hanning(samples + 2)[1:-1]  # without the zeros at its ends
    before = np.repeat(values[:1], samples)
    after = np.repeat(values[-1:], samples)
    extended = np.concatenate([before, values, after])
    return np.convolve(extended, window / window.sum(), "same")[samples:-samples]
