"""Diagnoses of clouds, for `yearloc inspect`: points in; key numbers and warnings out.

Warnings are on everything that would break a method; `symptoms` has the test of each.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection import symptoms
from pipeline.inspection.beams import find_beams
from pipeline.inspection.inspection import Inspection, metres, typographic
from pipeline.inspection.symptoms import Kind, Symptom
from pipeline.mapping.appearance import coverage
from pipeline.mapping.appearance import ground as ground_height

UNKNOWN = (float("nan"),) * 3
RAISED_M = 0.5
"""A ground so far from z = 0 was not put there; below, the origin is taken for the sensor."""


@dataclass(frozen=True)
class Diagnosis:
    """Key numbers of one cloud, in metres and in its own frame; NaN or None where unknown."""

    points: int
    symptoms: tuple[Symptom, ...]
    range_m: tuple[float, ...] = UNKNOWN
    """Median, 99th percentile and largest distance from the origin in the xy plane."""
    z_m: tuple[float, ...] = UNKNOWN
    """1st, 50th and 99th percentile."""
    azimuth_deg: float = 0.0
    """Degrees of azimuth with points: 360 minus all gaps wider than 3°."""
    beams: int | None = None
    """By the laser ids, or an estimate of the beams with returns."""
    ground_m: float = np.nan
    """z of the ground near the sensor."""
    sensor_m: float = np.nan
    """The sensor's height over the ground."""
    has_laser_ids: bool = False
    """Whether `beams` is by the laser ids."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to tell its user."""
        return tuple(symptom.text for symptom in self.symptoms)

    def add_to(self, inspection: Inspection, title: str = "cloud") -> None:
        """Add the numbers as rows of text, and the symptoms as warnings."""
        source = "laser ids" if self.has_laser_ids else "with returns, estimated"
        rows = [
            ("points", f"{self.points:,}"),
            (
                "range",
                "median {}, 99 % {}, farthest {}".format(
                    *(_text_or(length, "none", metres) for length in self.range_m)
                ),
            ),
            ("height", "1 % {:.2f} m, median {:.2f} m, 99 % {:.2f} m".format(*self.z_m)),
            ("azimuth", f"{self.azimuth_deg:.0f}° of 360° covered"),
            (
                "beams",
                "unknown: the points form no rings"
                if self.beams is None
                else f"{self.beams} ({source})",
            ),
            (
                "ground",
                _text_or(
                    self.ground_m, "unknown", lambda height: f"at z = {symptoms.signed(height)} m"
                ),
            ),
        ]
        if np.isfinite(self.sensor_m):
            source = "estimated" if self.ground_m >= -RAISED_M else "if it is the origin"
            rows.append(("sensor", f"{self.sensor_m:.2f} m over the ground ({source})"))
        inspection.add(title, *rows)
        inspection.warnings += self.warnings


