"""A .pcd file, as robots of one's own leave them."""

from pathlib import Path

import numpy as np

from pipeline.errors import LogError
from pipeline.formats import pcd
from pipeline.formats.folder import LARGEST_BYTES
from pipeline.inspection.cloud import diagnose
from pipeline.inspection.inspection import Inspection, Section, nbytes


def cloud_file(path: Path) -> Inspection:
    """Header and points of a PCD; raises LogError for a damaged one, or one without a finite point."""
    data = path.read_bytes()
    header = pcd.parse(data, path)
    points = pcd.decode(data, path, LARGEST_BYTES)
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        raise LogError(f"{path}: none of its {len(points)} points has finite x, y and z")
    diagnosis = diagnose(finite)
    several = {name: f"×{count}" if count > 1 else "" for name, count in zip(header.fields, header.counts, strict=True)}
    kinds = [f"{name}{several[name]} {kind[1:]}" for name, kind in zip(header.fields, header.types, strict=True)]
    cells = [
        ("size", f"{nbytes(len(data))}, DATA {header.data}"),
        ("fields", ", ".join(kinds)),
        (
            "points",
            f"{len(finite):,}"
            + (f", and {len(points) - len(finite):,} that are not finite" if len(finite) < len(points) else ""),
        ),
        ("frame", "taken as x forward, y left, z up, in metres; conf/dataset/folder.yaml says how it lies in the vehicle"),
    ]
    return Inspection(f"{path} — PCD cloud", (Section("", tuple(cells)), diagnosis.section()), diagnosis.warnings)
