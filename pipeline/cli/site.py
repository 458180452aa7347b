"""The commands on site files: `yearloc pack`, `export`, `serve`, `watch` and `kernels`."""

import os
import socket
import sys
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.localize import Summary
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
    share_or_none,
)
from pipeline.cli.outputs import check_file
from pipeline.cli.progress import Bar
from pipeline.cli.project import conf_folder, read_studies
from pipeline.core.errors import ConfigError, LogError


def watch(
    path: SitePath,
    log: Annotated[str, typer.Argument(metavar="LOG", help="as of localize")],
    save: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.rrd", help="instead of opening the viewer; or FILE.mcap for Foxglove"
        ),
    ] = None,
    promise: Promise = 0.99,
    body_T_lidar: BodyTLidar = None,
    topic: Topic = None,
    odometry: Odometry = None,
    track: Track = False,
    follow: Follow = False,
    idle: Idle = 10.0,
    every: Annotated[int, typer.Option(metavar="N", help="only every N-th scan")] = 1,
) -> None:
    """See a drive on the map, from behind the robot, with verdicts: rerun's viewer, or a file."""
    from pipeline.online import foxglove
    from pipeline.online import watch as rerun
    from pipeline.online.follow import Following
    from pipeline.online.inputs import scans
    from pipeline.online.localized import localized, tracker_of
    from pipeline.online.site import Site

    if every < 1:
        raise ConfigError(f"--every {every}: expected at least 1")
    if save is not None and save.suffix not in (".rrd", ".mcap"):
        raise ConfigError(f"--save {save}: expected FILE.rrd or FILE.mcap")
    site = Site.open(path)
    if odometry and not track and not site.is_level:
        raise ConfigError(f"--odometry {odometry}: needs --track")
    if site.is_level and follow:
        raise ConfigError("--follow: follows 3-D scans, and the site is level")
    summary = Summary(site.is_level)
    site.check(promise)
    check_file(save)
    recorder: Any = (
        foxglove.Recording if save is not None and save.suffix == ".mcap" else rerun.Recording
    )
    tell_cold()
    lift_m = site.description.sensor.lift_m
    placement = lidar_of(body_T_lidar)
    if follow:
        all_scans = Following(Path(log), topic, lift_m, idle, odometry, placement).scans()
    else:
        scan_options = (lift_m, topic, odometry, summary.skipped, placement, site.is_level)
        all_scans = scans(log, site.description.reader, *scan_options)
    localizer = tracker_of(site, promise, track) or site
    with recorder(site, save, promise) as recording:
        fixes = localized(islice(all_scans, 0, None, every), localizer, promise, summary.broken)
        for number, (scan, points_m, fix) in enumerate(fixes):
            recording.add(number * every, scan, points_m, fix)
            summary.add(scan, fix)
    if not summary.fixes:
        raise LogError(summary.broken[0] if summary.broken else f"{log}: no scan there")
    print(summary.text(), file=sys.stderr)


