"""Tests of a cloud (n, 3) in metres for single faults."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from pipeline.mapping.appearance import LEVEL_M, thickness


class Kind(StrEnum):
    """Kinds of symptom, by the words that site files keep them under."""

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


def repeated(points: NDArray[np.float64]) -> list[Symptom]:
    """Symptoms of points at the origin and on duplicate points."""
    zeros = int((points == 0).all(axis=1).sum())
    off_origin = points[(points != 0).any(axis=1)]
    duplicates = len(off_origin) - len(
        np.unique(
            off_origin.view([("xyz", "V24")]) if off_origin.flags.c_contiguous else off_origin,
            axis=0,
        )
    )
    symptoms = []
    if zeros > 0.01 * len(points):
        text = (
            f"points at the origin: {zeros:,} of {len(points):,} are (0, 0, 0), beams without a "
            "return; they fill the first bin: drop them when reading"
        )
        symptoms.append(Symptom(Kind.AT_ORIGIN, text))
    if duplicates > 0.01 * len(points):
        text = (
            f"duplicate points: {duplicates:,} of {len(points):,} stand where another does and "
            "count twice in a bin; was a scan written twice, or padded?"
        )
        symptoms.append(Symptom(Kind.DUPLICATES, text))
    return symptoms


def scale(points: NDArray[np.float64], range_m: NDArray[np.float64]) -> Symptom | None:
    """A symptom if the unit cannot be metres, else None.

    `range_m` (n,) are distances from the origin in the xy plane.
    """
    if np.abs(points).max() <= 1.0 + 1e-6:
        return Symptom(
            Kind.NORMALISED,
            "normalised cloud: every coordinate within ±1; metres are lost, and so are rings and "
            "heights: use the cloud from before the normalisation",
        )
    if np.median(range_m) > 500:
        return Symptom(
            Kind.NOT_METRES,
            f"not in metres: half of the points are beyond {np.median(range_m):,.0f} m, farther "
            "than a LiDAR sees; are they in millimetres, or in world coordinates?",
        )
    return None


def flat(points: NDArray[np.float64]) -> Symptom | None:
    """A symptom if all points lie in one plane, else None."""
    thick_m = thickness(points)
    if thick_m > LEVEL_M:
        return None
    return Symptom(
        Kind.FLAT,
        f"all points in one plane: {100 * thick_m:.1f} cm thick; there are no heights to draw a "
        "view from: a 2D scan? Gather its sweeps along the path first",
    )
