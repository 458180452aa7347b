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
"""Poses of a survey are not interpolated over more."""


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    more = commands.add_parser(
        "grow",
        help="learn a later day: new places from surveyed poses, changes from the site's own fixes",
    )
    more.add_argument("site", type=Path, metavar="SITE")
    more.add_argument(
        "log", metavar="LOG", help="a log, a bag or a folder of scans, as of localize; one drive"
    )
    more.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="FILE",
        help="the grown site; without it, only what would be learned is told",
    )
    more.add_argument(
        "--poses",
        metavar="FILE",
        help="surveyed poses of the scans, TUM's columns; or the word log: the log's own",
    )
    more.add_argument(
        "--promise",
        type=float,
        default=0.99,
        metavar="SHARE",
        help="that a fix must keep to be learned (0.99)",
    )
    add_lidar(more)
    more.add_argument("--topic", help="of a bag, where it has several clouds")
    more.add_argument("--odometry", metavar="TOPIC", help="of a bag: poses, or tf:PARENT>CHILD")


def grow(given: argparse.Namespace) -> None:
    """Write a site that knows a day more, or say what it would learn."""
    from pipeline.frames import Trajectory
    from pipeline.lifelong import adoption, growth
    from pipeline.online import site_file
    from pipeline.online.description import first_day
    from pipeline.online.inputs import scans
    from pipeline.online.site import Site
    from pipeline.readers.folder import read_tum

    check_file(given.out)
    parts = site_file.read(given.site, views=True)
    if not parts.views:
        raise ConfigError(
            f"{given.site}: holds no views to learn from; only a site of `yearloc pack` of this "
            "version can grow"
        )
    site = Site(parts, threads=2)
    about = parts.about["sensor"]
    if not given.poses:
        site.check(given.promise)
    tell_cold()
    skipped: Counter[str] = Counter()
    lidar = lidar_of(given)
    found = [
        *scans(
            given.log,
            parts.about["reader"],
            about["lift_m"],
            given.topic,
            given.odometry,
            skipped,
            lidar,
        )
    ]
    if left_out := left_out_text(skipped):
        print(f"  {left_out}", file=sys.stderr)
    if given.poses:
        poses = None if given.poses == LOG else Trajectory(*read_tum(Path(given.poses)), GAP_S)
        learned = adoption.surveyed(found, poses)
    else:
        learned = adoption.adopted(site, found, given.promise)
    plan = growth.planned(site, learned)
    print(f"{given.log}: {plan.line(site)}")
    if given.out is None:
        print(
            f"nothing was written; `-o FILE` learns it, {given.site} stays as it is",
            file=sys.stderr,
        )
        return
    after = growth.grown(
        site, parts, plan, Path(given.log).name, Lines(parts.about["method"].get("budget", 1.0))
    )
    site_file.write(given.out, after)
    print(
        f"{given.out}: {len(plan.places.cells)} places, {given.out.stat().st_size / 1e6:.1f} MB; "
        f"{given.site} stays as it was"
    )
    verdict = after.about["verdict"]
    print(f"its promises are by {verdict['held_out']} held-out blocks{first_day(after.about)}")
