"""`yearloc pack`, `localize`: from a trained model to a site file, and from scans to poses."""

import argparse
import os
import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from pipeline.errors import ConfigError, LogError

if TYPE_CHECKING:
    from pipeline.online.inputs import Scan
    from pipeline.online.site import Fix

KINDS = {
    "json": "an object a scan and line",
    "csv": "a row a scan",
    "tum": "accepted ones alone",
    "mcap": "accepted ones, for Foxglove",
}


def add_commands(commands: Any) -> None:
    """Add these commands to the parser."""
    pack = commands.add_parser("pack", help="one file of all that it takes to localise in a place")
    pack.add_argument("name", metavar="STUDY/GRID/METHOD", help="such as campus/10m/sci_ring; a variant is METHOD-VARIANT")
    pack.add_argument("-o", "--out", type=Path, required=True, metavar="FILE")
    find = commands.add_parser("localize", help="where scans were taken, by a site file, and whether to believe it")
    find.add_argument("site", type=Path, metavar="SITE")
    find.add_argument("inputs", nargs="+", metavar="INPUT", help="scans (.bin .npy .pcd), folders, logs, bags; - reads one scan")
    kinds = find.add_mutually_exclusive_group()
    for kind, what in KINDS.items():
        kinds.add_argument(f"--{kind}", action="store_const", const=kind, dest="kind", help=what)
    find.add_argument("-o", "--out", type=Path, metavar="FILE", help="instead of standard output")
    find.add_argument("--promise", type=float, default=0.99, metavar="SHARE", help="of right ones among the accepted (0.99)")
    find.add_argument("--lift", type=float, metavar="M", help="raises the points, so that the ground is at 0; of logs as trained")
    find.add_argument("--topic", help="of a bag, where it has several clouds")
    find.add_argument("--track", action="store_true", help="scans are one path: follow it, by odometry where the log has some")
    find.add_argument("--threads", type=int, default=1, help="for the network (1)")
    onnx = commands.add_parser("export", help="a site's network as ONNX; or a site that answers through it, without torch")
    onnx.add_argument("site", type=Path, metavar="SITE")
    onnx.add_argument("-o", "--out", type=Path, required=True, metavar="FILE.onnx|FILE.site")
    serve = commands.add_parser("serve", help="answer over HTTP: POST /localize, /healthz, /metrics")
    serve.add_argument("site", type=Path, metavar="SITE")
    serve.add_argument("--port", type=int, default=8765)
    serve.add_argument("--host", default="127.0.0.1", help="another one needs a token in YEARLOC_TOKEN (127.0.0.1)")
    serve.add_argument("--workers", type=int, default=1, help="processes, one a core (1)")
    watch = commands.add_parser("watch", help="see scans snapped onto the map, with verdicts, in rerun's viewer or as a file")
    watch.add_argument("site", type=Path, metavar="SITE")
    watch.add_argument("log", metavar="LOG", help="as of localize")
    watch.add_argument("--save", type=Path, metavar="FILE.rrd", help="instead of opening the viewer; or FILE.mcap for Foxglove")
    watch.add_argument("--promise", type=float, default=0.99, metavar="SHARE")
    watch.add_argument("--every", type=int, default=1, metavar="N", help="only every N-th scan (1)")


def watch(given: argparse.Namespace) -> None:
    """Localise a log and record what a person wants to see of it."""
    from pipeline.online import foxglove
    from pipeline.online import watch as rerun
    from pipeline.online.inputs import scans
    from pipeline.online.site import Site

    if given.every < 1:
        raise ConfigError(f"--every {given.every}: expected at least 1")
    if given.save is not None and given.save.suffix not in (".rrd", ".mcap"):
        raise ConfigError(f"--save {given.save}: expected FILE.rrd or FILE.mcap")
    site, told = Site.open(given.site), Summary()
    if given.promise not in site.promises:
        raise ConfigError(f"--promise {given.promise}: expected one of {', '.join(map(str, site.promises))}")
    recorder: Any = foxglove.Recording if given.save is not None and given.save.suffix == ".mcap" else rerun.Recording
    with recorder(site, given.save, given.promise) as recording:
        for number, scan in enumerate(scans(given.log, site.about["reader"], site.about["sensor"]["lift_m"])):
            if number % given.every:
                continue
            try:
                points_m = scan.points()
            except (LogError, OSError) as error:
                told.broken.append(f"{scan.name}: {error}")
                continue
            fix = site.localize(points_m, given.promise)
            recording.add(number, scan, points_m, fix)
            told.add(scan, fix)
    if not told.fixes:
        raise LogError(told.broken[0] if told.broken else f"{given.log}: no scan there")
    print(told.text(), file=sys.stderr)


