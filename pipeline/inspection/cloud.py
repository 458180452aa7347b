"""Diagnoses clouds for `yearloc inspect`: points in; key numbers and warnings out.

The warnings are on symptoms: whatever in a cloud would break a method. `symptoms` has the test and
the words of each.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection import symptoms
from pipeline.inspection.beams import find_beams
from pipeline.inspection.inspection import Inspection, metres, typographic
from pipeline.inspection.symptoms import Kind, Symptom
from pipeline.mapping.appearance import measure_coverage_deg, measure_ground_m

UNKNOWN = (float("nan"),) * 3
"""Three numbers of a cloud that has none."""
RAISED_M = 0.5
"""A ground farther than this from z = 0 was not put there by a reader. If it is that far below, the
origin of the cloud is taken for the sensor."""
SAMPLED_SCANS = 5
"""Scans of a log that are diagnosed."""
HEADER = (
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
"""Titles of the columns in the table of sampled scans."""


@dataclass(frozen=True)
class Diagnosis:
    """Key numbers of one cloud, in metres and in its own frame; NaN or None where unknown."""

    points: int
    """Number of finite points."""
    symptoms: tuple[Symptom, ...]
    range_m: tuple[float, ...] = UNKNOWN
    """Median, 99th percentile and maximum of the distance from the origin in the xy plane."""
    z_m: tuple[float, ...] = UNKNOWN
    """1st, 50th and 99th percentile of the height."""
    azimuth_deg: float = 0.0
    """Degrees of azimuth with points: 360 minus all gaps wider than 3°."""
    beams: int | None = None
    """Number of beams: by the laser ids, or an estimate of those with returns."""
    ground_m: float = np.nan
    """z of the ground near the sensor."""
    sensor_m: float = np.nan
    """The height of the sensor over the ground."""
    has_laser_ids: bool = False
    """Whether `beams` is by the laser ids."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence for the user on each symptom."""
        return tuple(symptom.text for symptom in self.symptoms)

    def add_to(self, inspection: Inspection, title: str = "cloud") -> None:
        """Add the numbers as rows of text, and the symptoms as warnings."""
        median, percentile_99, farthest = (_metres_or(length, "none") for length in self.range_m)
        beams = "unknown: the points form no rings"
        if self.beams is not None:
            beams_source = "laser ids" if self.has_laser_ids else "with returns, estimated"
            beams = f"{self.beams} ({beams_source})"
        ground = "unknown"
        if not np.isnan(self.ground_m):
            ground = f"at z = {symptoms.signed(self.ground_m)} m"
        rows = [
            ("points", f"{self.points:,}"),
            ("range", f"median {median}, 99 % {percentile_99}, farthest {farthest}"),
            ("height", "1 % {:.2f} m, median {:.2f} m, 99 % {:.2f} m".format(*self.z_m)),
            ("azimuth", f"{self.azimuth_deg:.0f}° of 360° covered"),
            ("beams", beams),
            ("ground", ground),
        ]
        if np.isfinite(self.sensor_m):
            is_estimated = self.ground_m >= -RAISED_M
            source = "estimated" if is_estimated else "if it is the origin"
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
    0, if the file has them; otherwise the beams are estimated. `mounted_m` is the z of the sensor,
    NaN if it is not known.
    """
    # 1. numbers that need no more than finite points
    is_finite = np.isfinite(points_m).all(axis=1)
    points = np.asarray(points_m[is_finite], np.float64)
    cloud_symptoms = [*symptoms.of_points(len(points_m), points)]
    if not len(points):
        return Diagnosis(points=0, symptoms=tuple(cloud_symptoms))
    range_m = np.hypot(points[:, 0], points[:, 1])
    beams = None if lasers is None else int(lasers.max(initial=0)) + 1
    diagnosis = Diagnosis(
        points=len(points),
        symptoms=(),
        range_m=(
            float(np.median(range_m)),
            float(np.percentile(range_m, 99)),
            float(range_m.max()),
        ),
        z_m=tuple(map(float, np.percentile(points[:, 2], (1, 50, 99)))),
        azimuth_deg=measure_coverage_deg(points[range_m > 0]),
        beams=beams,
        has_laser_ids=lasers is not None,
    )
    if unit_or_shape := symptoms.unit_or_shape(points, range_m):
        return replace(diagnosis, symptoms=(*cloud_symptoms, unit_or_shape))

    # 2. ground and sensor, of a cloud that is in metres and not flat
    ground_m = measure_ground_m(points, range_m)
    # z points down if the cloud reaches more than 1 m below its ground, and twice as far below as
    # above it: by the lowest and highest percent of its points, a few of which are always wrong
    lowest_m, _, highest_m = diagnosis.z_m
    below_m = ground_m - lowest_m
    z_points_down = below_m > 1.0 and below_m > 2 * (highest_m - ground_m)
    sensor_m = np.nan
    rings = find_beams(points, ground_m, -1.0 if z_points_down else 1.0)
    if rings is not None:
        beams = beams or rings.number
        sensor_m = abs(rings.sensor_z_m - ground_m)
    if np.isfinite(mounted_m):
        sensor_m = mounted_m - ground_m
    elif ground_m < -RAISED_M:
        sensor_m = -ground_m  # the origin is taken for the sensor
    if z_points_down:
        heights = map(symptoms.signed, (ground_m, lowest_m))
        cloud_symptoms.append(Symptom.of(Kind.DOWN, *heights))
    if abs(ground_m) > RAISED_M:
        heights = map(symptoms.signed, (ground_m, -ground_m))
        cloud_symptoms.append(Symptom.of(Kind.GROUND, *heights))
    cloud_symptoms += symptoms.of_view(diagnosis.azimuth_deg, beams)
    return replace(
        diagnosis, symptoms=tuple(cloud_symptoms), beams=beams, ground_m=ground_m, sensor_m=sensor_m
    )


def spread(count: int) -> list[int]:
    """At most SAMPLED_SCANS rows, evenly spread over `count` rows, from the first to the last."""
    if not count:
        return []
    return sorted({int(row) for row in np.linspace(0, count - 1, SAMPLED_SCANS).round()})


def describe_clouds(
    inspection: Inspection, count: int, points: Callable[[int], NDArray[np.floating]], frame: str
) -> None:
    """Diagnose a few of `count` scans: add a table, and one warning for each kind of symptom.

    `points` returns the points (n, 3) of a scan in metres; the title of the table names their
    `frame`. The words of a warning are those of the scan with the most typical ground. A warning on
    the number of beams needs most of the scans, since under an open sky few beams of a good sensor
    return.
    """
    diagnoses = {row: diagnose(points(row)) for row in spread(count)}
    table = [(str(row), *_cells(diagnosis)) for row, diagnosis in diagnoses.items()]
    inspection.add(f"clouds, {frame}", HEADER, *table)
    if not diagnoses:
        return
    texts: dict[Kind, str] = {}
    rows_by_kind: dict[Kind, list[int]] = {}
    ground_m = np.nan_to_num([diagnosis.ground_m for diagnosis in diagnoses.values()])
    # from the scan with the most typical ground on, since the first text of a kind is taken
    order = np.abs(ground_m - np.median(ground_m)).argsort(kind="stable")
    rows = list(diagnoses)
    for row in [rows[i] for i in order]:
        for symptom in diagnoses[row].symptoms:
            texts.setdefault(symptom.kind, symptom.text)
            rows_by_kind.setdefault(symptom.kind, []).append(row)
    for kind, kind_rows in rows_by_kind.items():
        numbers = ", ".join(map(str, sorted(kind_rows)))
        noun = "scans" if len(kind_rows) > 1 else "scan"
        scans = f"{noun} {numbers} of the {len(diagnoses)} looked at"
        is_in_most = 2 * len(kind_rows) > len(diagnoses)
        inspection.warn_if(kind != Kind.BEAMS or is_in_most, f"{texts[kind]} ({scans})")


def _cells(diagnosis: Diagnosis) -> tuple[str, ...]:
    """The cells of a diagnosis in the table of sampled scans, after the number of its scan."""

    def height(height_m: float) -> str:
        return "–" if np.isnan(height_m) else typographic(f"{height_m:.2f} m")

    return (
        f"{diagnosis.points:,}",
        *(_metres_or(length, "–") for length in diagnosis.range_m[:2]),
        *map(height, diagnosis.z_m),
        f"{diagnosis.azimuth_deg:.0f}°",
        "?" if diagnosis.beams is None else str(diagnosis.beams),
        height(diagnosis.ground_m),
        height(diagnosis.sensor_m),
    )


def _metres_or(length_m: float, unknown: str) -> str:
    """A length as text, or `unknown` for NaN."""
    return unknown if np.isnan(length_m) else metres(length_m)
