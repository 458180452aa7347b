"""`yearloc watch` shows a drive on a site's map, scan by scan, with the verdict on each pose.

It localises a log or a recording by a site (one file with all that it takes to localise in a place)
and opens rerun's viewer, or writes a file for rerun or Foxglove.
"""

from itertools import islice
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.options import (
    BodyTLidar,
    Follow,
    Idle,
    Odometry,
    PriorSigma,
    PriorText,
    SitePath,
    Strict,
    TargetPrecision,
    Topic,
    Track,
)
from pipeline.cli.outputs import check_file
from pipeline.cli.scan_options import (
    check_site,
    prior_of,
    scan_options,
    scans_or_followed,
    told_kept,
)
from pipeline.cli.summary import Summary
from pipeline.core.errors import ConfigError

LogPath = Annotated[
    str, typer.Argument(metavar="LOG", help="A log, a bag or a folder of scans, as for localize")
]
Save = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.rrd",
        help="Write this file for rerun, or FILE.mcap for Foxglove, instead of opening the viewer",
    ),
]
Every = Annotated[int, typer.Option(metavar="N", help="Show only every N-th scan")]


def watch(
    path: SitePath,
    log: LogPath,
    save: Save = None,
    target_precision: TargetPrecision = 0.99,
    strict: Strict = False,
    body_T_lidar: BodyTLidar = None,
    topic: Topic = None,
    odometry: Odometry = None,
    prior: PriorText = None,
    prior_sigma: PriorSigma = None,
    track: Track = False,
    follow: Follow = False,
    idle: Idle = 10.0,
    every: Every = 1,
) -> None:
    """Show a drive on the map with the verdicts, in rerun's viewer or as a file."""
    from pipeline.online import foxglove
    from pipeline.online import watch as rerun
    from pipeline.online.localized import localized, tracker_of
    from pipeline.online.site import Site

    if every < 1:
        raise ConfigError(f"--every {every}: expected at least 1")
    if save is not None and save.suffix not in (".rrd", ".mcap"):
        raise ConfigError(f"--save {save}: expected FILE.rrd or FILE.mcap")
    site = Site.open(path)
    check_site(site, odometry, track, follow)
    check_file(save)
    target_precision = told_kept(site, target_precision, strict)
    believed = prior_of(prior, prior_sigma)
    is_for_foxglove = save is not None and save.suffix == ".mcap"
    open_recording: Any = foxglove.Recording if is_for_foxglove else rerun.Recording
    tell_cold()
    options = scan_options(site, topic=topic, odometry=odometry, body_T_lidar=body_T_lidar)
    summary = Summary(site.claim_judge.tolerances)
    all_scans = scans_or_followed(options, log, follow, idle, summary)
    scans = islice(all_scans, 0, None, every)  # every N-th, from the first on
    localizer = tracker_of(site, target_precision, track) or site
    with open_recording(site, save, target_precision) as recording:
        fixes = localized(scans, localizer, target_precision, summary.broken, believed)
        for number, (scan, points_m, fix) in enumerate(fixes):
            recording.add(number * every, scan, points_m, fix)
            summary.add(scan, fix)
    summary.check_any(log)
    summary.tell()
