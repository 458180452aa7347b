"""`yearloc grow`: a site learns a later day."""

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from pipeline.cli.kernels import tell_cold
from pipeline.cli.localize import add_lidar, left_out_text, lidar_of
from pipeline.cli.outputs import check_file
from pipeline.cli.progress import Lines
from pipeline.errors import ConfigError

LOG = "log"
GAP_S = 1.0
"""Surveyed poses are not interpolated over longer gaps."""


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    command = commands.add_parser(
        "grow",
        help="learn a later day: new places from surveyed poses, changes from the site's own fixes",
    )
    command.add_argument("site", type=Path, metavar="SITE")
    command.add_argument(
        "log", metavar="LOG", help="a log, a bag or a folder of scans, as of localize; one drive"
    )
    command.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="FILE",
        help="the grown site; without it, only what would be learned is told",
    )
    command.add_argument(
        "--poses",
        metavar="FILE",
        help="surveyed poses of the scans, TUM's columns; or the word log: the log's own",
    )
    command.add_argument(
        "--promise",
        type=float,
        default=0.99,
        metavar="SHARE",
        help="that a fix must keep to be learned (0.99)",
    )
    add_lidar(command)
    command.add_argument("--topic", help="of a bag, where it has several clouds")
    command.add_argument("--odometry", metavar="TOPIC", help="of a bag: poses, or tf:PARENT>CHILD")


def grow(args: argparse.Namespace) -> None:
    """Write a site with a further day learned into it, or print what it would learn."""
    from pipeline.frames import Trajectory
    from pipeline.lifelong import adoption, growth
    from pipeline.online import site_file
    from pipeline.online.description import first_day
    from pipeline.online.inputs import scans
    from pipeline.online.site import Site
    from pipeline.readers.folder import read_tum

    check_file(args.out)
    parts = site_file.read(args.site, views=True)
    if not parts.views:
        raise ConfigError(
            f"{args.site}: holds no views to learn from; only a site of `yearloc pack` of this "
            "version can grow"
        )
    site = Site(parts, threads=2)
    sensor = parts.about["sensor"]
    if not args.poses:
        site.check(args.promise)
    tell_cold()
    skipped: Counter[str] = Counter()
    lidar = lidar_of(args)
    log_scans = [
        *scans(
            args.log,
            parts.about["reader"],
            sensor["lift_m"],
            args.topic,
            args.odometry,
            skipped,
            lidar,
        )
    ]
    if left_out := left_out_text(skipped):
        print(f"  {left_out}", file=sys.stderr)
    if args.poses:
        poses = None if args.poses == LOG else Trajectory(*read_tum(Path(args.poses)), GAP_S)
        learned = adoption.surveyed(log_scans, poses)
    else:
        learned = adoption.adopted(site, log_scans, args.promise)
    plan = growth.planned(site, learned)
    print(f"{args.log}: {plan.line(site)}")
    if args.out is None:
        print(
            f"nothing was written; `-o FILE` learns it, {args.site} stays as it is",
            file=sys.stderr,
        )
        return
    grown_parts = growth.grown(
        site, parts, plan, Path(args.log).name, Lines(parts.about["method"].get("budget", 1.0))
    )
    site_file.write(args.out, grown_parts)
    print(
        f"{args.out}: {len(plan.places.cells)} places, {args.out.stat().st_size / 1e6:.1f} MB; "
        f"{args.site} stays as it was"
    )
    verdict = grown_parts.about["verdict"]
    print(
        f"its promises are by {verdict['held_out']} held-out blocks{first_day(grown_parts.about)}"
    )
