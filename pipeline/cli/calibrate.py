"""`yearloc calibrate` learns when to accept a pose: a site and a real drive in, the site out.

A site of a 3-D map judges its fixes by the usual probabilities, learned elsewhere. A site that
learned a drive has thresholds of that day's validation blocks, which may be few. A later drive with
reference poses or odometry shows how well a real scan fits the map (lifelong/calibration.py).
"""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.options import BodyTLidar, SitePath, Topic
from pipeline.cli.outputs import check_file
from pipeline.cli.progress import Bar
from pipeline.cli.scan_options import scan_options
from pipeline.cli.summary import tell_left_out
from pipeline.cli.update import BagOdometry, reference_poses
from pipeline.core.errors import ConfigError, LogError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from collections.abc import Sequence

    from pipeline.core.frames import Poses
    from pipeline.online.inputs import Scan
    from pipeline.online.site import Site

LogPath = Annotated[
    str,
    typer.Argument(
        metavar="LOG",
        help="A later drive in the map: a log, a bag or a folder of scans, as for localize",
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "-o",
        "--out",
        metavar="FILE",
        help="Write the calibrated site to this file; by default SITE itself is replaced",
    ),
]
Poses_ = Annotated[
    str | None,
    typer.Option(
        "--poses",
        metavar="FILE",
        help="Reference poses in the map's frame: a TUM trajectory, KITTI poses of one row a scan, "
        "or the word log for the log's own; by default fixes that odometry and other scans confirm",
    ),
]


def calibrate(
    path: SitePath,
    log: LogPath,
    out: Out = None,
    poses: Poses_ = None,
    body_T_lidar: BodyTLidar = None,
    topic: Topic = None,
    odometry: BagOdometry = None,
) -> None:
    """Learn from a real drive when the poses of a site may be accepted."""
    from pipeline.lifelong.calibration import calibration, check_day, with_verdict
    from pipeline.online import site_file
    from pipeline.online.site import Site

    out = path if out is None else out
    check_file(out)
    parts = site_file.read(path, views=True)
    site = Site(parts, threads=2)
    check_day(site, Path(log).name)
    tell_cold()
    skipped: Counter[str] = Counter()
    options = scan_options(site, topic=topic, odometry=odometry, body_T_lidar=body_T_lidar)
    scans = list(options.scans(log, skipped))
    tell_left_out(skipped)
    if not scans:
        raise LogError(f"{log}: no scan there")
    learned = calibration(site, scans, _true_poses(site, log, scans, poses), Bar())
    print(learned.line(log))
    site_file.write(out, parts._replace(description=with_verdict(site, learned, Path(log).name)))
    print(f"{out}: target precisions {', '.join(map(str, learned.verdict.reachable)) or 'none'}")


def _true_poses(site: "Site", log: str, scans: "Sequence[Scan]", poses: str | None) -> "Poses":
    """The reference poses (scan, 4, 4) of a drive, NaN where unknown."""
    import numpy as np

    from pipeline.lifelong.calibration import confirmed
    from pipeline.lifelong.pseudo_labels import LOOSE_PRECISION

    if poses is not None:
        world_T_scan = reference_poses(poses, scans)
        if not np.isfinite(world_T_scan).all(axis=(1, 2)).any():
            raise LogError(f"{log}: --poses {poses} covers none of its {len(scans)} scans")
        return world_T_scan
    target_precision = site.kept_precision(LOOSE_PRECISION)
    if target_precision is None:
        raise ConfigError(
            "the site accepts no fix that could confirm others: give --poses with reference poses"
        )
    return confirmed(site, scans, target_precision)
