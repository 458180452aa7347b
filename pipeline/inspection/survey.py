"""Diagnoses of a few scans of a sequence, side by side."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.cloud import Diagnosis, diagnose
from pipeline.inspection.inspection import Section, metres, typographic

HANDFUL = 5


def spread(count: int, handful: int = HANDFUL) -> list[int]:
    """At most `handful` rows, evenly spread over `count` rows, the first and the last included."""
    return sorted({int(row) for row in np.linspace(0, max(count - 1, 0), handful).round()}) if count else []


def survey(rows: Iterable[int], points: Callable[[int], NDArray[np.floating]], frame: str) -> tuple[Section, tuple[str, ...]]:
    """A table of the diagnoses of the scans `rows`, each (n, 3) in metres in `frame`, and their warnings, each kind once."""
    diagnoses = {row: diagnose(points(row)) for row in rows}
    table: list[tuple[str, ...]] = [
        ("scan", "points", "range 50 %", "99 %", "z 1 %", "50 %", "99 %", "azimuth", "beams", "ground", "sensor above it")
    ]
    table += [(str(row), *_cells(diagnosis)) for row, diagnosis in diagnoses.items()]
    return Section(f"clouds, {frame}", tuple(table)), _shared(diagnoses)


def _cells(diagnosis: Diagnosis) -> tuple[str, ...]:
    ranges, heights = diagnosis.range_m[:2], diagnosis.z_m
    return (
        f"{diagnosis.points:,}",
        *("–" if np.isnan(length) else metres(length) for length in ranges),
        *(_height(height) for height in heights),
        f"{diagnosis.azimuth_deg:.0f}°",
        "?" if diagnosis.beams is None else str(diagnosis.beams),
        _height(diagnosis.ground_m),
        _height(diagnosis.sensor_m),
    )


def _height(height_m: float) -> str:
    return "–" if np.isnan(height_m) else typographic(f"{height_m:.2f} m")


def _shared(diagnoses: dict[int, Diagnosis]) -> tuple[str, ...]:
    """Each kind of warning once, with the text of the first scan that has it.

    Under an open sky few beams of a good sensor return, so a warning on the number of beams needs most of the scans.
    """
    kinds: dict[str, list[int]] = {}
    words: dict[str, str] = {}
    for row, diagnosis in diagnoses.items():
        for warning in diagnosis.warnings:
            kind = "beams" if warning.partition(":")[0].endswith("beams") else " ".join(warning.split()[:2])
            kinds.setdefault(kind, []).append(row)
            words.setdefault(kind, warning)
    return tuple(
        f"{words[kind]} (scan{'s' if len(rows) > 1 else ''} {', '.join(map(str, rows))} of the {len(diagnoses)} looked at)"
        for kind, rows in kinds.items()
        if kind != "beams" or 2 * len(rows) > len(diagnoses)
    )
