"""Diagnoses a cloud: its key numbers, and warnings on everything that would break a method."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection import symptoms
from pipeline.inspection.beams import find_beams
from pipeline.inspection.inspection import Section, metres, typographic

MANY = 1_000
"""A scan of a spinning LiDAR has at least so many points."""


@dataclass(frozen=True)
class Diagnosis:
    """Key numbers of one cloud, in metres and in its own frame; NaN or None where unknown."""

    points: int
    range_m: tuple[float, float, float]
    """Median, 99th percentile and largest distance from the origin in the xy plane."""
    z_m: tuple[float, float, float]
    """1st, 50th and 99th percentile."""
    azimuth_deg: float
    """Degrees of azimuth with points: 360 minus all gaps wider than 3°."""
    beams: int | None
    """By the laser ids, or an estimate of the beams with returns."""
    ground_m: float
    """z of the ground near the sensor."""
    sensor_m: float
    """The sensor's height over the ground."""
    warnings: tuple[str, ...]
    has_laser_ids: bool = False
    """Whether `beams` is by the laser ids."""

    def section(self, title: str = "cloud") -> Section:
        """The numbers as rows of text."""
        low, mid, high = self.z_m
        source = "laser ids" if self.has_laser_ids else "with returns, estimated"
        rows = [
            ("points", f"{self.points:,}"),
            ("range", "median {}, 99 % {}, farthest {}".format(*map(_length, self.range_m))),
            ("height", f"1 % {low:.2f} m, median {mid:.2f} m, 99 % {high:.2f} m"),
            ("azimuth", f"{self.azimuth_deg:.0f}° of 360° covered"),
            ("beams", "unknown: the points form no rings" if self.beams is None else f"{self.beams} ({source})"),
            ("ground", "unknown" if np.isnan(self.ground_m) else f"at z = {_signed(self.ground_m)} m"),
        ]
        if np.isfinite(self.sensor_m):
            rows.append(("sensor", f"{self.sensor_m:.2f} m over the ground (estimated)"))
        return Section(title, tuple(rows))


def diagnose(points_m: NDArray[np.floating], lasers: NDArray[np.uint8] | None = None) -> Diagnosis:
    """Diagnose a cloud (n, 3) in metres that should be in the vehicle frame: x forward, y left, z up, ground at z = 0.

    `lasers` (n,) are the ids of the beams, from 0, where the file has them; otherwise the beams are estimated.
    """
    finite = np.isfinite(points_m).all(axis=1)
    points = np.asarray(points_m[finite], np.float64)
    warnings: list[str] = []
    if not finite.all():
        warnings.append(
            f"NaN/inf points: {int((~finite).sum()):,} of {len(finite):,} are not finite and poison every maximum and mean; "
            "drop them when reading"
        )
    if len(points) < MANY:
        warnings.append(f"fewer than {MANY:,} points: {len(points)}; most bins of a view would be empty: is the file cut short?")
    nan = float("nan")
    if not len(points):
        return Diagnosis(0, (nan, nan, nan), (nan, nan, nan), 0.0, None, nan, nan, tuple(warnings))
    warnings += symptoms.repeated(points)
    range_m = np.hypot(points[:, 0], points[:, 1])
    low, mid, high = (float(value) for value in np.percentile(points[:, 2], (1, 50, 99)))
    ranges = (float(np.median(range_m)), float(np.percentile(range_m, 99)), float(range_m.max()))
    covered = symptoms.coverage(points[range_m > 0])
    beams = None if lasers is None else int(lasers.max(initial=0)) + 1
    ground, sensor = nan, nan
    shape = symptoms.scale(points, range_m) or symptoms.flat(points)
    if shape:
        warnings.append(shape)
    else:
        ground = symptoms.ground(points, range_m)
        down = (ground - low) > 1.0 and (ground - low) > 2 * (high - ground)
        found = find_beams(points, ground, -1.0 if down else 1.0)
        if found is not None:
            beams, sensor = beams or found.count, abs(found.height_m - ground)
        if down:
            warnings.append(
                f"z points down: it hangs from z = {_signed(ground)} m to {_signed(low)} m; every highest z is the ground's: "
                "turn it by (x, −y, −z)"
            )
        if abs(ground) > 0.5:
            warnings.append(
                f"ground at z = {_signed(ground)} m, not 0: heights in every view would be off by as much; "
                f"raise the points by {_signed(-ground)} m (lidar_height_m, lift_m of the dataset's yaml)"
            )
        if covered < 300:
            warnings.append(
                f"not all round: {covered:.0f}° of 360° covered; a turned vehicle sees another part of the place, so no shift of "
                "the columns brings it back: gather several scans, or query in the training's direction"
            )
        elif beams is not None and beams <= 20:
            warnings.append(
                f"{beams} beams: far rings hold fewer than the 5 points that a bin needs; widen the rings, or gather "
                "several scans into one submap"
            )
    return Diagnosis(len(points), ranges, (low, mid, high), covered, beams, ground, sensor, tuple(warnings), lasers is not None)


def _signed(value: float) -> str:
    return typographic(f"{value:+.2f}")


def _length(value: float) -> str:
    return "none" if np.isnan(value) else metres(value)