def serve(
    path: SitePath,
    port: Annotated[int, typer.Option(metavar="PORT", help="of HTTP")] = 8765,
    host: Annotated[
        str, typer.Option(metavar="HOST", help="another one needs a token in YEARLOC_TOKEN")
    ] = "127.0.0.1",
    workers: Annotated[int, typer.Option(metavar="N", help="processes, one a core")] = 1,
    zenoh: Annotated[
        str | None,
        typer.Option(
            metavar="ENDPOINT",
            help="instead of HTTP: a peer or router, such as tcp/127.0.0.1:7447",
        ),
    ] = None,
    promise: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            parser=share_or_none,
            help="of --zenoh: what accepted fixes keep; over HTTP each request says it",
        ),
    ] = 0.99,
    body_T_lidar: BodyTLidar = None,
    key: Annotated[
        str,
        typer.Option(metavar="KEY", help="scans of KEY/points are followed, fixes go to KEY/fix"),
    ] = "yearloc",
) -> None:
    """Answer over HTTP: POST /localize, /healthz, /metrics."""
    if body_T_lidar and not zenoh:
        raise ConfigError(
            "--body-T-lidar: of --zenoh; over HTTP each request says it, ?body_T_lidar="
        )
    if zenoh:
        _bridge(path, zenoh, key, promise, body_T_lidar)
        return
    try:
        import uvicorn

        from pipeline.online import serve as online
    except ImportError as error:
        raise ConfigError(f"{error.name}: not installed; `pip install 'yearloc[serve]'`") from None
    token = os.environ.get(online.TOKEN, "")
    application = "pipeline.online.serve:from_environment"
    online.check_reach(host, token)
    if workers < 1:
        raise ConfigError(f"--workers {workers}: expected at least 1")
    from pipeline.online.site_file import read_either

    kept_promises = read_either(path).description.verdict.kept
    try:
        with socket.create_server((host, port)):
            pass
    except (OSError, OverflowError) as error:
        raise ConfigError(f"--host {host} --port {port}: cannot be listened at ({error})") from None
    os.environ[online.SITE] = str(path.resolve())
    with TemporaryDirectory() as shared:
        if workers > 1:
            os.environ["PROMETHEUS_MULTIPROC_DIR"] = shared
        promises = f"promises {', '.join(map(str, kept_promises)) or 'nothing'}"
        ready_line = f"serving {path} at http://{host}:{port}/localize, {promises}; Ctrl-C stops it"
        print(ready_line, file=sys.stderr, flush=True)
        tell_cold()
        uvicorn.run(
            application,
            factory=True,
            host=host,
            port=port,
            workers=workers,
            log_level="warning",
            timeout_keep_alive=10,
            limit_concurrency=256,
            server_header=False,
        )


def _bridge(
    path: Path, endpoint: str, key: str, promise: float | None, body_T_lidar: str | None
) -> None:
    """Answer scans over Zenoh."""
    from pipeline.online.site import Site

    try:
        from pipeline.online import bridge
    except ImportError as error:
        raise ConfigError(f"{error.name}: not installed; `pip install 'yearloc[zenoh]'`") from None
    site = Site.open(path, level=False)
    tell_cold()
    with bridge.connected(endpoint) as session:
        ready_line = f"{path}: {key}/points → {key}/fix at {endpoint}; Ctrl-C stops it"
        placement = lidar_of(body_T_lidar)
        bridge.run(
            site,
            session,
            key,
            promise,
            lambda: print(ready_line, file=sys.stderr, flush=True),
            print,
            placement,
        )


def kernels() -> None:
    """Compile, once per machine, what a first scan would wait for; `make install` does it."""
    from pipeline.online.first import compile_kernels

    print("compiling what a first scan takes, once per machine", file=sys.stderr, flush=True)
    print(f"compiled in {compile_kernels():.0f} s")


def export(
    path: SitePath,
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE.onnx|FILE.site")],
    compact: Annotated[
        bool, typer.Option("--compact", help="weights in 8 bits: a quarter of the size")
    ] = False,
) -> None:
    """A site's network as ONNX; or a site that answers through it, without torch."""
    from pipeline.online import export as networks

    check_file(out)
    print(networks.export(path, out, compact))


def pack(
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE")],
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="[STUDY/GRID/METHOD]",
            help="such as campus/10m/sci_ring; a variant is METHOD-VARIANT",
        ),
    ] = None,
    level_map: Annotated[
        Path | None,
        typer.Option("--map", metavar="MAP.yaml", help="instead: a Nav2 map, for a level laser"),
    ] = None,
) -> None:
    """One file of all that it takes to localise in a place."""
    from pipeline.online.level_pack import pack_map
    from pipeline.online.pack import Packing, Trained
    from pipeline.studies.layout import Layout

    only_one({"STUDY/GRID/METHOD": name, "map": level_map})
    check_file(out)
    if level_map is not None:
        print(pack_map(level_map, out))
        return
    if name is None:
        raise ConfigError("pack: expected STUDY/GRID/METHOD, or --map MAP.yaml")
    trained = Trained.named(Layout(), read_studies(), name)
    print(Packing(conf_folder()).pack(trained, out, Bar()))
