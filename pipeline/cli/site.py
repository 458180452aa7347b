"""`yearloc pack`, `export`, `serve`, `watch`: what is done with a site file but for localising
scans."""

import argparse
import os
import socket
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pipeline.cli.kernels import tell_cold
from pipeline.cli.localize import KINDS, Summary, add_lidar, lidar_of, share_or_none
from pipeline.cli.outputs import check_file
from pipeline.cli.progress import Lines
from pipeline.cli.project import conf_folder, read_studies
from pipeline.errors import ConfigError, LogError


def add_commands(commands: Any) -> None:
    """Add these commands to the parser."""
    promised: Any = {"type": share_or_none, "default": 0.99, "metavar": "SHARE"}
    pack = commands.add_parser("pack", help="one file of all that it takes to localise in a place")
    pack.add_argument(
        "name",
        metavar="STUDY/GRID/METHOD",
        help="such as campus/10m/sci_ring; a variant is METHOD-VARIANT",
    )
    pack.add_argument("-o", "--out", type=Path, required=True, metavar="FILE")
    find = commands.add_parser(
        "localize", help="where scans were taken, by a site file, and whether to believe it"
    )
    find.add_argument("site", type=Path, metavar="SITE")
    find.add_argument(
        "inputs",
        nargs="+",
        metavar="INPUT",
        help="scans (.bin .npy .pcd), folders, logs, bags; - reads one scan",
    )
    kinds = find.add_mutually_exclusive_group()
    for kind, what in KINDS.items():
        kinds.add_argument(f"--{kind}", action="store_const", const=kind, dest="kind", help=what)
    find.add_argument("-o", "--out", type=Path, metavar="FILE", help="instead of standard output")
    find.add_argument(
        "--promise",
        help="of right ones among the accepted (0.99); none accepts nothing",
        **promised,
    )
    place = find.add_mutually_exclusive_group()
    place.add_argument(
        "--lift",
        type=float,
        metavar="M",
        help="raises the points, so that the ground is at 0; of logs as trained",
    )
    add_lidar(place)
    find.add_argument("--topic", help="of a bag, where it has several clouds")
    find.add_argument(
        "--odometry", metavar="TOPIC", help="of a bag, for --track: poses, or tf:PARENT>CHILD"
    )
    find.add_argument(
        "--track",
        action="store_true",
        help="scans are one path: follow it, by odometry where the log has some",
    )
    find.add_argument(
        "--follow",
        action="store_true",
        help="INPUT is an .mcap still being recorded; what waits too long is dropped",
    )
    find.add_argument(
        "--idle",
        type=float,
        default=10.0,
        metavar="S",
        help="of --follow: ends after so long without a byte (10)",
    )
    find.add_argument("--threads", type=int, default=1, help="for the network (1)")
    commands.add_parser(
        "kernels",
        help="compile, once per machine, what a first scan would wait for; `make install` does it",
    )
    onnx = commands.add_parser(
        "export", help="a site's network as ONNX; or a site that answers through it, without torch"
    )
    onnx.add_argument("site", type=Path, metavar="SITE")
    onnx.add_argument("-o", "--out", type=Path, required=True, metavar="FILE.onnx|FILE.site")
    serve = commands.add_parser(
        "serve", help="answer over HTTP: POST /localize, /healthz, /metrics"
    )
    serve.add_argument("site", type=Path, metavar="SITE")
    serve.add_argument("--port", type=int, default=8765)
    serve.add_argument(
        "--host", default="127.0.0.1", help="another one needs a token in YEARLOC_TOKEN (127.0.0.1)"
    )
    serve.add_argument("--workers", type=int, default=1, help="processes, one a core (1)")
    serve.add_argument(
        "--zenoh",
        metavar="ENDPOINT",
        help="instead of HTTP: a peer or router, such as tcp/127.0.0.1:7447",
    )
    serve.add_argument(
        "--promise",
        help="of --zenoh: what accepted fixes keep (0.99); over HTTP each request says it",
        **promised,
    )
    add_lidar(serve)
    serve.add_argument(
        "--key",
        default="yearloc",
        help="scans of KEY/points are followed, fixes go to KEY/fix (yearloc)",
    )
    watch = commands.add_parser(
        "watch",
        help="see scans snapped onto the map, with verdicts, in rerun's viewer or as a file",
    )
    watch.add_argument("site", type=Path, metavar="SITE")
    watch.add_argument("log", metavar="LOG", help="as of localize")
    watch.add_argument(
        "--save",
        type=Path,
        metavar="FILE.rrd",
        help="instead of opening the viewer; or FILE.mcap for Foxglove",
    )
    watch.add_argument("--promise", **promised)
    add_lidar(watch)
    watch.add_argument("--every", type=int, default=1, metavar="N", help="only every N-th scan (1)")
    bad = commands.add_parser("failures", help="a picture of each fix that the verdict got wrong")
    bad.add_argument(
        "of", metavar="SITE|STUDY/GRID/METHOD", help="a site, or a model of a study that has poses"
    )
    bad.add_argument(
        "log",
        nargs="?",
        metavar="LOG|DAY",
        help="of a site a log with true poses; of a study one test day (all)",
    )
    add_lidar(bad)
    bad.add_argument("--worst", type=int, default=20, metavar="N")
    bad.add_argument("-o", "--out", type=Path, default=Path("failures"), metavar="FOLDER")
    bad.add_argument("--promise", **promised)


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
    site = Site.open(given.site)
    told = Summary()
    site.check(given.promise)
    check_file(given.save)
    recorder: Any = (
        foxglove.Recording
        if given.save is not None and given.save.suffix == ".mcap"
        else rerun.Recording
    )
    tell_cold()
    how = (
        site.about["reader"],
        site.about["sensor"]["lift_m"],
        None,
        None,
        told.skipped,
        lidar_of(given),
    )
    with recorder(site, given.save, given.promise) as recording:
        for number, scan in enumerate(scans(given.log, *how)):
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
    if given.body_T_lidar and not given.zenoh:
        raise ConfigError(
            "--body-T-lidar: of --zenoh; over HTTP each request says it, ?body_T_lidar="
        )
    if given.zenoh:
        _bridge(given)
        return
    try:
        import uvicorn

        from pipeline.online import serve as online
    except ImportError as error:
        raise ConfigError(f"{error.name}: not installed; `pip install 'yearloc[serve]'`") from None
    token = os.environ.get(online.TOKEN, "")
    application = "pipeline.online.serve:from_environment"
    online.check_reach(given.host, token)
    if given.workers < 1:
        raise ConfigError(f"--workers {given.workers}: expected at least 1")
    from pipeline.online.site_file import read

    limits = read(given.site).about["verdict"]
    kept = [
        promise
        for promise, reject_from in zip(limits["promises"], limits["promised"]["fix"], strict=True)
        if reject_from > 0
    ]
    try:
        with socket.create_server((given.host, given.port)):
            pass
    except (OSError, OverflowError) as error:
        raise ConfigError(
            f"--host {given.host} --port {given.port}: cannot be listened at ({error})"
        ) from None
    os.environ[online.SITE] = str(given.site.resolve())
    with TemporaryDirectory() as shared:
        if given.workers > 1:
            os.environ["PROMETHEUS_MULTIPROC_DIR"] = shared
        options = {
            "host": given.host,
            "port": given.port,
            "workers": given.workers,
            "log_level": "warning",
        }
        promises = f"promises {', '.join(map(str, kept)) or 'nothing'}"
        way = (
            f"serving {given.site} at http://{given.host}:{given.port}/localize, {promises}; "
            "Ctrl-C stops it"
        )
        print(way, file=sys.stderr, flush=True)
        tell_cold()
        uvicorn.run(
            application,
            factory=True,
            timeout_keep_alive=10,
            limit_concurrency=256,
            server_header=False,
            **options,
        )


