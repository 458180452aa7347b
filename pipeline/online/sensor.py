"""Whether scans are of a sensor like the one that a site was learned with."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.cloud import RAISED_M, Diagnosis, diagnose

HEIGHT_M, BEAMS, ROUND_DEG = 0.5, 1.5, 60.0
"""Differences that matter: of the sensor's height, of the number of beams as a ratio, of the azimuth covered."""
NAMES = ("points", "azimuth_deg", "beams", "ground_m", "sensor_m")


def typical(clouds: Iterable[NDArray[np.float64]]) -> dict[str, Any]:
    """What scans (n, 3) look like: medians, None where most do not tell, and the kinds of warning that one or more give."""
    found = [diagnose(cloud) for cloud in clouds]

    def median(values: list[float | None]) -> float | None:
        known = [value for value in values if value is not None and np.isfinite(value)]
        return float(np.median(known)) if len(known) * 2 > len(values) else None

    medians = {name: median([getattr(one, name) for one in found]) for name in NAMES}
    return {**medians, "warnings": sorted({_kind(warning) for one in found for warning in one.warnings})}


def unlike(points_m: NDArray[np.float64], trained: Mapping[str, Any], lifted_m: float, option: str = "--lift") -> list[str]:
    """Warnings on a scan (n, 3), raised by `lifted_m` already, whose sensor is not like the one of `trained`, which `typical`
    gave; `option` is how to raise it otherwise."""
    found = diagnose(points_m)
    known = {*trained["warnings"], "ground at", "beams", "not all"}  # compared by number
    return [
        *_compared(found, trained, f"{option} {lifted_m - found.ground_m:.2f}"),
        *(line for line in found.warnings if _kind(line) not in known),
    ]


def _compared(found: Diagnosis, trained: Mapping[str, Any], right: str) -> Iterable[str]:
    beams, height_m, azimuth_deg = trained["beams"], trained["sensor_m"], trained["azimuth_deg"]
    if beams and found.beams and not 1 / BEAMS < found.beams / beams < BEAMS:
        yield f"{found.beams} beams, where the site was learned with {beams:.0f}: fewer fixes will be accepted"
    if height_m is not None and abs(found.sensor_m - height_m) > HEIGHT_M and abs(found.ground_m) <= RAISED_M:
        yield f"the sensor is {found.sensor_m:.2f} m over the ground, where the site was learned with {height_m:.2f} m"
    if azimuth_deg is not None and azimuth_deg - found.azimuth_deg > ROUND_DEG:
        yield f"{found.azimuth_deg:.0f}° of 360° covered, where the site was learned with {azimuth_deg:.0f}°"
    if abs(found.ground_m) > RAISED_M:
        yield f"the ground lies at z = {found.ground_m:.2f} m, not 0: it would with {right}"


def _kind(warning: str) -> str:
    """`fewer than 1,000 points: 12; …` is one about `fewer than`."""
    return "beams" if warning.partition(":")[0].endswith("beams") else " ".join(warning.split()[:2])
