"""One drive along a plan: a Segway that keeps to the right, never twice on the same line, and rocks as it balances."""

from dataclasses import dataclass
from datetime import UTC, date, datetime, time

import numpy as np
from numpy.typing import NDArray

from pipeline.frames import Poses, Stamps, pose
from pipeline.world.ground import Ground
from pipeline.world.noise import smooth, wander
from pipeline.world.seeds import Stream, generator

SPEED_MPS = 1.3
KNOTS_HZ = 10
KNOT_M = SPEED_MPS / KNOTS_HZ
LEAD_S = 2.0
"""How long the truth runs before the first scan and after the last."""
DEPARTURE = time(14, tzinfo=UTC)

LINE_STEP_M = 0.25
CORNER_M = 7.0
KEEP_RIGHT_M, BIAS_SD_M = 0.8, 0.5
OFFSET_SD_M, OFFSET_CORRELATION_M, OFFSET_CLIP_M = 0.8, 25.0, 3.0
OFFSET_SMOOTHING_M, OFFSET_RESTORED = 20.0, 1.25
"""The offset is smoothed, so that the robot weaves and does not jitter; the factor gives back the spread that this costs."""

ROLL_SD_DEG, PITCH_SD_DEG, TILT_CORRELATION_M, TILT_CLIP_DEG = 1.2, 1.8, 3.0, 5.0
HEADING_SD_DEG, HEADING_CORRELATION_M, HEADING_CLIP_DEG = 3.0, 6.0, 11.5

PILOT_BEHIND_M, PILOT_RANGE_SD_M, PILOT_RANGE_CORRELATION_M, PILOT_RANGE_CLIP_M = 1.7, 0.3, 10.0, 0.6
PILOT_BEARING_SD_DEG, PILOT_BEARING_CORRELATION_M, PILOT_BEARING_CLIP_DEG = 17.0, 15.0, 69.0
PILOT_SIDE_SD_DEG = 20.0


@dataclass(frozen=True)
class Drive:
    """True poses at KNOTS_HZ and at every scan's stamp, so that interpolation between rows meets the scans exactly."""

    utimes: Stamps
    """(k,) microseconds since 1970, increasing."""
    world_T_body: Poses
    """(k, 4, 4) z up, origin on the ground under the robot."""
    scan_rows: NDArray[np.int64]
    """(n,) the rows at which the lidar scans."""
    pilot_m: NDArray[np.float64]
    """(n, 2) where the pilot walks, in the world, at each scan."""

    def time_s(self, scan: int) -> float:
        """Seconds into the drive at which a scan is taken."""
        return float(self.utimes[self.scan_rows[scan]] - self.utimes[0]) / 1e6

    @property
    def metres(self) -> float:
        """Path length from the first scan to the last."""
        places = self.world_T_body[self.scan_rows[0] : self.scan_rows[-1] + 1, :2, 3]
        return float(np.hypot(*np.diff(places, axis=0).T).sum())


def drive(seed: int, day: date, line_m: NDArray[np.float64], ground: Ground, route_m: float, step_m: float) -> Drive:
    """Drive the polyline `line_m` (n, 2) for `route_m` metres, or to its end, with a scan every `step_m`."""
    rng = generator(seed, Stream.DRIVE, day)
    path_m, heading = _path(rng, line_m)
    length_m = LINE_STEP_M * (len(path_m) - 1)
    lead_m = SPEED_MPS * LEAD_S
    scans = max(1, int(np.floor((min(route_m, length_m - 2 * lead_m) + 1e-6) / step_m)))
    end_m = min(2 * lead_m + scans * step_m, length_m)

    grid_m = np.arange(0, end_m, KNOT_M)
    rocking = _rocking(rng, len(grid_m))
    scan_us = np.rint(1e6 * (lead_m + np.arange(scans) * step_m) / SPEED_MPS).astype(np.int64)
    knots_us = np.union1d(np.rint(1e6 * grid_m / SPEED_MPS).astype(np.int64), scan_us)
    knots_m = knots_us * 1e-6 * SPEED_MPS

    stations_m = LINE_STEP_M * np.arange(len(path_m))
    xy_m = np.stack([np.interp(knots_m, stations_m, path_m[:, axis]) for axis in (0, 1)], 1)
    tilt = np.stack([np.interp(knots_m, grid_m, rocking[:, axis]) for axis in range(3)], 1)
    tilt[:, 2] += np.interp(knots_m, stations_m, heading)
    poses = pose(np.column_stack([xy_m, ground.at(xy_m)]), tilt)

    rows = np.searchsorted(knots_us, scan_us)
    departure_us = int(datetime.combine(day, DEPARTURE).timestamp()) * 1_000_000
    pilot_m = _pilot(generator(seed, Stream.PILOT, day), xy_m[rows], np.interp(knots_m[rows], stations_m, heading), step_m)
    return Drive(departure_us + knots_us, poses, rows, pilot_m)


