"""`yearloc localize`: from scans to poses."""

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import ConfigError, LogError

if TYPE_CHECKING:
    from pipeline.online.inputs import Scan
    from pipeline.online.site import Fix, Site

KINDS = {
    "json": "an object a scan, each on a line",
    "csv": "a row a scan",
    "tum": "a trajectory of the accepted ones",
    "mcap": "the accepted ones as PoseWithCovarianceStamped, for Foxglove",
}


def check(site: "Site", promise: float, out: Path | None) -> None:
    """Refuse a promise that the site does not make and a file in no folder; say if nothing will be accepted."""
    if promise not in site.promises:
        raise ConfigError(f"--promise {promise:g}: expected one of {', '.join(map(str, site.promises))}")
    check_folder(out)
    if not site.promises[promise] > 0:
        print(f"  no threshold keeps a promise of {promise:g}: every fix will be rejected (`yearloc inspect`)", file=sys.stderr)


def check_folder(out: Path | None) -> None:
    """Refuse a file in a folder that is not there."""
    if out is not None and not out.parent.is_dir():
        raise ConfigError(f"{out}: no folder {out.parent}")


def localize(given: argparse.Namespace) -> None:
    """Print a fix of each scan, and what became of them all."""
    import numpy as np

    from pipeline.online.follow import Following
    from pipeline.online.inputs import NO_POSE, is_log, scans
    from pipeline.online.outputs import writer
    from pipeline.online.sensor import unlike
    from pipeline.online.site import Site
    from pipeline.online.tracking import Tracker

    if given.odometry and not given.track:
        raise ConfigError(f"--odometry {given.odometry}: needs --track")
    if given.threads < 1:
        raise ConfigError(f"--threads {given.threads}: expected at least 1")
    site = Site.open(given.site, given.threads)
    check(site, given.promise, given.out)
    about, reader = site.about["sensor"], site.about["reader"]
    logs = [source for source in given.inputs if not given.follow and is_log(source, reader)]
    if given.lift is not None and logs:
        raise ConfigError(f"--lift {given.lift:g}: {logs[0]} is a log of the site's data set, whose reader raises its points")
    lift_m = about["lift_m"] if given.lift is None else given.lift
    told, tracker, before = Summary(), Tracker(site, given.promise) if given.track else None, NO_POSE
    with writer(given.kind or "text", given.out) as write:
        for source in given.inputs:
            follower = Following(Path(source), given.topic, lift_m, given.idle) if given.follow else None
            found = follower.scans() if follower else scans(source, reader, lift_m, given.topic, given.odometry)
            for scan in found:
                try:
                    points_m = scan.points()
                except (LogError, OSError) as error:
                    told.broken.append(str(error) if scan.name in str(error) else f"{scan.name}: {error}")
                    continue
                if not told.fixes:
                    key = "reader.lidar_height_m" if "lidar_height_m" in reader else "reader.lift_m"
                    option = key if source in logs else "--lift"
                    for line in unlike(points_m, about, lift_m, option):
                        print(f"yearloc localize: unlike the scans that the site was learned with: {line}", file=sys.stderr)
                if tracker is None:
                    fix = site.localize(points_m, given.promise)
                else:
                    known = bool(np.isfinite(before).all() and np.isfinite(scan.odom_T_scan).all())
                    told.steps[known] += 1
                    fix = tracker.localize(points_m, np.linalg.inv(before) @ scan.odom_T_scan if known else None, scan.stamp_ns)
                    before = scan.odom_T_scan
                write(scan, fix)
                told.add(scan, fix)
            if follower:
                told.dropped += follower.dropped
                told.broken += filter(None, [follower.damage])
    if not told.fixes:
        raise LogError(told.broken[0] if told.broken else f"{' '.join(given.inputs)}: no scan there")
    print(told.text(), file=sys.stderr)
    if site.about["simulated"]:
        print("the site is simulated, not recorded", file=sys.stderr)


class Summary:
    """What became of all scans."""

    def __init__(self) -> None:
        self.fixes: Counter[str] = Counter()
        self.broken: list[str] = []
        self.dropped, self.steps = 0, Counter[bool]()
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

        counts = ", ".join(f"{self.fixes[verdict]} {verdict}" for verdict in ("accepted", "rejected", "no pose"))
        median, slow = np.percentile(self._ms[1:] or self._ms, (50, 95))
        number = sum(self.fixes.values())
        lines = [f"{number} scan{'s' * (number != 1)}: {counts}; median {median:.0f} ms, 95 % within {slow:.0f} ms"]
        if self._right:
            lines.append(f"of {sum(self._right.values())} accepted with a true pose {self._right[False]} are over 2 m or 5° off")
        if self.steps:
            lines.append(f"followed by odometry over {self.steps[True]} steps, by constant motion over {self.steps[False]}")
        if self.dropped:
            lines.append(f"{self.dropped} more came while another was localised, and were dropped")
        if self.broken:
            lines.append(f"{len(self.broken)} could not be read, the first: {self.broken[0]}")
        return "\n".join(lines)
