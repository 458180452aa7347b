"""`yearloc localize`: from scans to poses."""

import gc
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.options import (
    BodyTLidar,
    Follow,
    Idle,
    Odometry,
    Promise,
    SitePath,
    Topic,
    Track,
    lidar_of,
    only_one,
)
from pipeline.cli.outputs import check_file
from pipeline.core.errors import ConfigError, LogError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from pipeline.core.frames import Poses
    from pipeline.online.inputs import Scan
    from pipeline.online.site import Fix
    from pipeline.online.site_json import Sensor


def localize(
    path: SitePath,
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="INPUT", help="scans (.bin .npy .pcd), folders, logs, bags; - reads one scan"
        ),
    ],
    json: Annotated[bool, typer.Option("--json", help="an object a scan, each on a line")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="a row a scan")] = False,
    tum: Annotated[bool, typer.Option("--tum", help="a trajectory of the accepted ones")] = False,
    mcap: Annotated[
        bool,
        typer.Option("--mcap", help="the accepted ones as PoseWithCovarianceStamped, for Foxglove"),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FILE", help="instead of standard output"),
    ] = None,
    promise: Promise = 0.99,
    lift: Annotated[
        float | None,
        typer.Option(
            metavar="M", help="raises the points, so that the ground is at 0; of logs as trained"
        ),
    ] = None,
    body_T_lidar: BodyTLidar = None,
    topic: Topic = None,
    odometry: Odometry = None,
    track: Track = False,
    follow: Follow = False,
    idle: Idle = 10.0,
    threads: Annotated[int, typer.Option(metavar="N", help="for the network")] = 1,
) -> None:
    """Where scans were taken, by a site file, and whether to believe it."""
    with uncollected():
        from pipeline.online.inputs import is_log, scans
        from pipeline.online.localized import localized, tracker_of
        from pipeline.online.outputs import writer
        from pipeline.online.site import Site

    kind = only_one({"json": json, "csv": csv, "tum": tum, "mcap": mcap})
    only_one({"lift": lift, "body-T-lidar": body_T_lidar})
    if threads < 1:
        raise ConfigError(f"--threads {threads}: expected at least 1")
    site = Site.open(path, threads)
    site.check(promise)
    if odometry and not track and not site.is_level:
        raise ConfigError(f"--odometry {odometry}: needs --track")
    if site.is_level and follow:
        raise ConfigError("--follow: follows 3-D scans, and the site is level")
    check_file(out, whole=kind == "mcap")
    sensor = site.description.sensor
    if lift is not None and not follow:
        logs = [source for source in inputs if is_log(source, site.description.reader)]
        if logs:
            raise ConfigError(
                f"--lift {lift:g}: {logs[0]} is a log of the site's data set, whose reader "
                "raises its points"
            )
    lift_m = sensor.lift_m if lift is None else lift
    placement = lidar_of(body_T_lidar)
    summary = Summary(site.is_level)
    tracker = tracker_of(site, promise, track)
    tell_cold()
    with writer(kind or "text", out) as write:
        for source in inputs:
            follower = None
            if follow:
                from pipeline.online.follow import Following

                follower = Following(Path(source), topic, lift_m, idle, odometry, placement)
            scan_options = (
                site.description.reader,
                lift_m,
                topic,
                odometry,
                summary.skipped,
                placement,
                site.is_level,
            )
            source_scans = follower.scans() if follower else scans(source, *scan_options)
            fixes = localized(source_scans, tracker or site, promise, summary.broken)
            for scan, points_m, fix in fixes:
                if not summary.fixes and not site.is_level:
                    _tell_unlike(points_m, sensor, scan.body_T_lidar)
                write(scan, fix)
                summary.add(scan, fix)
            if follower:
                summary.dropped += follower.dropped
                summary.skipped += follower.skipped
                summary.broken += filter(None, [follower.damage])
    if not summary.fixes:
        raise LogError(
            summary.broken[0] if summary.broken else f"{' '.join(inputs)}: no scan there"
        )
    if tracker:
        summary.steps = tracker.steps
    print(summary.text(), file=sys.stderr)
    if site.description.simulated:
        print("the site is simulated, not recorded", file=sys.stderr)


@contextmanager
def uncollected() -> Iterator[None]:
    """Import without looking for garbage, of which modules make none: a tenth of a start."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()  # modules stay, so no later collection need look at them
        gc.enable()


def _tell_unlike(
    points_m: "NDArray[np.float64]", sensor: "Sensor", body_T_lidar: "Poses | None"
) -> None:
    """Say in what a scan (n, 3) is unlike those that the site was learned with."""
    from pipeline.online.sensor import unlike

    for line in unlike(points_m, sensor, body_T_lidar):
        print(
            f"yearloc localize: unlike the scans that the site was learned with: {line}",
            file=sys.stderr,
        )


class Summary:
    """Counts over all scans of a run: verdicts, times, and accepted fixes that are right."""

    def __init__(self, is_level: bool = False) -> None:
        self.is_level = is_level
        self.fixes: Counter[str] = Counter()
        self.broken: list[str] = []
        self.dropped = 0
        self.steps = Counter[bool]()
        self.skipped: Counter[str] = Counter()
        self._ms: list[float] = []
        self._right = Counter[bool]()

    def add(self, scan: "Scan", fix: "Fix") -> None:
        """Count one more localised scan."""
        import numpy as np

        if self.is_level:
            from pipeline.level.verdict import pose_is_right as is_right
        else:
            from pipeline.posing.verdict import right as is_right

        self.fixes[fix.verdict] += 1
        self._ms.append(fix.ms)
        if fix.verdict == "accepted" and np.isfinite(scan.world_T_scan).all():
            self._right[bool(is_right(fix.world_T_sensor[None], scan.world_T_scan[None])[0])] += 1

    def text(self) -> str:
        """Lines with the verdicts, the times, and the errors where the true pose is known."""
        import numpy as np

        verdicts = ("accepted", "near", "ambiguous", "rejected", "no pose")
        counts = ", ".join(f"{self.fixes[verdict]} {verdict}" for verdict in verdicts)
        median, slow = np.percentile(self._ms[1:] or self._ms, (50, 95))
        number = sum(self.fixes.values())
        lines = [
            f"{number} scan{'s' * (number != 1)}: {counts}; median {median:.0f} ms, 95 % within "
            f"{slow:.0f} ms"
        ]
        if self._right:
            lines.append(
                f"of {sum(self._right.values())} accepted with a true pose {self._right[False]} "
                f"are over {'1 m or 10°' if self.is_level else '2 m or 5°'} off"
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
    """How many scans of a log or bag cannot be used, and why; empty where all can."""
    why = ", ".join(f"{reason} ({count})" for reason, count in skipped.most_common() if count)
    return f"{skipped.total()} more were left out: {why}" if why else ""