def _path(rng: np.random.Generator, line_m: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places (n, 2) every LINE_STEP_M of the path really driven along `line_m`, and the heading (n,) there, unwrapped."""
    middle_m = _resample(line_m)
    middle_m = np.stack([smooth(middle_m[:, axis], round(CORNER_M / LINE_STEP_M)) for axis in (0, 1)], 1)
    along = np.gradient(middle_m, axis=0)
    along /= np.hypot(*along.T)[:, None] + 1e-9
    weave_m = wander(rng, len(middle_m), LINE_STEP_M, OFFSET_SD_M, OFFSET_CORRELATION_M, OFFSET_CLIP_M)
    weave_m = OFFSET_RESTORED * smooth(weave_m, round(OFFSET_SMOOTHING_M / LINE_STEP_M))
    left_m = (-KEEP_RIGHT_M + rng.normal(0, BIAS_SD_M) + weave_m).clip(-OFFSET_CLIP_M, OFFSET_CLIP_M)
    path_m = _resample(middle_m + left_m[:, None] * np.stack([-along[:, 1], along[:, 0]], 1))
    tangent = np.gradient(path_m, axis=0)
    return path_m, np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))


def _resample(line_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points (n, 2) every LINE_STEP_M along a polyline."""
    driven_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line_m, axis=0).T))])
    stations_m = np.arange(0, driven_m[-1], LINE_STEP_M)
    return np.stack([np.interp(stations_m, driven_m, line_m[:, axis]) for axis in (0, 1)], 1)


def _rocking(rng: np.random.Generator, knots: int) -> NDArray[np.float64]:
    """Roll, pitch and heading noise (knots, 3) in radians, at knots KNOT_M apart."""
    tilts = [wander(rng, knots, KNOT_M, sd, TILT_CORRELATION_M, TILT_CLIP_DEG) for sd in (ROLL_SD_DEG, PITCH_SD_DEG)]
    heading = wander(rng, knots, KNOT_M, HEADING_SD_DEG, HEADING_CORRELATION_M, HEADING_CLIP_DEG)
    return np.deg2rad(np.stack([*tilts, heading], 1))


def _pilot(
    rng: np.random.Generator, xy_m: NDArray[np.float64], heading: NDArray[np.float64], step_m: float
) -> NDArray[np.float64]:
    """Where the pilot walks (n, 2): behind, a little to one side, never quite there."""
    side_deg = rng.normal(0, PILOT_SIDE_SD_DEG)
    bearing_deg = wander(rng, len(xy_m), step_m, PILOT_BEARING_SD_DEG, PILOT_BEARING_CORRELATION_M, PILOT_BEARING_CLIP_DEG)
    range_m = PILOT_BEHIND_M + wander(rng, len(xy_m), step_m, PILOT_RANGE_SD_M, PILOT_RANGE_CORRELATION_M, PILOT_RANGE_CLIP_M)
    towards = heading + np.deg2rad(180.0 + side_deg + bearing_deg)
    return np.asarray(xy_m + range_m[:, None] * np.stack([np.cos(towards), np.sin(towards)], 1))
