"""`yearloc serve` localises scans over the network: a program sends points and gets a pose back.

It opens a site (one file with all that it takes to localise in a place) and serves it over HTTP, or
over Zenoh, a protocol for robots.
"""

import os
import socket
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.options import BodyTLidar, SitePath, Strict, lidar_of, share_or_none
from pipeline.cli.scan_options import told_kept
from pipeline.core.errors import ConfigError, needed

Port = Annotated[int, typer.Option(metavar="PORT", help="The port that HTTP listens at")]
Host = Annotated[
    str,
    typer.Option(
        metavar="HOST",
        help="The address that HTTP listens at; an address that other machines reach needs a "
        "token in YEARLOC_TOKEN",
    ),
]
Workers = Annotated[
    int, typer.Option(metavar="N", help="Processes that answer HTTP requests, such as one per core")
]
ZenohEndpoint = Annotated[
    str | None,
    typer.Option(
        metavar="ENDPOINT",
        help="Serve over Zenoh instead of HTTP, by this peer or router, such as tcp/127.0.0.1:7447",
    ),
]
ZenohTargetPrecision = Annotated[
    float | None,
    typer.Option(
        metavar="P",
        parser=share_or_none,
        help="With --zenoh: accept only poses that are right with at least this probability; over "
        "HTTP each request sets it",
    ),
]
ZenohKey = Annotated[
    str,
    typer.Option(
        metavar="KEY", help="With --zenoh: read scans from KEY/points, put fixes on KEY/fix"
    ),
]


def serve(
    path: SitePath,
    port: Port = 8765,
    host: Host = "127.0.0.1",
    workers: Workers = 1,
    zenoh: ZenohEndpoint = None,
    target_precision: ZenohTargetPrecision = 0.99,
    strict: Strict = False,
    body_T_lidar: BodyTLidar = None,
    key: ZenohKey = "yearloc",
) -> None:
    """Localise scans over HTTP (POST /localize, GET /healthz, /metrics) or over Zenoh."""
    if zenoh:
        _serve_zenoh(path, zenoh, key, target_precision, body_T_lidar, strict)
        return
    if strict:
        raise ConfigError("--strict: only with --zenoh; over HTTP each request gives ?strict=true")
    if body_T_lidar:
        raise ConfigError(
            "--body-T-lidar: only with --zenoh; over HTTP each request gives it as ?body_T_lidar="
        )
    _serve_http(path, host, port, workers)


def _serve_http(path: Path, host: str, port: int, workers: int) -> None:
    """Answer HTTP requests until interrupted.

    Raises ConfigError if the port cannot be listened at, or if other machines could reach it
    without a token.
    """
    with needed("serve"):
        import uvicorn

        from pipeline.online import serve as online
    from pipeline.online.site_file import read_either

    online.check_reach(host, os.environ.get(online.TOKEN, ""))
    if workers < 1:
        raise ConfigError(f"--workers {workers}: expected at least 1")
    verdict = read_either(path).description.verdict
    _check_port(host, port)
    # Each worker is a process of its own, which reads the site's path from the environment.
    os.environ[online.SITE] = str(path.resolve())
    with TemporaryDirectory() as metrics_folder:
        if workers > 1:
            os.environ["PROMETHEUS_MULTIPROC_DIR"] = metrics_folder
        ready_line = (
            f"serving {path} at http://{host}:{port}/localize, target precisions "
            f"{', '.join(map(str, verdict.reachable)) or 'none'}; Ctrl-C stops it"
        )
        print(ready_line, file=sys.stderr, flush=True)
        if words := verdict.kept_words(online.TARGET_PRECISION):
            print(f"{words} (?strict=true refuses instead)", file=sys.stderr, flush=True)
        tell_cold()
        uvicorn.run(
            "pipeline.online.serve:from_environment",
            factory=True,
            host=host,
            port=port,
            workers=workers,
            log_level="warning",
            timeout_keep_alive=10,  # seconds that an idle connection stays open
            limit_concurrency=256,  # requests at a time; further ones are refused
            server_header=False,
        )


def _check_port(host: str, port: int) -> None:
    """Raise ConfigError if no server can listen there, before uvicorn prints its own error."""
    try:
        with socket.create_server((host, port)):
            pass
    except (OSError, OverflowError) as error:
        raise ConfigError(f"--host {host} --port {port}: cannot be listened at ({error})") from None


def _serve_zenoh(
    path: Path,
    endpoint: str,
    key: str,
    target_precision: float | None,
    body_T_lidar: str | None,
    strict: bool,
) -> None:
    """Answer each scan on KEY/points by a fix on KEY/fix until interrupted.

    Raises ConfigError if zenoh is not installed.
    """
    from pipeline.online.site import Site

    with needed("zenoh"):
        from pipeline.online import bridge
    site = Site.open(path, level=False)
    target_precision = told_kept(site, target_precision, strict)
    tell_cold()
    ready_line = f"{path}: {key}/points → {key}/fix at {endpoint}; Ctrl-C stops it"

    def print_ready() -> None:
        print(ready_line, file=sys.stderr, flush=True)

    with bridge.connected(endpoint) as session:
        bridge.run(
            site,
            session,
            key,
            target_precision,
            ready=print_ready,
            tell=print,
            body_T_lidar=lidar_of(body_T_lidar),
        )
