"""Describes a site file for `yearloc inspect`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.inspection.inspection import Inspection, box, nbytes
from pipeline.online.site_file import read


def describe(path: Path) -> Inspection:
    """Describe what a site holds, promises and was made of.

    Raises ArtifactError for a file that is no whole site.
    """
    about, model, arrays, network, _ = read(path)
    inspection = Inspection(path)
    verdict = about["verdict"]
    sensor = about["sensor"]
    anchors = arrays["world_T_anchor"]
    provenance = about["provenance"]
    method, view = (about[part]["_target_"].rpartition(".")[2] for part in ("method", "view"))
    inspection.describe(
        f"site {about['name']}{', of a simulated world' if about['simulated'] else ''}",
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
            ", then ".join(map(_day, about["growth"]["days"]))
            if "growth" in about
            else provenance["train"],
        ),
        (
            "map",
            f"{len(anchors):,} submaps, {len(arrays['points']) / 1e6:.1f} M points within "
            f"{about['map']['range_m']:g} m",
        ),
        ("places", f"{len(arrays['cells']):,} cells of {about['places']['cell_m']:g} m"),
        ("box", box(anchors[:, :3, 3], "xyz", 0)),
    )
    limits = zip(verdict["promises"], verdict["promised"]["fix"], strict=True)
    title = f"promises of a pose, by {verdict['held_out']} held-out blocks"
    title += f"; of queries {verdict['unseen_share']:g} are expected unseen"
    title += first_day(about)
    inspection.add(title, *((f"{promise:g}", _promise(float(limit))) for promise, limit in limits))
    names = {
        "points": "points a scan",
        "beams": "beams",
        "azimuth_deg": "azimuth in °",
        "sensor_m": "metres over the ground",
    }
    sensor_rows = (
        (label, "unknown" if sensor[name] is None else f"{sensor[name]:,.4g}")
        for name, label in names.items()
    )
    inspection.add("sensor", *sensor_rows, ("raised by", f"{sensor['lift_m']:g} m"))
    inspection.add(
        "made of", *((name, digest or "unknown") for name, digest in provenance["md5"].items())
    )
    inspection.add("with", *provenance["versions"].items())
    inspection.warn(
        not np.greater(verdict["promised"]["fix"], 0).any(),
        "no promise can be kept: every fix will be rejected",
    )
    return inspection


def first_day(about: Mapping[str, Any]) -> str:
    """Name the day whose held-out queries a grown site's promises rest on.

    Empty for a site that has not grown.
    """
    days: list[dict[str, Any]] = about["growth"]["days"] if "growth" in about else []
    return f"; all of {days[0]['day']}, not of the days since" if len(days) > 1 else ""


def _promise(limit: float) -> str:
    return (
        f"fixes of a novelty below {limit:.3g}"
        if limit > 0
        else "nothing keeps it: too few held-out blocks, or too many wrong"
    )


def _day(day: Mapping[str, Any]) -> str:
    """Describe a day that a site learned, in a line."""
    additions = (
        f", {day['places']} new places, {day['changed']} submaps changed" if "places" in day else ""
    )
    return f"{day['day']} ({day['views']} views{additions})"