def serve(given: argparse.Namespace) -> None:
    """Serve until it is stopped."""
    try:
        import uvicorn

        from pipeline.online import serve as online
    except ImportError as error:
        raise ConfigError(f"{error.name}: not installed; `pip install 'yearloc[serve]'`") from None
    token, application = os.environ.get(online.TOKEN, ""), "pipeline.online.serve:from_environment"
    online.check_reach(given.host, token)
    if given.workers < 1:
        raise ConfigError(f"--workers {given.workers}: expected at least 1")
    from pipeline.online.site_file import read

    read(given.site)
    os.environ[online.SITE] = str(given.site.resolve())
    with TemporaryDirectory() as shared:
        if given.workers > 1:
            os.environ["PROMETHEUS_MULTIPROC_DIR"] = shared
        options = {"host": given.host, "port": given.port, "workers": given.workers, "log_level": "warning"}
        print(f"serving {given.site} at http://{given.host}:{given.port}/localize; Ctrl-C stops it", file=sys.stderr, flush=True)
        uvicorn.run(application, factory=True, timeout_keep_alive=10, limit_concurrency=256, server_header=False, **options)


def export(given: argparse.Namespace) -> None:
    """Write an ONNX file, or a site with one."""
    from pipeline.online.export import export

    print(export(given.site, given.out))


def pack(given: argparse.Namespace, conf: Path, studies: dict[str, dict[str, Any]], progress: Any) -> None:
    """Write a site file."""
    from pipeline.online.pack import Packing

    print(Packing(conf, Path("artifacts"), studies).pack(given.name, given.out, progress))


def localize(given: argparse.Namespace) -> None:
    """Print a fix of each scan, and what became of them all."""
    import numpy as np

    from pipeline.online.inputs import NO_POSE, scans
    from pipeline.online.outputs import writer
    from pipeline.online.sensor import unlike
    from pipeline.online.site import Site
    from pipeline.online.tracking import Tracker

    if given.threads < 1:
        raise ConfigError(f"--threads {given.threads}: expected at least 1")
    site = Site.open(given.site, given.threads)
    about = site.about["sensor"]
    lift_m = about["lift_m"] if given.lift is None else given.lift
    told, tracker, before = Summary(), Tracker(site, given.promise) if given.track else None, NO_POSE
    with writer(given.kind or "text", given.out) as write:
        for source in given.inputs:
            for scan in scans(source, site.about["reader"], lift_m, given.topic):
                try:
                    points_m = scan.points()
                except (LogError, OSError) as error:
                    told.broken.append(f"{scan.name}: {error}")
                    continue
                if not told.fixes:
                    for line in unlike(points_m, about):
                        print(f"yearloc localize: unlike the scans that the site was learned with: {line}", file=sys.stderr)
                if tracker is None:
                    fix = site.localize(points_m, given.promise)
                else:
                    known = np.isfinite(before).all() and np.isfinite(scan.odom_T_scan).all()
                    fix = tracker.localize(points_m, np.linalg.inv(before) @ scan.odom_T_scan if known else None)
                    before = scan.odom_T_scan
                write(scan, fix)
                told.add(scan, fix)
    if not told.fixes:
        raise LogError(told.broken[0] if told.broken else f"{' '.join(given.inputs)}: no scan there")
    print(told.text(), file=sys.stderr)


class Summary:
    """What became of all scans."""

    def __init__(self) -> None:
        self.fixes: Counter[str] = Counter()
        self.broken: list[str] = []
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
        lines = [f"{sum(self.fixes.values())} scans: {counts}; median {median:.0f} ms, 95 % within {slow:.0f} ms"]
        if self._right:
            lines.append(f"of {sum(self._right.values())} accepted with a true pose {self._right[False]} are over 2 m or 5° off")
        if self.broken:
            lines.append(f"{len(self.broken)} could not be read, the first: {self.broken[0]}")
        return "\n".join(lines)
