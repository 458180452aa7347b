"""Describes a site file for `yearloc inspect`: content, target precisions and provenance."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.core.datum import Datum
from pipeline.core.precisions import JUDGED_PRECISION, shown
from pipeline.inspection.inspection import Inspection, box, nbytes
from pipeline.online.site_file import LevelParts, Parts, read_either
from pipeline.online.site_json import (
    CalibratedDay,
    LearnedDay,
    LevelDescription,
    Sensor,
    Settings,
    SiteDescription,
    notes,
)
from pipeline.posing.map_verdict import NOT_CALIBRATED
from pipeline.posing.verdict import Verdict


def describe(path: Path) -> Inspection:
    """Describe the site in a file.

    Raises ArtifactError for a file that is not a whole site.
    """
    parts = read_either(path)
    return _level(path, parts) if isinstance(parts, LevelParts) else _site(path, parts)


def _site(path: Path, parts: Parts) -> Inspection:
    """Describe a site of 3-D scans."""
    description, model, arrays, network, _ = parts
    inspection = Inspection(path)
    verdict = description.verdict
    anchors = arrays["world_T_anchor"]
    provenance = description.provenance
    days = [provenance.train]
    if description.incremental_learning is not None:
        days = [_day(day) for day in description.incremental_learning.days]
    model_size = nbytes(sum(array.nbytes for array in model.values()))
    method = f"{_class_name(description.method)} on {_class_name(description.view)} views"
    if network is not None:
        method += ", through ONNX Runtime"
    kind = "cut-outs" if description.map.is_tiled else "submaps"
    submaps = f"{len(anchors):,} {kind}, {len(arrays['points']) / 1e6:.1f} M points"
    inspection.kind = f"site {_site_name(description)}"
    inspection.add(
        "",
        ("size", f"{nbytes(path.stat().st_size)}; model {model_size}"),
        ("method", method),
        ("made of" if description.map.is_tiled else "learned on", ", then ".join(days)),
        ("map", f"{submaps} within {description.map.range_m:g} m"),
        ("places", f"{len(arrays['cells']):,} cells of {description.places.cell_m:g} m"),
        ("box", box(anchors[:, :3, 3], "xyz", 0)),
        *_datum_rows(description.datum),
    )
    title = f"target precisions of a pose, by {verdict.validation_blocks} validation blocks"
    if provenance.calibrated_on:
        title += f" of {provenance.calibrated_on}"
    title += first_day_words(description)
    title += f"; a share {verdict.unseen_share:g} of the queries is expected to be unseen"
    inspection.add(title, *_target_rows(verdict, description.calibrated_days))
    inspection.add("sensor", *_sensor_rows(description.sensor))
    digests = [(name, digest or "unknown") for name, digest in provenance.md5.items()]
    inspection.add("made of", *digests)
    inspection.add("with", *provenance.versions.items())
    inspection.warn_if(
        not verdict.reachable,
        "no target precision can be reached: every fix will be rejected",
    )
    return inspection


def _level(path: Path, parts: LevelParts) -> Inspection:
    """Describe a level site: a 2-D map for a planar laser, without a network."""
    inspection = Inspection(path)
    description, arrays = parts
    level = description.level
    verdict = description.verdict
    occupancy = arrays["occupancy"]
    rows, cols = occupancy.shape
    x_m, y_m, yaw_rad = level.origin
    inspection.kind = f"level site {_site_name(description)}"
    inspection.add(
        "",
        ("size", nbytes(path.stat().st_size)),
        ("made of", description.provenance.train),
        ("map", f"{cols} x {rows} cells of {level.cell_m:g} m"),
        ("free", f"{float((occupancy == 0).sum()) * level.cell_m**2:,.0f} m²"),
        ("origin", f"x {x_m:g} m, y {y_m:g} m, yaw {np.rad2deg(yaw_rad):g}°"),
        ("gathers", f"sweeps over {level.over_m:g} m of path"),
        *_datum_rows(description.datum),
    )
    title = (
        f"target precisions of a pose, by {verdict.validation_blocks} validation blocks of its own"
    )
    title += f"; a share {verdict.unseen_share:g} of the queries is expected to be unseen"
    inspection.add(title, *_target_rows(verdict))
    inspection.add("with", *description.provenance.versions.items())
    return inspection


def first_day_words(description: SiteDescription) -> str:
    """A note that an updated site's thresholds come from validation blocks of its first day.

    It is empty for a site that has not been updated.
    """
    days = () if description.incremental_learning is None else description.incremental_learning.days
    return f"; these blocks are all of {days[0].day}" if len(days) > 1 else ""


def _site_name(description: LevelDescription | SiteDescription) -> str:
    """The name of a site, and what must be said of it."""
    return ", ".join((description.name, *notes(description)))


def _class_name(settings: Settings) -> str:
    """The name of the class of a method or a view, such as SciRing."""
    return str(settings["_target_"]).rpartition(".")[2]


def _target_rows(
    verdict: Verdict, calibrated_days: Sequence[CalibratedDay] = ()
) -> list[tuple[str, str]]:
    """A row for each threshold: at which target precisions it accepts which fixes.

    Later days that taught or tested thresholds have a row each.
    """
    accepted_at: dict[str, list[float]] = {}
    # A fix is rejected from the novelty `threshold` on; it is 0 if the target precision cannot be
    # reached. A fix's novelty is one minus the probability that its pose is right.
    for target_precision, threshold in zip(
        verdict.target_precisions, verdict.claim_thresholds["fix"], strict=True
    ):
        accepted = "cannot be reached: too few validation blocks, or too many wrong fixes"
        if threshold > 0:
            accepted = f"fixes with a novelty below {float(threshold):.3g}"
            if target_precision in verdict.usual:
                accepted += f", by the usual probabilities: {NOT_CALIBRATED}"
        accepted_at.setdefault(accepted, []).append(target_precision)
    rows = [(", ".join(map(shown, same)), accepted) for accepted, same in accepted_at.items()]
    if kept := verdict.kept_words(JUDGED_PRECISION):
        rows.append(("asked for .99", kept))
    return [*rows, *map(_calibrated_row, calibrated_days)]


def _calibrated_row(day: CalibratedDay) -> tuple[str, str]:
    """A row on a later day: what it taught, and from how many blocks."""
    taught = ", ".join(map(shown, day.target_precisions))
    words = f"{day.blocks} blocks taught the thresholds of {taught or 'no target precision'}"
    if day.has_covariances:
        words += ", and the covariances"
    return f"calibrated on {day.day}", f"{words}; the other thresholds were tested on them"


def _datum_rows(datum: Datum | None) -> list[tuple[str, str]]:
    """A row on where the world lies on the Earth; none if that is unknown."""
    if datum is None:
        return []
    position = f"latitude {datum.latitude_deg:.7f}°, longitude {datum.longitude_deg:.7f}°"
    heading = f"x axis {datum.heading_deg:g}° counter-clockwise from east"
    return [("datum", f"{position}, {datum.altitude_m:g} m; {heading}")]


def _sensor_rows(sensor: Sensor) -> list[tuple[str, str]]:
    """A row for each number that describes the training scans, and their lift."""
    medians = {
        "points a scan": sensor.points,
        "beams": sensor.beams,
        "azimuth in °": sensor.azimuth_deg,
        "metres over the ground": sensor.sensor_m,
    }
    rows = []
    for label, value in medians.items():
        rows.append((label, "unknown" if value is None else f"{value:,.4g}"))
    return [*rows, ("raised by", f"{sensor.lift_m:g} m")]


def _day(day: LearnedDay) -> str:
    """One line on a day that a site learned."""
    if not day.views:
        return day.day
    additions = ""
    if day.places is not None:
        additions = f", {day.places} new places, {day.changed} submaps changed"
    return f"{day.day} ({day.views} views{additions})"
