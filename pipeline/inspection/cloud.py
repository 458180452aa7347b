"""A cloud's diagnosis: what a scan looks like in numbers, and which of its habits would break a method."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.beams import find_beams
from pipeline.inspection.inspection import Section, metres

MANY = 1_000
"""A scan of fewer points is no scan of a spinning LiDAR."""


@dataclass(frozen=True)
class Diagnosis:
    """Numbers of one cloud, in metres and in its own frame; NaN or None where they cannot be told."""

    points: int
    range_m: tuple[float, float, float]
    """Median, 99th percentile and largest distance from the origin in the xy plane."""
    z_m: tuple[float, float, float]
    """1st, 50th and 99th percentile."""
    azimuth_deg: float
    """How much of the round has points: 360 less every gap wider than 3°."""
    beams: int | None
    """Told by the laser ids, or estimated."""
    ground_m: float
    """z of the ground near the sensor."""
    sensor_m: float
    """The sensor's height over the ground."""
    warnings: tuple[str, ...]

    def section(self, title: str = "cloud") -> Section:
        """As rows."""
        low, mid, high = self.z_m
        rows = [
            ("points", f"{self.points:,}"),
            ("range", "median {}, 99 % {}, farthest {}".format(*map(_length, self.range_m))),
            ("height", f"1 % {low:.2f} m, median {mid:.2f} m, 99 % {high:.2f} m"),
            ("azimuth", f"{self.azimuth_deg:.0f}° of 360° covered"),
            ("beams", "unknown: the points stand in no rings" if self.beams is None else str(self.beams)),
            ("ground", "unknown" if np.isnan(self.ground_m) else f"at z = {_signed(self.ground_m)} m"),
        ]
        if np.isfinite(self.sensor_m):
            rows.append(("sensor", f"{self.sensor_m:.2f} m over the ground (estimated)"))
        return Section(title, tuple(rows))


def diagnose(points_m: NDArray[np.floating], lasers: NDArray[np.uint8] | None = None) -> Diagnosis:
    """Look at a cloud (n, 3) that should be in the vehicle frame: x forward, y left, z up, ground at z = 0.

    `lasers` (n,) are the beams' ids where the sensor tells them; otherwise the beams are estimated.
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
    warnings += _repeated(points)
    range_m = np.hypot(points[:, 0], points[:, 1])
    low, mid, high = (float(value) for value in np.percentile(points[:, 2], (1, 50, 99)))
    ranges = (float(np.median(range_m)), float(np.percentile(range_m, 99)), float(range_m.max()))
    covered = _coverage(points[range_m > 0])
    beams = None if lasers is None else len(np.unique(lasers))
    ground, sensor = nan, nan
    shape = _scale(points, range_m) or _flat(points)
    if shape:
        warnings.append(shape)
    else:
        ground = _ground(points, range_m)
        found = find_beams(points, ground)
        if found is not None:
            beams, sensor = beams or found.count, found.height_m - ground
        down = (ground - low) > 1.0 and (ground - low) > 2 * (high - ground)
        if down:
            sensor = -sensor
            warnings.append(
                f"z points down: the scene hangs from z = {_signed(ground)} m to {_signed(low)} m; every highest z is the ground's: "
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
        if beams is not None and beams <= 20:
            warnings.append(
                f"{beams} beams: far rings hold fewer than the 5 points that a bin needs; widen the rings, or gather "
                "several scans into one submap"
            )
    return Diagnosis(len(points), ranges, (low, mid, high), covered, beams, ground, sensor, tuple(warnings))


def _repeated(points: NDArray[np.float64]) -> list[str]:
    zeros = int((points == 0).all(axis=1).sum())
    others = points[(points != 0).any(axis=1)]
    twice = len(others) - len(np.unique(others.view([("xyz", "V24")]) if others.flags.c_contiguous else others, axis=0))
    found = []
    if zeros > 0.01 * len(points):
        found.append(
            f"points at the origin: {zeros:,} of {len(points):,} are (0, 0, 0), beams without a return; they fill the first bin: "
            "drop them when reading"
        )
    if twice > 0.01 * len(points):
        found.append(
            f"duplicate points: {twice:,} of {len(points):,} stand where another does and count twice in a bin; "
            "was a scan written twice, or padded?"
        )
    return found


def _scale(points: NDArray[np.float64], range_m: NDArray[np.float64]) -> str | None:
    """What is wrong with the unit, if something is."""
    if np.abs(points).max() <= 1.0 + 1e-6:
        return (
            "normalised cloud: every coordinate within ±1; metres are lost, and so are rings and heights: "
            "use the cloud from before the normalisation"
        )
    if np.median(range_m) > 500:
        return (
            f"not in metres: half of the points are beyond {np.median(range_m):,.0f} m, farther than a LiDAR sees; "
            "are they in millimetres, or in world coordinates?"
        )
    return None


def _flat(points: NDArray[np.float64]) -> str | None:
    """Whether every point lies in one plane."""
    spread = np.sqrt(np.linalg.eigvalsh(np.cov(points.T)).clip(0)) if len(points) > 3 else np.ones(3)
    if spread[0] > 0.02:
        return None
    return (
        f"all points in one plane: {100 * spread[0]:.1f} cm thick; there are no heights to draw a view from: a 2D scan? "
        "Gather its sweeps along the path first"
    )


def _ground(points: NDArray[np.float64], range_m: NDArray[np.float64]) -> float:
    """The z where the points near the sensor are densest: floors are flat, walls are not."""
    near = points[range_m < 15.0, 2]
    if len(near) < 100:
        near = points[:, 2]
    z_m = near[np.abs(near - np.median(near)) < 20.0]
    edges = np.arange(z_m.min() - 0.3, z_m.max() + 0.4, 0.05)
    counts = np.convolve(np.histogram(z_m, edges)[0], np.ones(5), "same")
    centre = float(edges[counts.argmax()] + 0.025)
    return float(np.median(z_m[np.abs(z_m - centre) <= 0.2]))


def _coverage(points: NDArray[np.float64]) -> float:
    if not len(points):
        return 0.0
    azimuth = np.sort(np.degrees(np.arctan2(points[:, 1], points[:, 0])))
    gaps = np.diff(azimuth, append=azimuth[0] + 360.0)
    return float(360.0 - gaps[gaps > 3.0].sum())


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−")


def _length(value: float) -> str:
    return "none" if np.isnan(value) else metres(value)
