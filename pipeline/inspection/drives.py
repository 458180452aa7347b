"""Key numbers of the artifacts with rows along a drive: scans, submaps, views."""

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.columns import BLOCK
from pipeline.inspection.inspection import Findings, Section, duration, metres, moment, typographic
from pipeline.inspection.survey import spread, survey
from pipeline.store import Artifact

VEHICLE = "vehicle frame: x forward, y left, z up, ground at 0"
SWEEP_POINTS = 2_000
"""Scans of fewer points are sweeps of a 2-D LiDAR, which are not diagnosed one by one."""


def scans(artifact: Artifact) -> Findings:
    """The drive, and the diagnoses of a few of its clouds."""
    drive, warnings = _drive(artifact, "world_T_scan", "scans")
    placed = np.isfinite(artifact.load("world_T_scan")).all(axis=(1, 2))
    offsets, grain_m = artifact.load("offsets"), float(artifact.attrs["grain_m"])
    sizes = np.diff(offsets)
    posed = np.isfinite(artifact.load("odom_T_scan")).all(axis=(1, 2))
    if len(sizes):
        points_a_scan = f"{sizes.min():,} … {sizes.max():,}, median {np.median(sizes):,.0f}; grain {1000 * grain_m:.3g} mm"
        drive += [
            ("points a scan", points_a_scan),
            ("true place", f"at {100 * placed.mean():.3g} % of the scans"),
            ("odometry", f"at {100 * posed.mean():.3g} % of the scans"),
        ]
    if not (placed | posed).all():
        warnings.append(f"{int((~placed & ~posed).sum())} scans have neither a true pose nor odometry: `dvc repro` them")
    if (sizes < 0).any() or offsets[-1] != artifact["points"].shape[0]:
        return Findings((Section("", tuple(drive)),), (*warnings, "offsets do not fit the points: `dvc repro` the scans"))

    def points(row: int) -> NDArray[np.float64]:
        return np.asarray(artifact["points"][offsets[row] : offsets[row + 1]], np.float64) * grain_m

    if len(sizes) and np.median(sizes) < SWEEP_POINTS:
        return Findings((Section("", (*drive, ("kind", "sweeps of a 2-D LiDAR, to be accumulated"))),), tuple(warnings))
    clouds, found = survey(spread(len(sizes)), points, VEHICLE)
    if (sizes == 0).any():
        warnings.append(f"{int((sizes == 0).sum())} scans hold no point: their views would be blank; look at the log's files")
    return Findings((Section("", tuple(drive)), clouds), (*warnings, *found))


def submaps(artifact: Artifact) -> Findings:
    """The drive, and the number of scans per submap."""
    drive, warnings = _drive(artifact, "world_T_anchor", "submaps")
    if artifact["scans"].shape[0]:
        used = np.concatenate([[0], np.cumsum(artifact.load("used"))])
        gathered = used[artifact.load("scans") + 1] - used[artifact.load("first")]
        ground_m = artifact.load("ground_m")
        drive += [
            ("gathers", f"{gathered.min():,} … {gathered.max():,} scans each, laid out by {artifact.attrs['layout']}"),
            ("ground", typographic(f"{ground_m.min():.2f} … {ground_m.max():.2f} m in the anchors' frames")),
        ]
    drive += [("left out", f"{count:,} anchors: {reason}") for reason, count in artifact.attrs["left_out"].items()]
    return Findings((Section("", tuple(drive)),), tuple(warnings))


def views(artifact: Artifact) -> Findings:
    """The drive, and the share of empty bins in the images."""
    drive, warnings = _drive(artifact, "world_T_anchor", "views")
    images = artifact["images"]
    shape, count = images.shape, int(np.prod(images.shape))
    step = max(1, BLOCK // max(1, int(np.prod(shape[1:]))))
    empty, blank, highest = 0, 0, -np.inf
    for start in range(0, shape[0], step):
        block = np.asarray(images[start : start + step])
        filled = (block != 0).reshape(len(block), -1)
        empty += int((~filled).sum())
        blank += int((~filled.any(axis=1)).sum())
        highest = max(highest, float(block.max()))
    if count:
        drive += [("empty bins", f"{100 * empty / count:.1f} %"), ("highest", f"{highest:.2f} m")]
        if blank:
            warnings.append(f"{blank} blank views: they look the same in every place; inspect the scans of these views")
        if empty > 0.995 * count:
            share = f"{100 * empty / count:.1f} %"
            warnings.append(f"{share} of the bins are empty: too fine a view for these scans; inspect the scans")
    return Findings((Section("", tuple(drive)),), tuple(warnings))


def _drive(artifact: Artifact, poses: str, what: str) -> tuple[list[tuple[str, str]], list[str]]:
    """Rows with date, duration, path and step of a drive, and warnings on its poses and stamps."""
    stamps, xyz = artifact.load("stamps_ns"), np.asarray(artifact[poses][:, :3, 3])
    rows = [(what, f"{len(stamps):,}")]
    if not len(stamps):
        return rows, []
    known = np.isfinite(xyz).all(axis=1)
    steps = np.linalg.norm(np.diff(xyz[known], axis=0), axis=1)
    seconds = float(stamps[-1] - stamps[0]) * 1e-9
    rows += [("date", moment(int(stamps[0]))), ("duration", duration(seconds))]
    warnings = []
    if len(steps):
        step = f"step median {metres(float(np.median(steps)))}, at most {metres(float(steps.max()))}"
        rows.append(("path", f"{metres(float(steps.sum()))}, {step}"))
        low, high = xyz[known].min(axis=0), xyz[known].max(axis=0)
        box = ", ".join(f"{axis} {a:.0f} … {b:.0f} m" for axis, a, b in zip("xyz", low, high, strict=True))
        rows.append(("world", typographic(f"{box} (z up)")))
    if not known.all() and poses == "world_T_anchor":
        warnings.append(f"{int((~known).sum())} {what} have no pose (NaN): `dvc repro` them")
    if (np.diff(stamps) <= 0).any():
        warnings.append("stamps do not increase: two logs mixed, or a clock set back; `dvc repro` the scans")
    return rows, warnings
