"""`yearloc update` teaches a site a later day: it reads a site file and a log, and writes a new
site.

A site is one file with all that it takes to localise in a place. `lifelong.pseudo_labels` decides
which scans of the log are learned, and at which poses; `lifelong.update` adds them to the site.
"""

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.options import BodyTLidar, SitePath, Topic
from pipeline.cli.outputs import check_file
from pipeline.cli.progress import Lines
from pipeline.cli.scan_options import scan_options
from pipeline.cli.summary import tell_left_out
from pipeline.core.errors import ConfigError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from collections.abc import Sequence

    from pipeline.lifelong.pseudo_labels import PseudoLabels
    from pipeline.lifelong.update import Update
    from pipeline.online.inputs import Scan
    from pipeline.online.site import Site
    from pipeline.online.site_file import Parts

POSES_OF_LOG = "log"
"""The word after `--poses` for the poses that the log itself has."""
REFERENCE_GAP_S = 1.0
"""Surveyed poses are not interpolated over gaps that are longer than this."""

LogPath = Annotated[
    str,
    typer.Argument(
        metavar="LOG", help="a log, a bag or a folder of scans, as of localize; one drive"
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--out",
        metavar="FILE",
        help="the updated site; without it, only what would be learned is reported",
    ),
]
ReferencePoses = Annotated[
    str | None,
    typer.Option(
        "--poses",
        metavar="FILE",
        help="reference poses of the scans, TUM's columns; or the word log: the log's own",
    ),
]
LearnedTargetPrecision = Annotated[
    float, typer.Option(metavar="SHARE", help="that a fix must keep to be learned")
]
BagOdometry = Annotated[
    str | None, typer.Option(metavar="TOPIC", help="of a bag: poses, or tf:PARENT>CHILD")
]


def update(
    path: SitePath,
    log: LogPath,
    out: Out = None,
    poses: ReferencePoses = None,
    target_precision: LearnedTargetPrecision = 0.99,
    body_T_lidar: BodyTLidar = None,
    topic: Topic = None,
    odometry: BagOdometry = None,
) -> None:
    """Learn a later day: new places from reference poses, changes from the site's own fixes."""
    from pipeline.lifelong.update import planned
    from pipeline.online import site_file
    from pipeline.online.site import Site

    check_file(out)
    parts = site_file.read(path, views=True)
    if not parts.views:
        raise ConfigError(
            f"{path}: holds no views to learn from; only a site of `yearloc pack` of this "
            "version can be updated"
        )
    site = Site(parts, threads=2)
    if not poses:
        site.check(target_precision)
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
            f"nothing was written; `-o FILE` learns it, {path} stays as it is",
            file=sys.stderr,
        )
        return
    _write(out, path, log, site, parts, update)


def _pseudo_labels(
    site: "Site", scans: "Sequence[Scan]", poses: str | None, target_precision: float
) -> "PseudoLabels":
    """Choose the scans that the site learns, each with its pose.

    If `poses` is given, the poses are reference poses: in that file, or of the log itself. Else
    they are the site's own fixes that reach the target precision, a precision. Raises
    NoPseudoLabelsError if no scan has such a pose.
    """
    from pipeline.core.frames import Trajectory
    from pipeline.lifelong import pseudo_labels
    from pipeline.readers.folder import read_tum

    if not poses:
        return pseudo_labels.from_site(site, scans, target_precision)
    if poses == POSES_OF_LOG:
        return pseudo_labels.with_reference_poses(scans)
    stamps_ns, world_T_body = read_tum(Path(poses))
    return pseudo_labels.with_reference_poses(
        scans, Trajectory(stamps_ns, world_T_body, REFERENCE_GAP_S)
    )


def _write(out: Path, path: Path, log: str, site: "Site", parts: "Parts", update: "Update") -> None:
    """Grow the site of `path`, write it to `out`, and print what it has become."""
    from pipeline.lifelong.update import updated
    from pipeline.online import site_file
    from pipeline.online.description import first_day_words

    progress = Lines(parts.description.method.get("budget", 1.0))
    updated_parts = updated(site, parts, update, Path(log).name, progress)
    site_file.write(out, updated_parts)
    print(
        f"{out}: {len(update.places.cells)} places, {out.stat().st_size / 1e6:.1f} MB; "
        f"{path} stays as it was"
    )
    description = updated_parts.description
    print(
        f"its thresholds are by {description.verdict.validation} validation blocks"
        f"{first_day_words(description)}"
    )
