"""`yearloc grow`: a site learns a later day."""

import sys
from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.localize import left_out_text
from pipeline.cli.options import BodyTLidar, SitePath, Topic, lidar_of
from pipeline.cli.outputs import check_file
from pipeline.cli.progress import Lines
from pipeline.core.errors import ConfigError

LOG = "log"
GAP_S = 1.0
"""Surveyed poses are not interpolated over longer gaps."""


def grow(
    path: SitePath,
    log: Annotated[
        str,
        typer.Argument(
            metavar="LOG", help="a log, a bag or a folder of scans, as of localize; one drive"
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="FILE",
            help="the grown site; without it, only what would be learned is told",
        ),
    ] = None,
    surveyed: Annotated[
        str | None,
        typer.Option(
            "--poses",
            metavar="FILE",
            help="surveyed poses of the scans, TUM's columns; or the word log: the log's own",
        ),
    ] = None,
    promise: Annotated[
        float, typer.Option(metavar="SHARE", help="that a fix must keep to be learned")
    ] = 0.99,
    body_T_lidar: BodyTLidar = None,
    topic: Topic = None,
    odometry: Annotated[
        str | None, typer.Option(metavar="TOPIC", help="of a bag: poses, or tf:PARENT>CHILD")
    ] = None,
) -> None:
    """Learn a later day: new places from surveyed poses, changes from the site's own fixes."""
    from pipeline.core.frames import Trajectory
    from pipeline.lifelong import adoption, growth
    from pipeline.online import site_file
    from pipeline.online.description import first_day
    from pipeline.online.inputs import scans
    from pipeline.online.site import Site
    from pipeline.readers.folder import read_tum

    check_file(out)
    parts = site_file.read(path, views=True)
    if not parts.views:
        raise ConfigError(
            f"{path}: holds no views to learn from; only a site of `yearloc pack` of this "
            "version can grow"
        )
    site = Site(parts, threads=2)
    sensor = parts.description.sensor
    if not surveyed:
        site.check(promise)
    tell_cold()
    skipped: Counter[str] = Counter()
    lidar = lidar_of(body_T_lidar)
    log_scans = [
        *scans(
            log,
            parts.description.reader,
            sensor.lift_m,
            topic,
            odometry,
            skipped,
            lidar,
        )
    ]
    if left_out := left_out_text(skipped):
        print(f"  {left_out}", file=sys.stderr)
    if surveyed:
        poses = None if surveyed == LOG else Trajectory(*read_tum(Path(surveyed)), GAP_S)
        learned = adoption.surveyed(log_scans, poses)
    else:
        learned = adoption.adopted(site, log_scans, promise)
    plan = growth.planned(site, learned)
    print(f"{log}: {plan.line(site)}")
    if out is None:
        print(
            f"nothing was written; `-o FILE` learns it, {path} stays as it is",
            file=sys.stderr,
        )
        return
    grown_parts = growth.grown(
        site, parts, plan, Path(log).name, Lines(parts.description.method.get("budget", 1.0))
    )
    site_file.write(out, grown_parts)
    print(
        f"{out}: {len(plan.places.cells)} places, {out.stat().st_size / 1e6:.1f} MB; "
        f"{path} stays as it was"
    )
    grown_site = grown_parts.description
    print(
        f"its promises are by {grown_site.verdict.held_out} held-out blocks{first_day(grown_site)}"
    )
