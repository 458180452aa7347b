"""Key numbers of the artifacts with rows along a drive: scans, submaps, views."""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.schemas import Scans, Submaps, Views
from pipeline.inspection.cloud import survey
from pipeline.inspection.columns import blocks
from pipeline.inspection.inspection import Inspection, box, duration, metres, moment, typographic

VEHICLE = "vehicle frame: x forward, y left, z up, ground at 0"
SWEEP_POINTS = 2_000
"""Scans of fewer points are sweeps of a 2-D LiDAR, which are not diagnosed one by one."""


def scans(artifact: Scans, inspection: Inspection) -> None:
    """Add numbers on the drive, and the diagnoses of a few of its clouds."""
    drive = _drive(artifact, inspection, "world_T_scan", "scans")
    has_truth = np.isfinite(artifact.world_T_scan).all(axis=(1, 2))
    has_odometry = np.isfinite(artifact.odom_T_scan).all(axis=(1, 2))
    offsets = artifact.offsets
    grain_m = artifact.grain_m
    sizes = np.diff(offsets)
    if len(sizes):
        points_a_scan = (
            f"{sizes.min():,} … {sizes.max():,}, median {np.median(sizes):,.0f}; grain "
            f"{1000 * grain_m:.3g} mm"
        )
        drive += [
            ("points a scan", points_a_scan),
            ("true place", f"at {100 * has_truth.mean():.3g} % of the scans"),
            ("odometry", f"at {100 * has_odometry.mean():.3g} % of the scans"),
        ]
    unposed = int((~has_truth & ~has_odometry).sum())
    empty = int((sizes == 0).sum())
    inspection.warn(
        unposed, f"{unposed} scans have neither a true pose nor odometry: `dvc repro` them"
    )
    fits = (sizes >= 0).all() and offsets[-1] == artifact["points"].shape[0]
    inspection.warn(not fits, "offsets do not fit the points: `dvc repro` the scans")
    is_sweeps = fits and len(sizes) and np.median(sizes) < SWEEP_POINTS
    inspection.add(
        "", *drive, *([("kind", "sweeps of a 2-D LiDAR, to be accumulated")] if is_sweeps else [])
    )

    def points(row: int) -> NDArray[np.float64]:
        return np.asarray(artifact["points"][offsets[row] : offsets[row + 1]], np.float64) * grain_m

    if fits and not is_sweeps:
        inspection.warn(
            empty,
            f"{empty} scans hold no point: their views would be blank; look at the log's files",
        )
        survey(inspection, len(sizes), points, VEHICLE)


def submaps(artifact: Submaps, inspection: Inspection) -> None:
    """Add numbers on the drive, and the number of scans per submap."""
    drive = _drive(artifact, inspection, "world_T_anchor", "submaps")
    if len(artifact.scans):
        used = np.concatenate([[0], np.cumsum(artifact.used)])
        gathered = used[artifact.scans + 1] - used[artifact.first]
        ground_m = artifact.ground_m
        drive += [
            (
                "gathers",
                f"{gathered.min():,} … {gathered.max():,} scans each, laid out by "
                f"{artifact.layout}",
            ),
            (
                "ground",
                typographic(
                    f"{ground_m.min():.2f} … {ground_m.max():.2f} m in the anchors' frames"
                ),
            ),
        ]
    left_out = artifact.left_out.items()
    inspection.add(
        "", *drive, *(("left out", f"{count:,} anchors: {reason}") for reason, count in left_out)
    )


def views(artifact: Views, inspection: Inspection) -> None:
    """Add numbers on the drive, and the share of empty bins in the images."""
    drive = _drive(artifact, inspection, "world_T_anchor", "views")
    count = int(np.prod(artifact["images"].shape))
    empty = 0
    blank = 0
    highest = -np.inf
    for block in blocks(artifact["images"]) if count else ():
        filled = (block != 0).reshape(len(block), -1)
        empty += int((~filled).sum())
        blank += int((~filled.any(axis=1)).sum())
        highest = max(highest, float(block.max()))
    share = f"{100 * empty / max(count, 1):.1f} %"
    inspection.add(
        "", *drive, *([("empty bins", share), ("highest", f"{highest:.2f} m")] if count else [])
    )
    inspection.warn(
        blank,
        f"{blank} blank views: they look the same in every place; inspect the scans of these views",
    )
    sparse_bins = (
        f"{share} of the bins are empty: too fine a view for these scans; inspect the scans"
    )
    inspection.warn(empty > 0.995 * count, sparse_bins)


def _drive(
    artifact: Scans | Submaps | Views, inspection: Inspection, poses: str, row_name: str
) -> list[tuple[str, str]]:
    """Rows with date, duration, path and step of a drive; warns of its poses and stamps."""
    stamps = artifact.stamps_ns
    xyz = np.asarray(artifact[poses][:, :3, 3])
    rows = [(row_name, f"{len(stamps):,}")]
    if not len(stamps):
        return rows
    has_pose = np.isfinite(xyz).all(axis=1)
    steps = np.linalg.norm(np.diff(xyz[has_pose], axis=0), axis=1)
    rows += [
        ("date", moment(int(stamps[0]))),
        ("duration", duration(float(stamps[-1] - stamps[0]) * 1e-9)),
    ]
    if len(steps):
        step = (
            f"step median {metres(float(np.median(steps)))}, at most {metres(float(steps.max()))}"
        )
        rows += [
            ("path", f"{metres(float(steps.sum()))}, {step}"),
            ("world", f"{box(xyz[has_pose], 'xyz', 0)} (z up)"),
        ]
    unposed = int((~has_pose).sum())
    inspection.warn(
        unposed and poses == "world_T_anchor",
        f"{unposed} {row_name} have no pose (NaN): `dvc repro` them",
    )
    runs_back = (np.diff(stamps) <= 0).any()
    inspection.warn(
        runs_back,
        "stamps do not increase: two logs mixed, or a clock set back; `dvc repro` the scans",
    )
    return rows
