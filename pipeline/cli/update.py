"""`yearloc update` makes a site learn a later day: a site and a log in, the updated site out.

A site is one file with all that it takes to localise in a place. `lifelong.pseudo_labels` decides
which scans of the log are learned, and at which poses; `lifelong.update` adds them to the site.
"""

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.options import BodyTLidar, SitePath, Strict, Topic
from pipeline.cli.outputs import check_file
from pipeline.cli.progress import Lines
from pipeline.cli.scan_options import scan_options, told_kept
from pipeline.cli.summary import tell_left_out
from pipeline.core.errors import ConfigError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from collections.abc import Sequence

    from pipeline.core.frames import Poses
    from pipeline.lifelong.pseudo_labels import PseudoLabels
    from pipeline.lifelong.update import AnyUpdate
    from pipeline.online.inputs import Scan
    from pipeline.online.site import Site
    from pipeline.online.site_file import Parts

POSES_OF_LOG = "log"
"""The word after `--poses` for the poses that the log itself has."""
REFERENCE_GAP_S = 1.0
"""Reference poses are not interpolated over longer gaps than this."""

LogPath = Annotated[
    str,
    typer.Argument(
        metavar="LOG", help="One drive: a log, a bag or a folder of scans, as for localize"
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--out",
        metavar="FILE",
        help="Write the updated site to this file; without it, only report what would be learned",
    ),
]
ReferencePoses = Annotated[
    str | None,
    typer.Option(
        "--poses",
        metavar="FILE",
        help="Learn scans at these reference poses: a TUM trajectory, KITTI poses of one row a "
        "scan, or the word log for the log's own; by default at the site's own fixes",
    ),
]
LearnedTargetPrecision = Annotated[
    float,
    typer.Option(
        metavar="P",
        help="Without --poses: learn a scan only at a fix that is right with at least this "
        "probability, as calibrated on validation blocks",
    ),
]
BagOdometry = Annotated[
    str | None,
    typer.Option(metavar="TOPIC", help="Odometry of a bag, a topic of poses or tf:PARENT>CHILD"),
]


def update(
    path: SitePath,
    log: LogPath,
    out: Out = None,
    poses: ReferencePoses = None,
    target_precision: LearnedTargetPrecision = 0.99,
    strict: Strict = False,
    body_T_lidar: BodyTLidar = None,
    topic: Topic = None,
    odometry: BagOdometry = None,
) -> None:
    """Make a site learn a later day, by reference poses (also new places) or by its own fixes."""
    from pipeline.lifelong.update import planned
    from pipeline.online import site_file
    from pipeline.online.site import Site

    check_file(out)
    parts = site_file.read(path, views=True)
    if not parts.views and not parts.description.map.is_tiled:
        raise ConfigError(
            f"{path}: holds no views to learn from; only a site of `yearloc pack` of this "
            "version can be updated"
        )
    site = Site(parts, threads=2)
    if not poses:
        told_kept(site, target_precision, strict)
    tell_cold()
    skipped: Counter[str] = Counter()
    options = scan_options(site, topic=topic, odometry=odometry, body_T_lidar=body_T_lidar)
    scans = list(options.scans(log, skipped))
    tell_left_out(skipped)
    pseudo_labels = _pseudo_labels(site, scans, poses, target_precision)
    update = planned(site, pseudo_labels)
    print(f"{log}: {update.line(site)}")
    if out is None:
        print(
            f"nothing was written; `-o FILE` writes the updated site, {path} stays as it is",
            file=sys.stderr,
        )
        return
    _write(out, path, log, site, parts, update)


def _pseudo_labels(
    site: "Site", scans: "Sequence[Scan]", poses: str | None, target_precision: float
) -> "PseudoLabels":
    """Choose the scans that the site learns, each with its pose.

    If `poses` is given, these are the reference poses in that file or of the log itself. Otherwise
    they are the site's own fixes that reach the target precision. Raises NoPseudoLabelsError if no
    scan has such a pose.
    """
    from pipeline.lifelong import pseudo_labels

    if not poses:
        return pseudo_labels.from_site(site, scans, target_precision)
    return pseudo_labels.with_reference_poses(scans, reference_poses(poses, scans))


def reference_poses(poses: str, scans: "Sequence[Scan]") -> "Poses":
    """The reference poses (scan, 4, 4) of scans that `--poses` names; NaN where there is none.

    It is a TUM trajectory, whose stamps are those of the scans; KITTI poses, of one row a scan; or
    the word log for the log's own true poses.
    """
    from pipeline.core.frames import Trajectory
    from pipeline.lifelong.pseudo_labels import own_poses, poses_at
    from pipeline.readers.folder import read_pose_rows, read_tum

    if poses == POSES_OF_LOG:
        return own_poses(scans)
    rows = read_pose_rows(Path(poses), len(scans))
    if rows is not None:
        return rows
    stamps_ns, world_T_body = read_tum(Path(poses))
    return poses_at(scans, Trajectory(stamps_ns, world_T_body, REFERENCE_GAP_S))


def _write(
    out: Path, path: Path, log: str, site: "Site", parts: "Parts", update: "AnyUpdate"
) -> None:
    """Update the site of `path`, write it to `out`, and print its places, size and thresholds."""
    from pipeline.lifelong.update import updated
    from pipeline.online import site_file
    from pipeline.online.description import first_day_words
    from pipeline.posing.map_verdict import NOT_CALIBRATED

    progress = Lines(parts.description.method.get("budget", 1.0))
    updated_parts = updated(site, parts, update, Path(log).name, progress)
    site_file.write(out, updated_parts)
    print(
        f"{out}: {len(updated_parts.arrays['cells'])} places, {out.stat().st_size / 1e6:.1f} MB; "
        f"{path} stays as it was"
    )
    description = updated_parts.description
    if not description.verdict.validation_blocks:
        print(f"its verdict is {NOT_CALIBRATED}: `yearloc calibrate {out} LOG`")
        return
    later = ", ".join(day.day for day in description.calibrated_days)
    print(
        f"its thresholds come from {description.verdict.validation_blocks} validation blocks"
        f"{first_day_words(description)}"
        f"{f'; it was calibrated on {later}, before this update' if later else ''}"
    )
