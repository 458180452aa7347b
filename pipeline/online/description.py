"""Describes a site file for `yearloc inspect`."""

from pathlib import Path

import numpy as np

from pipeline.inspection.inspection import Inspection, box, nbytes
from pipeline.online.site_file import LevelParts, read_either
from pipeline.online.site_json import LearnedDay, SiteDescription


def describe(path: Path) -> Inspection:
    """Describe what a site holds, promises and was made of.

    Raises ArtifactError for a file that is no whole site.
    """
    parts = read_either(path)
    if isinstance(parts, LevelParts):
        return _level(path, parts)
    description, model, arrays, network, _ = parts
    inspection = Inspection(path)
    verdict = description.verdict
    sensor = description.sensor
    anchors = arrays["world_T_anchor"]
    provenance = description.provenance
    method, view = (
        settings["_target_"].rpartition(".")[2]
        for settings in (description.method, description.view)
    )
    days = [provenance.train]
    if description.growth is not None:
        days = [_day(day) for day in description.growth.days]
    inspection.describe(
        f"site {description.name}{', of a simulated world' if description.simulated else ''}",
        (
            "size",
            f"{nbytes(path.stat().st_size)}; model "
            f"{nbytes(sum(array.nbytes for array in model.values()))}",
        ),
        (
            "method",
            f"{method} on {view} views{'' if network is None else ', through ONNX Runtime'}",
        ),
        (
            "learned on",
            ", then ".join(days),
        ),
        (
            "map",
            f"{len(anchors):,} submaps, {len(arrays['points']) / 1e6:.1f} M points within "
            f"{description.map.range_m:g} m",
        ),
        ("places", f"{len(arrays['cells']):,} cells of {description.places.cell_m:g} m"),
        ("box", box(anchors[:, :3, 3], "xyz", 0)),
    )
    limits = zip(verdict.promises, verdict.promised["fix"], strict=True)
    title = f"promises of a pose, by {verdict.held_out} held-out blocks"
    title += f"; of queries {verdict.unseen_share:g} are expected unseen"
    title += first_day(description)
    inspection.add(title, *((f"{promise:g}", _promise(float(limit))) for promise, limit in limits))
    looks = {
        "points a scan": sensor.points,
        "beams": sensor.beams,
        "azimuth in °": sensor.azimuth_deg,
        "metres over the ground": sensor.sensor_m,
    }
    sensor_rows = (
        (label, "unknown" if value is None else f"{value:,.4g}") for label, value in looks.items()
    )
    inspection.add("sensor", *sensor_rows, ("raised by", f"{sensor.lift_m:g} m"))
    inspection.add(
        "made of", *((name, digest or "unknown") for name, digest in provenance.md5.items())
    )
    inspection.add("with", *provenance.versions.items())
    inspection.warn(
        not verdict.kept,
        "no promise can be kept: every fix will be rejected",
    )
    return inspection


def _level(path: Path, parts: LevelParts) -> Inspection:
    """Describe a level site."""
    inspection = Inspection(path)
    description, arrays = parts
    level = description.level
    verdict = description.verdict
    occupancy = arrays["occupancy"]
    rows, cols = occupancy.shape
    x_m, y_m, yaw_rad = level.origin
    inspection.describe(
        f"level site {description.name}{', of a simulated world' if description.simulated else ''}",
        ("size", nbytes(path.stat().st_size)),
        ("made of", description.provenance.train),
        ("map", f"{cols} x {rows} cells of {level.cell_m:g} m"),
        ("free", f"{float((occupancy == 0).sum()) * level.cell_m**2:,.0f} m²"),
        ("origin", f"x {x_m:g} m, y {y_m:g} m, yaw {np.rad2deg(yaw_rad):g}°"),
        ("gathers", f"sweeps over {level.over_m:g} m of path"),
    )
    limits = zip(verdict.promises, verdict.promised["fix"], strict=True)
    title = f"promises of a pose, by {verdict.held_out} held-out blocks of its own"
    title += f"; of queries {verdict.unseen_share:g} are expected unseen"
    inspection.add(title, *((f"{promise:g}", _promise(float(limit))) for promise, limit in limits))
    inspection.add("with", *description.provenance.versions.items())
    return inspection


def first_day(description: SiteDescription) -> str:
    """Name the day whose held-out queries a grown site's promises rest on.

    Empty for a site that has not grown.
    """
    days = () if description.growth is None else description.growth.days
    return f"; all of {days[0].day}, not of the days since" if len(days) > 1 else ""


def _promise(limit: float) -> str:
    return (
        f"fixes of a novelty below {limit:.3g}"
        if limit > 0
        else "nothing keeps it: too few held-out blocks, or too many wrong"
    )


def _day(day: LearnedDay) -> str:
    """Describe a day that a site learned, in a line."""
    additions = ""
    if day.places is not None:
        additions = f", {day.places} new places, {day.changed} submaps changed"
    return f"{day.day} ({day.views} views{additions})"