def diagnose(
    points_m: NDArray[np.floating],
    lasers: NDArray[np.uint8] | None = None,
    mounted_m: float = np.nan,
) -> Diagnosis:
    """Diagnose a cloud (n, 3) in metres that should be in the vehicle frame.

    That is x forward, y left, z up, ground at z = 0. `lasers` (n,) are the ids of the beams, from
    0, where the file has them; otherwise the beams are estimated. `mounted_m` is the z of the
    sensor, where it is known.
    """
    is_finite = np.isfinite(points_m).all(axis=1)
    points = np.asarray(points_m[is_finite], np.float64)
    noted = symptoms.missing(len(points_m), len(points))
    if not len(points):
        return Diagnosis(0, tuple(noted))
    noted += symptoms.repeated(points)
    range_m = np.hypot(points[:, 0], points[:, 1])
    beams = None if lasers is None else int(lasers.max(initial=0)) + 1
    diagnosis = Diagnosis(
        len(points),
        (),
        range_m=(
            float(np.median(range_m)),
            float(np.percentile(range_m, 99)),
            float(range_m.max()),
        ),
        z_m=tuple(map(float, np.percentile(points[:, 2], (1, 50, 99)))),
        azimuth_deg=coverage(points[range_m > 0]),
        beams=beams,
        has_laser_ids=lasers is not None,
    )
    if shape := symptoms.scale(points, range_m) or symptoms.flat(points):
        return replace(diagnosis, symptoms=(*noted, shape))
    ground_m = ground_height(points, range_m)
    low_m, _, high_m = diagnosis.z_m
    is_hanging = (ground_m - low_m) > 1.0 and (ground_m - low_m) > 2 * (high_m - ground_m)
    sensor_m = np.nan
    rings = find_beams(points, ground_m, -1.0 if is_hanging else 1.0)
    if rings is not None:
        ring_count, sensor_z_m = rings
        beams = beams or ring_count
        sensor_m = abs(sensor_z_m - ground_m)
    if ground_m < -RAISED_M or np.isfinite(mounted_m):
        sensor_m = np.nan_to_num(mounted_m) - ground_m  # the points' origin is the sensor
    if is_hanging:
        noted.append(symptoms.hanging(ground_m, low_m))
    if abs(ground_m) > RAISED_M:
        noted.append(symptoms.ground(ground_m))
    noted += symptoms.sparse(diagnosis.azimuth_deg, beams)
    return replace(
        diagnosis, symptoms=tuple(noted), beams=beams, ground_m=ground_m, sensor_m=sensor_m
    )


def spread(count: int) -> list[int]:
    """At most five rows, evenly spread over `count` rows, the first and the last included."""
    return sorted({int(row) for row in np.linspace(0, count - 1, 5).round()}) if count else []


def survey(
    inspection: Inspection, count: int, points: Callable[[int], NDArray[np.floating]], frame: str
) -> None:
    """Add a table of the diagnoses of a few of `count` scans, and each kind of warning once.

    `points` gives a scan (n, 3) in metres, in `frame`. Under an open sky few beams of a good sensor
    return, so a warning on the number of beams needs most of the scans.
    """
    diagnoses = {row: diagnose(points(row)) for row in spread(count)}
    head = (
        "scan",
        "points",
        "range 50 %",
        "99 %",
        "z 1 %",
        "50 %",
        "99 %",
        "azimuth",
        "beams",
        "ground",
        "sensor above it",
    )
    inspection.add(
        f"clouds, {frame}",
        head,
        *((str(row), *_cells(diagnosis)) for row, diagnosis in diagnoses.items()),
    )
    texts: dict[Kind, str] = {}
    rows_by_kind: dict[Kind, list[int]] = {}
    ground_m = np.nan_to_num([diagnosis.ground_m for diagnosis in diagnoses.values()])
    typical = np.abs(ground_m - np.median(ground_m)).argsort(kind="stable") if len(ground_m) else ()
    for row, diagnosis in [[*diagnoses.items()][i] for i in typical]:
        for symptom in diagnosis.symptoms:
            texts.setdefault(symptom.kind, symptom.text)
            rows_by_kind.setdefault(symptom.kind, []).append(row)
    for kind, rows in rows_by_kind.items():
        scans = (
            f"scan{'s' if len(rows) > 1 else ''} {', '.join(map(str, sorted(rows)))} of the "
            f"{len(diagnoses)} looked at"
        )
        inspection.warn(
            kind != Kind.BEAMS or 2 * len(rows) > len(diagnoses), f"{texts[kind]} ({scans})"
        )


def _cells(diagnosis: Diagnosis) -> tuple[str, ...]:
    def height(height_m: float) -> str:
        return _text_or(height_m, "–", lambda height: typographic(f"{height:.2f} m"))

    return (
        f"{diagnosis.points:,}",
        *(_text_or(length, "–", metres) for length in diagnosis.range_m[:2]),
        *map(height, diagnosis.z_m),
        f"{diagnosis.azimuth_deg:.0f}°",
        "?" if diagnosis.beams is None else str(diagnosis.beams),
        height(diagnosis.ground_m),
        height(diagnosis.sensor_m),
    )


def _text_or(value: float, unknown: str, text: Callable[[float], str]) -> str:
    return unknown if np.isnan(value) else text(value)
