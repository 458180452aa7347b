"""Tests a cloud for symptoms, such as NaN or a wrong unit: points in; a sentence on each fault out.

`cloud` runs the tests, some of which need numbers that it has computed: the ground, the beams.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.inspection import typographic
from pipeline.mapping.appearance import LEVEL_M, measure_thickness_m

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


TEXTS = {
    Kind.NOT_FINITE: "NaN/inf points: {0:,} of {1:,} are not finite and poison every maximum and "
    "mean; drop them when reading",
    Kind.FEW_POINTS: f"fewer than {MIN_POINTS:,} points: {{0}}; most bins of a view would be "
    "empty: is the file cut short?",
    Kind.AT_ORIGIN: "points at the origin: {0:,} of {1:,} are (0, 0, 0), beams without a return; "
    "they fill the first bin: drop them when reading",
    Kind.DUPLICATES: "duplicate points: {0:,} of {1:,} stand where another does and count twice in "
    "a bin; was a scan written twice, or padded?",
    Kind.NORMALISED: "normalised cloud: every coordinate within ±1; metres are lost, and so are "
    "rings and heights: use the cloud from before the normalisation",
    Kind.NOT_METRES: "not in metres: half of the points are beyond {0:,.0f} m, farther than a "
    "LiDAR sees; are they in millimetres, or in world coordinates?",
    Kind.FLAT: "all points in one plane: {0:.1f} cm thick; there are no heights to draw a view "
    "from: a 2D scan? Gather its sweeps along the path first",
    Kind.DOWN: "z points down: it hangs from z = {0} m to {1} m; every highest z is the ground's: "
    "turn it by (x, −y, −z)",
    Kind.GROUND: "ground at z = {0} m, not 0: heights in every view would be off by as much; add "
    "{1} m to lift_m (of KITTI lidar_height_m) in the dataset's yaml",
    Kind.NOT_ROUND: "not all round: {0:.0f}° of 360° covered; a turned vehicle sees another part "
    "of the place, so no shift of the columns brings it back: gather several scans, or query in "
    "the training's direction",
    Kind.BEAMS: "{0} beams: far rings hold fewer than the 5 points that a bin needs; widen the "
    "rings, or gather several scans into one submap",
}
"""The sentence on each kind of symptom, with the numbers of the cloud."""


@dataclass(frozen=True)
class Symptom:
    """What is wrong with a cloud, and a sentence on it for its user."""

    kind: Kind
    text: str

    @classmethod
    def of(cls, kind: Kind, *numbers: object) -> "Symptom":
        """The symptom with the numbers that the sentence on its kind says."""
        return cls(kind, TEXTS[kind].format(*numbers))


def of_points(count: int, points: NDArray[np.float64]) -> Iterator[Symptom]:
    """Symptoms of a cloud of `count` points whose finite ones are `points` (n, 3).

    Some may be missing, lie at the origin, or be there twice.
    """
    if len(points) < count:
        yield Symptom.of(Kind.NOT_FINITE, count - len(points), count)
    if len(points) < MIN_POINTS:
        yield Symptom.of(Kind.FEW_POINTS, len(points))
    off_origin = points[(points != 0).any(axis=1)]
    comparable: NDArray[Any] = off_origin
    if off_origin.flags.c_contiguous:
        comparable = off_origin.view([("xyz", "V24")])  # points as bytes, which sort faster
    zero_count = len(points) - len(off_origin)
    duplicate_count = len(off_origin) - len(np.unique(comparable, axis=0))
    for kind, repeated_count in ((Kind.AT_ORIGIN, zero_count), (Kind.DUPLICATES, duplicate_count)):
        if repeated_count > MAX_REPEATED_SHARE * len(points):
            yield Symptom.of(kind, repeated_count, len(points))


def unit_or_shape(points: NDArray[np.float64], range_m: NDArray[np.float64]) -> Symptom | None:
    """A symptom if the unit of points (n, 3) cannot be metres, or they lie in one plane, else None.

    `range_m` (n,) are their distances from the origin in the xy plane.
    """
    if np.abs(points).max() <= 1.0 + 1e-6:  # ±1, as a cloud is normalised to, and rounding
        return Symptom.of(Kind.NORMALISED)
    if np.median(range_m) > FARTHEST_M:
        return Symptom.of(Kind.NOT_METRES, np.median(range_m))
    thickness_m = measure_thickness_m(points)
    return Symptom.of(Kind.FLAT, 100 * thickness_m) if thickness_m <= LEVEL_M else None


def of_view(azimuth_deg: float, beams: int | None) -> Iterator[Symptom]:
    """A symptom of a sensor that does not see all round, or has few beams; None if not known."""
    if azimuth_deg < ALL_ROUND_DEG:
        yield Symptom.of(Kind.NOT_ROUND, azimuth_deg)
    elif beams is not None and beams <= FEW_BEAMS:
        yield Symptom.of(Kind.BEAMS, beams)


def signed(height_m: float) -> str:
    """A height with its sign: +1.73."""
    return typographic(f"{height_m:+.2f}")
