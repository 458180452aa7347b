"""Diagnoses of clouds: key numbers, and warnings on everything that would break a method."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection import symptoms
from pipeline.inspection.beams import find_beams
from pipeline.inspection.inspection import Inspection, metres, typographic
from pipeline.inspection.symptoms import Kind, Symptom
from pipeline.mapping.appearance import coverage
from pipeline.mapping.appearance import ground as ground_height

MANY = 1_000
"""A scan of a spinning LiDAR has at least so many points."""
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
                _text_or(self.ground_m, "unknown", lambda height: f"at z = {_signed(height)} m"),
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
    finite = np.isfinite(points_m).all(axis=1)
    points = np.asarray(points_m[finite], np.float64)
    noted: list[Symptom] = []

    def note(when: object, kind: Kind, text: str) -> None:
        if when:
            noted.append(Symptom(kind, text))

    nonfinite = int((~finite).sum())
    note(
        nonfinite,
        Kind.NOT_FINITE,
        f"NaN/inf points: {nonfinite:,} of {len(finite):,} are not finite and poison every maximum "
        "and mean; drop them when reading",
    )
    too_few = (
        f"fewer than {MANY:,} points: {len(points)}; most bins of a view would be empty: is the "
        "file cut short?"
    )
    note(len(points) < MANY, Kind.FEW_POINTS, too_few)
    if not len(points):
        return Diagnosis(0, tuple(noted))
    noted += symptoms.repeated(points)
    range_m = np.hypot(points[:, 0], points[:, 1])
    heights = low, _, high = tuple(map(float, np.percentile(points[:, 2], (1, 50, 99))))
    ranges = (float(np.median(range_m)), float(np.percentile(range_m, 99)), float(range_m.max()))
    covered_deg = coverage(points[range_m > 0])
    beams = None if lasers is None else int(lasers.max(initial=0)) + 1
    ground = sensor = np.nan
    shape = symptoms.scale(points, range_m) or symptoms.flat(points)
    if shape:
        noted.append(shape)
    else:
        ground = ground_height(points, range_m)
        is_hanging = (ground - low) > 1.0 and (ground - low) > 2 * (high - ground)
        rings = find_beams(points, ground, -1.0 if is_hanging else 1.0)
        if rings is not None:
            ring_count, sensor_z_m = rings
            beams = beams or ring_count
            sensor = abs(sensor_z_m - ground)
        if ground < -RAISED_M or np.isfinite(mounted_m):
            sensor = np.nan_to_num(mounted_m) - ground  # the points' origin is the sensor
        note(
            is_hanging,
            Kind.DOWN,
            f"z points down: it hangs from z = {_signed(ground)} m to {_signed(low)} m; every "
            "highest z is the ground's: turn it by (x, −y, −z)",
        )
        note(
            abs(ground) > RAISED_M,
            Kind.GROUND,
            f"ground at z = {_signed(ground)} m, not 0: heights in every view would be off by as "
            f"much; add {_signed(-ground)} m to lift_m (of KITTI lidar_height_m) in the dataset's "
            "yaml",
        )
        note(
            covered_deg < 300,
            Kind.NOT_ROUND,
            f"not all round: {covered_deg:.0f}° of 360° covered; a turned vehicle sees another "
            "part of the place, so no shift of the columns brings it back: gather several scans, "
            "or query in the training's direction",
        )
        note(
            covered_deg >= 300 and beams is not None and beams <= 20,
            Kind.BEAMS,
            f"{beams} beams: far rings hold fewer than the 5 points that a bin needs; widen the "
            "rings, or gather several scans into one submap",
        )
    return Diagnosis(
        len(points),
        tuple(noted),
        ranges,
        heights,
        covered_deg,
        beams,
        ground,
        sensor,
        lasers is not None,
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


def _signed(value: float) -> str:
    return typographic(f"{value:+.2f}")
