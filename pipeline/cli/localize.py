"""`yearloc localize`: from scans to poses."""

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.cli.kernels import tell_cold
from pipeline.cli.outputs import check_file
from pipeline.errors import ConfigError, LogError

if TYPE_CHECKING:
    from pipeline.frames import Poses
    from pipeline.online.inputs import Scan
    from pipeline.online.site import Fix

KINDS = {
    "json": "an object a scan, each on a line",
    "csv": "a row a scan",
    "tum": "a trajectory of the accepted ones",
    "mcap": "the accepted ones as PoseWithCovarianceStamped, for Foxglove",
}


def share_or_none(word: str) -> float | None:
    """What `--promise` takes."""
    return None if word == "none" else float(word)


def add_lidar(command: Any) -> None:
    """Add the option that places points."""
    how = (
        "turns and raises the points, by metres and degrees; in place of a bag's transforms, but "
        "not of logs"
    )
    command.add_argument(
        "--body-T-lidar", dest="body_T_lidar", metavar="X,Y,Z,ROLL,PITCH,YAW", help=how
    )


def lidar_of(given: argparse.Namespace) -> "Poses | None":
    """What that option gives."""
    from pipeline.online.inputs import placement

    return None if given.body_T_lidar is None else placement("--body-T-lidar", given.body_T_lidar)


def localize(given: argparse.Namespace) -> None:
    """Print a fix of each scan, and what became of them all."""
    from pipeline.online.follow import Following
    from pipeline.online.inputs import is_log, scans
    from pipeline.online.odometry import step
    from pipeline.online.outputs import writer
    from pipeline.online.sensor import unlike
    from pipeline.online.site import Site
    from pipeline.online.tracking import Tracker

    if given.odometry and not given.track:
        raise ConfigError(f"--odometry {given.odometry}: needs --track")
    if given.threads < 1:
        raise ConfigError(f"--threads {given.threads}: expected at least 1")
    site = Site.open(given.site, given.threads)
    site.check(given.promise)
    check_file(given.out, whole=given.kind == "mcap")
    about = site.about["sensor"]
    if given.lift is not None and not given.follow:
        logs = [source for source in given.inputs if is_log(source, site.about["reader"])]
        if logs:
            raise ConfigError(
                f"--lift {given.lift:g}: {logs[0]} is a log of the site's data set, whose reader "
                "raises its points"
            )
    lift_m = about["lift_m"] if given.lift is None else given.lift
    body_T_lidar = lidar_of(given)
    told = Summary()
    tracker = Tracker(site, given.promise) if given.track else None
    before: Scan | None = None
    tell_cold()
    with writer(given.kind or "text", given.out) as write:
        for source in given.inputs:
            follower = None
            if given.follow:
                follower = Following(
                    Path(source), given.topic, lift_m, given.idle, given.odometry, body_T_lidar
                )
            how = (
                site.about["reader"],
                lift_m,
                given.topic,
                given.odometry,
                told.skipped,
                body_T_lidar,
            )
            for scan in follower.scans() if follower else scans(source, *how):
                try:
                    points_m = scan.points()
                except (LogError, OSError) as error:
                    told.broken.append(
                        str(error) if scan.name in str(error) else f"{scan.name}: {error}"
                    )
                    continue
                if not told.fixes:
                    for line in unlike(points_m, about, scan.body_T_lidar):
                        print(
                            "yearloc localize: unlike the scans that the site was learned with: "
                            f"{line}",
                            file=sys.stderr,
                        )
                if tracker is None:
                    fix = site.localize(points_m, given.promise)
                else:
                    driven = step(before, scan)
                    told.steps[driven is not None] += 1
                    fix = tracker.localize(points_m, driven, scan.stamp_ns)
                    before = scan
                write(scan, fix)
                told.add(scan, fix)
            if follower:
                told.dropped += follower.dropped
                told.skipped += follower.skipped
                told.broken += filter(None, [follower.damage])
    if not told.fixes:
        raise LogError(
            told.broken[0] if told.broken else f"{' '.join(given.inputs)}: no scan there"
        )
    print(told.text(), file=sys.stderr)
    if site.about["simulated"]:
        print("the site is simulated, not recorded", file=sys.stderr)


class Summary:
    """What became of all scans."""

    def __init__(self) -> None:
        self.fixes: Counter[str] = Counter()
        self.broken: list[str] = []
        self.dropped = 0
        self.steps = Counter[bool]()
        self.skipped: Counter[str] = Counter()
        self._ms: list[float] = []
        self._right = Counter[bool]()

    def add(self, scan: "Scan", fix: "Fix") -> None:
        """One more."""
        import numpy as np

        from pipeline.posing.verdict import right

        self.fixes[fix.verdict] += 1
        self._ms.append(fix.ms)
        if fix.verdict == "accepted" and np.isfinite(scan.world_T_scan).all():
            self._right[bool(right(fix.world_T_sensor[None], scan.world_T_scan[None])[0])] += 1

    def text(self) -> str:
        """A line, or two: what came of them, how fast, and against the truth where it is known."""
        import numpy as np

        told = ("accepted", "near", "ambiguous", "rejected", "no pose")
        counts = ", ".join(f"{self.fixes[verdict]} {verdict}" for verdict in told)
        median, slow = np.percentile(self._ms[1:] or self._ms, (50, 95))
        number = sum(self.fixes.values())
        lines = [
            f"{number} scan{'s' * (number != 1)}: {counts}; median {median:.0f} ms, 95 % within "
            f"{slow:.0f} ms"
        ]
        if self._right:
            lines.append(
                f"of {sum(self._right.values())} accepted with a true pose {self._right[False]} "
                "are over 2 m or 5° off"
            )
        if self.steps:
            lines.append(
                f"followed by odometry over {self.steps[True]} steps, by constant motion over "
                f"{self.steps[False]}"
            )
        if self.dropped:
            lines.append(f"{self.dropped} more came while another was localised, and were dropped")
        if left_out := left_out_text(self.skipped):
            lines.append(left_out)
        if self.broken:
            lines.append(f"{len(self.broken)} could not be read, the first: {self.broken[0]}")
        return "\n".join(lines)


def left_out_text(skipped: Counter[str]) -> str:
    """How many scans a log or a bag holds besides that cannot be used, and why; nothing of none."""
    why = ", ".join(f"{reason} ({count})" for reason, count in skipped.most_common() if count)
    return f"{skipped.total()} more were left out: {why}" if why else ""
