"""The commands on site files: `yearloc pack`, `export`, `serve`, `watch` and `kernels`.

The parser of `localize`, whose command is in pipeline/cli/localize.py, is set up here too.
"""

import argparse
import os
import socket
import sys
from itertools import islice
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
    for kind, help_text in KINDS.items():
        kinds.add_argument(
            f"--{kind}", action="store_const", const=kind, dest="kind", help=help_text
        )
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


def watch(args: argparse.Namespace) -> None:
    """Localise a log and record its scans and fixes for rerun's viewer or Foxglove."""
    from pipeline.online import foxglove
    from pipeline.online import watch as rerun
    from pipeline.online.inputs import scans
    from pipeline.online.localized import localized
    from pipeline.online.site import Site

    if args.every < 1:
        raise ConfigError(f"--every {args.every}: expected at least 1")
    if args.save is not None and args.save.suffix not in (".rrd", ".mcap"):
        raise ConfigError(f"--save {args.save}: expected FILE.rrd or FILE.mcap")
    site = Site.open(args.site)
    summary = Summary()
    site.check(args.promise)
    check_file(args.save)
    recorder: Any = (
        foxglove.Recording
        if args.save is not None and args.save.suffix == ".mcap"
        else rerun.Recording
    )
    tell_cold()
    scan_options = (
        site.about["reader"],
        site.about["sensor"]["lift_m"],
        None,
        None,
        summary.skipped,
        lidar_of(args),
    )
    with recorder(site, args.save, args.promise) as recording:
        kept_scans = islice(scans(args.log, *scan_options), 0, None, args.every)
        fixes = localized(kept_scans, site, args.promise, summary.broken)
        for number, (scan, points_m, fix) in enumerate(fixes):
            recording.add(number * args.every, scan, points_m, fix)
            summary.add(scan, fix)
    if not summary.fixes:
        raise LogError(summary.broken[0] if summary.broken else f"{args.log}: no scan there")
    print(summary.text(), file=sys.stderr)


def serve(args: argparse.Namespace) -> None:
    """Answer requests over HTTP or Zenoh until interrupted."""
    if args.body_T_lidar and not args.zenoh:
        raise ConfigError(
            "--body-T-lidar: of --zenoh; over HTTP each request says it, ?body_T_lidar="
        )
    if args.zenoh:
        _bridge(args)
        return
    try:
        import uvicorn

        from pipeline.online import serve as online
    except ImportError as error:
        raise ConfigError(f"{error.name}: not installed; `pip install 'yearloc[serve]'`") from None
    token = os.environ.get(online.TOKEN, "")
    application = "pipeline.online.serve:from_environment"
    online.check_reach(args.host, token)
    if args.workers < 1:
        raise ConfigError(f"--workers {args.workers}: expected at least 1")
    from pipeline.online.site_file import read

    limits = read(args.site).about["verdict"]
    kept_promises = [
        promise
        for promise, reject_from in zip(limits["promises"], limits["promised"]["fix"], strict=True)
        if reject_from > 0
    ]
    try:
        with socket.create_server((args.host, args.port)):
            pass
    except (OSError, OverflowError) as error:
        raise ConfigError(
            f"--host {args.host} --port {args.port}: cannot be listened at ({error})"
        ) from None
    os.environ[online.SITE] = str(args.site.resolve())
    with TemporaryDirectory() as shared:
        if args.workers > 1:
            os.environ["PROMETHEUS_MULTIPROC_DIR"] = shared
        options = {
            "host": args.host,
            "port": args.port,
            "workers": args.workers,
            "log_level": "warning",
        }
        promises = f"promises {', '.join(map(str, kept_promises)) or 'nothing'}"
        ready_line = (
            f"serving {args.site} at http://{args.host}:{args.port}/localize, {promises}; "
            "Ctrl-C stops it"
        )
        print(ready_line, file=sys.stderr, flush=True)
        tell_cold()
        uvicorn.run(
            application,
            factory=True,
            timeout_keep_alive=10,
            limit_concurrency=256,
            server_header=False,
            **options,
        )


def _bridge(args: argparse.Namespace) -> None:
    """Answer scans over Zenoh."""
    from pipeline.online.site import Site

    try:
        from pipeline.online import bridge
    except ImportError as error:
        raise ConfigError(f"{error.name}: not installed; `pip install 'yearloc[zenoh]'`") from None
    site = Site.open(args.site)
    tell_cold()
    with bridge.connected(args.zenoh) as session:
        ready_line = (
            f"{args.site}: {args.key}/points → {args.key}/fix at {args.zenoh}; Ctrl-C stops it"
        )
        body_T_lidar = lidar_of(args)
        bridge.run(
            site,
            session,
            args.key,
            args.promise,
            lambda: print(ready_line, file=sys.stderr, flush=True),
            print,
            body_T_lidar,
        )


def kernels(args: argparse.Namespace) -> None:
    """Compile the kernels that a first scan would wait for."""
    from pipeline.online.first import compile_kernels

    print("compiling what a first scan takes, once per machine", file=sys.stderr, flush=True)
    print(f"compiled in {compile_kernels():.0f} s")


def export(args: argparse.Namespace) -> None:
    """Write an ONNX file, or a site with one."""
    from pipeline.online.export import export

    check_file(args.out)
    print(export(args.site, args.out))


def pack(args: argparse.Namespace) -> None:
    """Write a site file."""
    from pipeline.online.pack import Packing
    from pipeline.studies.layout import Layout

    check_file(args.out)
    print(Packing(conf_folder(), Layout(), read_studies()).pack(args.name, args.out, Lines()))
