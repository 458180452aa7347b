"""Checks whether scans come from a sensor like the one that a site was learned with.

`typical` describes the training scans when a site is packed. `unlike` compares a scan with this
description, and says in a line what differs and which option corrects it.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import Poses, rpy
from pipeline.inspection.cloud import RAISED_M, Diagnosis, diagnose
from pipeline.inspection.symptoms import Kind
from pipeline.online.site_json import Sensor
from pipeline.online.tilt import LEVEL_DEG, Lean, lean
from pipeline.readers.log import raised

HEIGHT_M = 0.5
"""Sensors whose heights differ by more are unlike."""
BEAM_RATIO = 1.5
"""Sensors whose numbers of beams differ by a larger ratio are unlike."""
ROUND_DEG = 60.0
"""A sensor that covers less azimuth than the site's by more than this is unlike."""
RAISE = "--lift {:.2f}"
"""The option of the command line that raises the points."""
TURN = "--body-T-lidar={}"
"""The option of the command line for the lidar's pose, with x, y, z in metres and roll, pitch, yaw
in degrees."""
OF_LOGS = "{:+.2f} m more of reader.lift_m (of KITTI lidar_height_m)"
"""The setting by which the reader of a log raises the points."""
COMPARED_BY_NUMBER = (Kind.GROUND, Kind.BEAMS, Kind.NOT_ROUND)
"""Symptoms of a scan that are left out, since their numbers are compared here."""


def typical(clouds: Iterable[NDArray[np.float64]], lift_m: float) -> Sensor:
    """Describe the scans (n, 3) of a sensor by medians; a reader raised them by `lift_m`.

    A median is None if most scans have no value.
    """
    diagnoses = [diagnose(cloud) for cloud in clouds]

    def median(name: str) -> float | None:
        values = [getattr(diagnosis, name) for diagnosis in diagnoses]
        finite_values = [value for value in values if value is not None and np.isfinite(value)]
        return float(np.median(finite_values)) if len(finite_values) * 2 > len(values) else None

    kinds = {symptom.kind for diagnosis in diagnoses for symptom in diagnosis.symptoms}
    return Sensor(
        lift_m=lift_m,
        points=median("points"),
        azimuth_deg=median("azimuth_deg"),
        beams=median("beams"),
        ground_m=median("ground_m"),
        sensor_m=median("sensor_m"),
        warnings=tuple(sorted(kinds)),
    )


def unlike(
    points_m: NDArray[np.float64],
    trained: Sensor,
    body_T_lidar: Poses | None,
    ways: tuple[str, str] = (RAISE, TURN),
) -> list[str]:
    """Warnings if the sensor of a scan (n, 3) is unlike the site's sensor `trained`.

    The points were transformed by `body_T_lidar` (4, 4), or by a log's reader if that is None.
    `ways` are the user's options to raise points, and to give the lidar's pose.
    """
    diagnosis = diagnose(points_m)
    expected_kinds = {*trained.warnings, *COMPARED_BY_NUMBER}
    unexpected = [symptom for symptom in diagnosis.symptoms if symptom.kind not in expected_kinds]
    is_upside_down = any(symptom.kind == Kind.DOWN for symptom in unexpected)
    if leaning := lean(points_m, is_upside_down):  # heights cannot be compared then
        return [_leaning(leaning, body_T_lidar, ways)]
    remedy = OF_LOGS.format(-diagnosis.ground_m)
    if body_T_lidar is not None and np.isfinite(diagnosis.ground_m):
        remedy = _raised(body_T_lidar, diagnosis.ground_m, ways)
    return [
        *_differences(diagnosis, trained, remedy),
        *(symptom.text for symptom in unexpected),
    ]


def _leaning(leaning: Lean, body_T_lidar: Poses | None, ways: tuple[str, str]) -> str:
    """Says how a scan is tilted and, unless a log's reader placed it, which option corrects it."""
    faults = []
    if leaning.upside_down:
        faults.append("upside down")
    if leaning.tilt_deg >= LEVEL_DEG:
        faults.append(f"tilted by about {leaning.tilt_deg:.0f}°")
    remedy = ""
    if body_T_lidar is not None:
        _, way_to_place = ways
        option = way_to_place.format(_numbers(leaning.upright_T_points @ body_T_lidar))
        remedy = f": it would stand upright with {option}"
    return f"{' and '.join(faults)}{remedy}"


def _raised(body_T_lidar: Poses, ground_m: float, ways: tuple[str, str]) -> str:
    """The option that moves the ground of the points from z = `ground_m` to z = 0."""
    way_to_raise, way_to_place = ways
    placement = raised(-ground_m) @ body_T_lidar
    lift_m = placement[2, 3]
    if np.allclose(placement, raised(lift_m)):
        return way_to_raise.format(lift_m)
    return way_to_place.format(_numbers(placement))


def _numbers(pose: Poses) -> str:
    """A pose (4, 4) as x,y,z,roll,pitch,yaw, in metres and degrees."""
    turn_deg = np.rad2deg(rpy(pose[None])[0])
    position = [f"{value + 0:.2f}" for value in pose[:3, 3].round(2)]  # + 0 makes −0 a 0
    turn = [f"{value + 0:.1f}" for value in turn_deg.round(1)]
    return ",".join(position + turn)


def _differences(diagnosis: Diagnosis, trained: Sensor, remedy: str) -> Iterable[str]:
    """Warnings if the numbers of a scan differ from those of the training scans."""
    beams = trained.beams
    height_m = trained.sensor_m
    azimuth_deg = trained.azimuth_deg
    if beams and diagnosis.beams and not 1 / BEAM_RATIO < diagnosis.beams / beams < BEAM_RATIO:
        yield (
            f"{diagnosis.beams} beams, where the site was learned with {beams:.0f}: fewer fixes "
            "will be accepted"
        )
    if (
        height_m is not None
        and abs(diagnosis.sensor_m - height_m) > HEIGHT_M
        and abs(diagnosis.ground_m) <= RAISED_M
    ):
        yield (
            f"the sensor is {diagnosis.sensor_m:.2f} m over the ground, where the site was learned "
            f"with {height_m:.2f} m"
        )
    if azimuth_deg is not None and azimuth_deg - diagnosis.azimuth_deg > ROUND_DEG:
        yield (
            f"{diagnosis.azimuth_deg:.0f}° of 360° covered, where the site was learned with "
            f"{azimuth_deg:.0f}°"
        )
    if abs(diagnosis.ground_m) > RAISED_M:
        yield (
            f"the ground lies at z = {diagnosis.ground_m:.2f} m, not "
            f"0{f': it would with {remedy}' if remedy else ''}"
        )