def _bridge(given: argparse.Namespace) -> None:
    """Serve over Zenoh."""
    from pipeline.online.site import Site

    try:
        from pipeline.online import bridge
    except ImportError as error:
        raise ConfigError(f"{error.name}: not installed; `pip install 'yearloc[zenoh]'`") from None
    site = Site.open(given.site)
    tell_cold()
    with bridge.connected(given.zenoh) as session:
        way = (
            f"{given.site}: {given.key}/points → {given.key}/fix at {given.zenoh}; Ctrl-C stops it"
        )
        placed = lidar_of(given)
        bridge.run(
            site,
            session,
            given.key,
            given.promise,
            lambda: print(way, file=sys.stderr, flush=True),
            print,
            placed,
        )


def kernels(given: argparse.Namespace) -> None:
    """Compile them."""
    from pipeline.online.first import compile_kernels

    print("compiling what a first scan takes, once per machine", file=sys.stderr, flush=True)
    print(f"compiled in {compile_kernels():.0f} s")


def export(given: argparse.Namespace) -> None:
    """Write an ONNX file, or a site with one."""
    from pipeline.online.export import export

    check_file(given.out)
    print(export(given.site, given.out))


def pack(given: argparse.Namespace) -> None:
    """Write a site file."""
    from pipeline.online.pack import Packing

    check_file(given.out)
    print(
        Packing(conf_folder(), Path("artifacts"), read_studies()).pack(
            given.name, given.out, Lines()
        )
    )
