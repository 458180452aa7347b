"""Describes artifacts with rows along a drive for `yearloc inspect`: scans, submaps, views.

Each function adds the key numbers of one artifact as rows of text, and warnings, to an Inspection.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import step_lengths_m
from pipeline.core.schemas import Scans, Submaps, Views
from pipeline.inspection.cloud import describe_clouds
from pipeline.inspection.columns import blocks
from pipeline.inspection.inspection import Inspection, box, duration, metres, moment, typographic

VEHICLE = "vehicle frame: x forward, y left, z up, ground at 0"
SWEEP_POINTS = 2_000
"""Scans of fewer points are sweeps of a 2-D LiDAR, which are not diagnosed one by one."""
EMPTY_SHARE = 0.995
"""With more empty bins than this share, a view is too fine for its scans."""


def add_scans(artifact: Scans, inspection: Inspection) -> None:
    """Add numbers on the drive, and the diagnoses of a few of its clouds."""
    rows = _drive_rows(artifact, inspection, "world_T_scan", "scans")
    has_ground_truth = np.isfinite(artifact.world_T_scan).all(axis=(1, 2))
    has_odometry = np.isfinite(artifact.odom_T_scan).all(axis=(1, 2))
    offsets = artifact.offsets
    grain_m = artifact.grain_m
    sizes = np.diff(offsets)
    if len(sizes):
        points_a_scan = (
            f"{sizes.min():,} … {sizes.max():,}, median {np.median(sizes):,.0f}; grain "
            f"{1000 * grain_m:.3g} mm"
        )
        rows += [
            ("points a scan", points_a_scan),
            ("true place", f"at {100 * has_ground_truth.mean():.3g} % of the scans"),
            ("odometry", f"at {100 * has_odometry.mean():.3g} % of the scans"),
        ]
    unposed_count = int((~has_ground_truth & ~has_odometry).sum())
    inspection.warn_if(
        unposed_count,
        f"{unposed_count} scans have neither a true pose nor odometry: `dvc repro` them",
    )
    offsets_fit = (sizes >= 0).all() and offsets[-1] == artifact["points"].shape[0]
    inspection.warn_if(not offsets_fit, "offsets do not fit the points: `dvc repro` the scans")
    are_sweeps = offsets_fit and len(sizes) and np.median(sizes) < SWEEP_POINTS
    if are_sweeps:
        rows.append(("kind", "sweeps of a 2-D LiDAR, to be accumulated"))
    inspection.add("", *rows)

    def points(row: int) -> NDArray[np.float64]:
        return np.asarray(artifact["points"][offsets[row] : offsets[row + 1]], np.float64) * grain_m

    if offsets_fit and not are_sweeps:
        empty_count = int((sizes == 0).sum())
        inspection.warn_if(
            empty_count,
            f"{empty_count} scans hold no point: their views would be blank; look at the log's "
            "files",
        )
        describe_clouds(inspection, len(sizes), points, VEHICLE)


def add_submaps(artifact: Submaps, inspection: Inspection) -> None:
    """Add numbers on the drive, and the number of scans per submap."""
    rows = _drive_rows(artifact, inspection, "world_T_anchor", "submaps")
    if len(artifact.scans):
        used_before = np.concatenate([[0], np.cumsum(artifact.used)])
        # the used scans from a submap's first one to the one that it stands at
        scan_counts = used_before[artifact.scans + 1] - used_before[artifact.first]
        ground_m = artifact.ground_m
        rows += [
            (
                "gathers",
                f"{scan_counts.min():,} … {scan_counts.max():,} scans each, placed by "
                f"{artifact.layout}",
            ),
            (
                "ground",
                typographic(
                    f"{ground_m.min():.2f} … {ground_m.max():.2f} m in the anchors' frames"
                ),
            ),
        ]
    for reason, count in artifact.left_out.items():
        rows.append(("left out", f"{count:,} anchors: {reason}"))
    inspection.add("", *rows)


def add_views(artifact: Views, inspection: Inspection) -> None:
    """Add numbers on the drive, and the share of empty bins in the images."""
    rows = _drive_rows(artifact, inspection, "world_T_anchor", "views")
    images = artifact["images"]
    bins = int(np.prod(images.shape))
    if not bins:
        inspection.add("", *rows)
        return
    empty_bins = 0
    blank_views = 0
    highest_m = -np.inf
    for block in blocks(images):
        is_filled = (block != 0).reshape(len(block), -1)
        empty_bins += int((~is_filled).sum())
        blank_views += int((~is_filled.any(axis=1)).sum())
        highest_m = max(highest_m, float(block.max()))
    share = f"{100 * empty_bins / bins:.1f} %"
    inspection.add("", *rows, ("empty bins", share), ("highest", f"{highest_m:.2f} m"))
    inspection.warn_if(
        blank_views,
        f"{blank_views} blank views: they look the same in every place; inspect the scans of these "
        "views",
    )
    inspection.warn_if(
        empty_bins > EMPTY_SHARE * bins,
        f"{share} of the bins are empty: too fine a view for these scans; inspect the scans",
    )


def _drive_rows(
    artifact: Scans | Submaps | Views, inspection: Inspection, poses: str, row_name: str
) -> list[tuple[str, str]]:
    """Rows with the count, date, duration, path and step of a drive; warns of poses and stamps."""
    stamps = artifact.stamps_ns
    xyz_m = np.asarray(artifact[poses][:, :3, 3])
    rows = [(row_name, f"{len(stamps):,}")]
    if not len(stamps):
        return rows
    has_pose = np.isfinite(xyz_m).all(axis=1)
    steps_m = step_lengths_m(xyz_m[has_pose])
    rows += [
        ("date", moment(int(stamps[0]))),
        ("duration", duration(float(stamps[-1] - stamps[0]) * 1e-9)),
    ]
    if len(steps_m):
        median = metres(float(np.median(steps_m)))
        longest = metres(float(steps_m.max()))
        rows += [
            ("path", f"{metres(float(steps_m.sum()))}, step median {median}, at most {longest}"),
            ("world", f"{box(xyz_m[has_pose], 'xyz', 0)} (z up)"),
        ]
    unposed_count = int((~has_pose).sum())
    inspection.warn_if(
        unposed_count and poses == "world_T_anchor",  # scans may have odometry instead
        f"{unposed_count} {row_name} have no pose (NaN): `dvc repro` them",
    )
    runs_back = (np.diff(stamps) <= 0).any()
    inspection.warn_if(
        runs_back,
        "stamps do not increase: two logs mixed, or a clock set back; `dvc repro` the scans",
    )
    return rows
