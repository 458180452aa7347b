"""Tests a cloud for symptoms, such as NaN or a wrong unit: points in; a sentence on each fault out.

`cloud` runs the tests, some of which need numbers that it has computed: the ground, the beams.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.inspection import typographic
from pipeline.mapping.appearance import LEVEL_M, thickness

MIN_POINTS = 1_000
"""A scan of a spinning LiDAR has at least so many points."""
ALL_ROUND_DEG = 300
"""A sensor that sees all round covers at least so many degrees."""
FEW_BEAMS = 20
"""With so many beams or fewer the far rings of a view stay empty."""
MAX_REPEATED_SHARE = 0.01
"""Up to this share of points at the origin, or of duplicate points, is no symptom."""
FARTHEST_M = 500
"""If half of the points are farther away, they are not in metres."""


class Kind(StrEnum):
    """Kinds of symptom; the words are kept in site files, which name the symptoms of their map."""

    NOT_FINITE = "NaN/inf points:"
    FEW_POINTS = "fewer than"
    AT_ORIGIN = "points at"
    DUPLICATES = "duplicate points:"
    NORMALISED = "normalised cloud:"
    NOT_METRES = "not in"
    FLAT = "all points"
    DOWN = "z points"
    GROUND = "ground at"
    NOT_ROUND = "not all"
    BEAMS = "beams"


@dataclass(frozen=True)
class Symptom:
    """What is wrong with a cloud, and a sentence on it for its user."""

    kind: Kind
    text: str


def missing_points(count: int, finite_count: int) -> list[Symptom]:
    """Symptoms of a cloud of `count` points with some not finite, or with too few finite ones."""
    symptoms = []
    if nonfinite_count := count - finite_count:
        text = (
            f"NaN/inf points: {nonfinite_count:,} of {count:,} are not finite and poison every "
            "maximum and mean; drop them when reading"
        )
        symptoms.append(Symptom(Kind.NOT_FINITE, text))
    if finite_count < MIN_POINTS:
        text = (
            f"fewer than {MIN_POINTS:,} points: {finite_count}; most bins of a view would be "
            "empty: is the file cut short?"
        )
        symptoms.append(Symptom(Kind.FEW_POINTS, text))
    return symptoms


def repeated_points(points: NDArray[np.float64]) -> list[Symptom]:
    """Symptoms of a cloud (n, 3) with many points at the origin, or many duplicate points."""
    zero_count = int((points == 0).all(axis=1).sum())
    off_origin = points[(points != 0).any(axis=1)]
    comparable: NDArray[Any] = off_origin
    if off_origin.flags.c_contiguous:
        comparable = off_origin.view([("xyz", "V24")])  # points as bytes, which sort faster
    duplicate_count = len(off_origin) - len(np.unique(comparable, axis=0))
    symptoms = []
    if zero_count > MAX_REPEATED_SHARE * len(points):
        text = (
            f"points at the origin: {zero_count:,} of {len(points):,} are (0, 0, 0), beams without "
            "a return; they fill the first bin: drop them when reading"
        )
        symptoms.append(Symptom(Kind.AT_ORIGIN, text))
    if duplicate_count > MAX_REPEATED_SHARE * len(points):
        text = (
            f"duplicate points: {duplicate_count:,} of {len(points):,} stand where another does "
            "and count twice in a bin; was a scan written twice, or padded?"
        )
        symptoms.append(Symptom(Kind.DUPLICATES, text))
    return symptoms


def wrong_unit(points: NDArray[np.float64], range_m: NDArray[np.float64]) -> Symptom | None:
    """A symptom if the unit of points (n, 3) cannot be metres, else None.

    `range_m` (n,) are their distances from the origin in the xy plane.
    """
    if np.abs(points).max() <= 1.0 + 1e-6:  # ±1, as a cloud is normalised to, and rounding
        return Symptom(
            Kind.NORMALISED,
            "normalised cloud: every coordinate within ±1; metres are lost, and so are rings and "
            "heights: use the cloud from before the normalisation",
        )
    if np.median(range_m) > FARTHEST_M:
        return Symptom(
            Kind.NOT_METRES,
            f"not in metres: half of the points are beyond {np.median(range_m):,.0f} m, farther "
            "than a LiDAR sees; are they in millimetres, or in world coordinates?",
        )
    return None


def flat_cloud(points: NDArray[np.float64]) -> Symptom | None:
    """A symptom if all points (n, 3) lie in one plane, else None."""
    thickness_m = thickness(points)
    if thickness_m > LEVEL_M:
        return None
    return Symptom(
        Kind.FLAT,
        f"all points in one plane: {100 * thickness_m:.1f} cm thick; there are no heights to draw "
        "a view from: a 2D scan? Gather its sweeps along the path first",
    )


def downward_z(ground_m: float, lowest_m: float) -> Symptom:
    """The symptom of a cloud whose z points down: it reaches from its ground to `lowest_m`."""
    return Symptom(
        Kind.DOWN,
        f"z points down: it hangs from z = {signed(ground_m)} m to {signed(lowest_m)} m; every "
        "highest z is the ground's: turn it by (x, −y, −z)",
    )


def raised_ground(ground_m: float) -> Symptom:
    """The symptom of a ground at z = `ground_m`, not at 0."""
    return Symptom(
        Kind.GROUND,
        f"ground at z = {signed(ground_m)} m, not 0: heights in every view would be off by as "
        f"much; add {signed(-ground_m)} m to lift_m (of KITTI lidar_height_m) in the dataset's "
        "yaml",
    )


def limited_view(azimuth_deg: float, beams: int | None) -> list[Symptom]:
    """Symptoms of a sensor that does not see all round, or has few beams; None if not known."""
    if azimuth_deg < ALL_ROUND_DEG:
        text = (
            f"not all round: {azimuth_deg:.0f}° of 360° covered; a turned vehicle sees another "
            "part of the place, so no shift of the columns brings it back: gather several scans, "
            "or query in the training's direction"
        )
        return [Symptom(Kind.NOT_ROUND, text)]
    if beams is not None and beams <= FEW_BEAMS:
        text = (
            f"{beams} beams: far rings hold fewer than the 5 points that a bin needs; widen the "
            "rings, or gather several scans into one submap"
        )
        return [Symptom(Kind.BEAMS, text)]
    return []


def signed(height_m: float) -> str:
    """A height with its sign: +1.73."""
    return typographic(f"{height_m:+.2f}")
