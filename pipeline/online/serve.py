"""Localises over HTTP: POST /localize answers a scan with its fix as JSON (`yearloc serve`).

Scans are localised one after the other, and MOST_WAITING may wait. GET /healthz and GET /metrics,
for Prometheus, report the state of the server.
"""

import asyncio
import hmac
import os
from concurrent.futures import Future, ThreadPoolExecutor
from ipaddress import ip_address
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse, PlainTextResponse, Response
from numpy.typing import NDArray
from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest
from prometheus_client.multiprocess import MultiProcessCollector
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect

from pipeline.core.errors import ConfigError, InputError, LogError, YearlocError
from pipeline.core.frames import Poses, transformed
from pipeline.online.bodies import CDR, FLOATS, LARGEST_BYTES, points
from pipeline.online.inputs import NO_POSE, Scan, parse_prior, placement
from pipeline.online.outputs import record
from pipeline.online.site import Fix, Site
from pipeline.online.site_json import notes
from pipeline.posing.prior import Prior
from pipeline.readers.log import raised

FORM = "application/x-www-form-urlencoded"
"""The content type that curl sends by default; the body is read as FLOATS."""
BODY_S = 10.0
"""A body that takes longer to arrive is refused."""
ANSWER_S = 30.0
"""A request that takes longer to answer gets an error."""
MOST_WAITING = 16
"""How many scans may wait in one worker; further scans are refused."""
GONE_STATUS = 499
GONE_REASON = "the client is gone"
"""The status, for the metrics, and the reason of a request whose client has disconnected."""
OPTIONS = ("target_precision", "strict", "lift_m", "body_T_lidar", "prior", "prior_sigma")
"""The options of a request to localise a scan."""
TARGET_PRECISION = 0.99
"""The wanted precision of a request that names none."""
WAYS = "lift_m={:.2f}", "body_T_lidar={}"
"""The options of a request to raise its points, and to give the lidar's pose (sensor.py)."""
SITE = "YEARLOC_SITE"
TOKEN = "YEARLOC_TOKEN"
"""Environment variables: the path of the site, and the bearer token of requests."""


class RequestError(Exception):
    """A request is answered with this HTTP status and the reason in a line, without a fix."""

    def __init__(self, status: int, reason: str, retry_after_s: int | None = None) -> None:
        """`retry_after_s` tells the client when it may try again."""
        super().__init__(reason)
        self.status = status
        self.headers = None if retry_after_s is None else {"Retry-After": str(retry_after_s)}


def check_reach(host: str, token: str) -> None:
    """Raise ConfigError if other machines can reach the address `host` but `token` is empty."""
    try:
        local = host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        local = False
    if not local and not token:
        raise ConfigError(
            f"--host {host}: reachable from other machines, so a token is needed: set {TOKEN}"
        )


def serving(path: Path, token: str = "") -> FastAPI:
    """The HTTP application of the site at `path`; requests need the token, unless it is empty.

    Raises ArtifactError if there is no site.
    """
    site = Site.open(path)
    localizing = ThreadPoolExecutor(1)  # one scan after the other
    waiting = asyncio.Semaphore(MOST_WAITING)
    registry = CollectorRegistry()
    has_workers = bool(os.environ.get("PROMETHEUS_MULTIPROC_DIR"))
    answers = Counter("yearloc_fixes", "Fixes by verdict", ["verdict"], registry=registry)
    refusals = Counter(
        "yearloc_refused", "Requests without a fix by status", ["status"], registry=registry
    )
    durations = Histogram(
        "yearloc_fix_seconds",
        "From points to fix",
        registry=registry,
        buckets=(0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5),
    )
    sensor_warnings: list[str] | None = None  # for the first scan that has a pose
    last_ms = 1e3
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)

    @app.exception_handler(RequestError)
    async def refuse(_: Request, error: RequestError) -> Response:
        refusals.labels(error.status).inc()
        return JSONResponse({"error": str(error)}, error.status, error.headers)

    @app.exception_handler(HTTPException)
    async def unknown(_: Request, error: HTTPException) -> Response:
        refusals.labels(error.status_code).inc()
        return JSONResponse(
            {"error": f"{error.detail}; POST /localize, GET /healthz, GET /metrics"},
            error.status_code,
        )

    @app.post("/localize")
    async def localize(request: Request) -> Response:
        nonlocal sensor_warnings, last_ms
        _authorise(request, token)
        _check_options(request)
        wanted_precision = _wanted_precision(request)
        target_precision = _kept_precision(request, site, wanted_precision)
        body_T_lidar = _placement(request, site)
        prior = _prior(request)
        if waiting.locked():
            raise RequestError(
                503,
                f"{MOST_WAITING} scans wait already; try again later",
                ceil(MOST_WAITING * last_ms / 1e3),
            )
        async with waiting:
            body = await _body(request)
            stamp_ns, points_m = _points(body, request.headers.get("content-type", FLOATS))
            points_m = transformed(body_T_lidar, points_m)
            future = localizing.submit(site.localize, points_m, target_precision, prior)
            try:
                fix = await _while_connected(request, future)
            except YearlocError as error:
                raise RequestError(400, str(error)) from None
        last_ms = fix.ms
        if sensor_warnings is None and fix.verdict != "no pose":
            sensor_warnings = site.unlike(points_m, body_T_lidar, WAYS)
        answers.labels(fix.verdict).inc()
        durations.observe(fix.ms / 1e3)
        scan = Scan("", stamp_ns, lambda: points_m, NO_POSE, NO_POSE)
        return JSONResponse(record(scan, fix) | {"notice": site.kept_words(wanted_precision)})

    @app.get("/healthz")
    async def healthz() -> dict[str, Any]:
        return {
            "site": site.name,
            "notes": [*notes(site.description)],
            "target_precisions": [*site.target_precisions],
            "notice": site.kept_words(TARGET_PRECISION),
            "waiting": MOST_WAITING - waiting._value,
            "unlike": sensor_warnings,
        }

    @app.get("/metrics")
    async def metrics(request: Request) -> Response:
        _authorise(request, token)
        collected = registry
        if has_workers:
            collected = CollectorRegistry()
            MultiProcessCollector(collected)  # type: ignore[no-untyped-call]
        text = generate_latest(collected)
        return PlainTextResponse(text, media_type="text/plain; version=0.0.4")

    return app


def from_environment() -> FastAPI:
    """The application of the environment's site and token, which each worker builds."""
    return serving(Path(os.environ[SITE]), os.environ.get(TOKEN, ""))


def _authorise(request: Request, token: str) -> None:
    """Raise RequestError for a request without the token."""
    authorization = request.headers.get("authorization", "").encode("utf-8", "replace")
    if token and not hmac.compare_digest(authorization, f"Bearer {token}".encode()):
        raise RequestError(401, "expected the header Authorization: Bearer TOKEN")


def _check_options(request: Request) -> None:
    """Raise RequestError for an unknown option."""
    unknown_options = {*request.query_params} - {*OPTIONS}
    if unknown_options:
        raise RequestError(
            400,
            f"?{min(unknown_options):.30}: no such option; expected {', '.join(OPTIONS[:-1])} or "
            f"{OPTIONS[-1]}",
        )


def _wanted_precision(request: Request) -> float | None:
    """The target precision that a request wants; None accepts nothing."""
    if request.query_params.get("target_precision") == "none":
        return None
    return _number(request, "target_precision", TARGET_PRECISION)


def _kept_precision(request: Request, site: Site, wanted: float | None) -> float | None:
    """The precision that the site keeps if this one is wanted; RequestError if it is no share.

    With ?strict=true also RequestError if the site has no threshold for the wanted one.
    """
    strict = request.query_params.get("strict", "false")
    if strict not in ("true", "false"):
        raise RequestError(400, f"strict={strict!r:.30}: expected true or false")
    try:
        return site.kept_precision(wanted, strict == "true")
    except InputError as error:
        raise RequestError(400, str(error)) from None


def _placement(request: Request, site: Site) -> Poses:
    """The pose (4, 4) of the lidar by a request's options; RequestError if it is malformed."""
    lift_m = _number(request, "lift_m", site.description.sensor.lift_m)
    if (text := request.query_params.get("body_T_lidar")) is None:
        return raised(lift_m)
    if "lift_m" in request.query_params:
        raise RequestError(400, "lift_m: not with body_T_lidar, whose z raises the points")
    try:
        return placement("body_T_lidar", text)
    except ConfigError as error:
        raise RequestError(400, str(error)) from None


def _prior(request: Request) -> Prior | None:
    """The prior of a request's options; None without it, RequestError if it is malformed."""
    prior, sigma = (request.query_params.get(name) for name in ("prior", "prior_sigma"))
    try:
        return parse_prior("prior", prior, "prior_sigma", sigma)
    except InputError as error:
        raise RequestError(400, str(error)) from None


def _number(request: Request, name: str, default: float) -> float:
    """The number of an option; RequestError if it is not a number below 1000."""
    text = request.query_params.get(name)
    try:
        number = default if text is None else float(text)
    except ValueError:
        number = float("nan")
    if not abs(number) < 1e3:
        raise RequestError(400, f"{name}={text!r:.30}: expected a number")
    return number


async def _body(request: Request) -> bytes:
    """Read the body of a request; raises RequestError if it is too long or too slow."""

    async def read() -> bytes:
        parts = bytearray()
        async for part in request.stream():
            parts += part
            if len(parts) > LARGEST_BYTES:
                raise RequestError(413, f"a scan of more than {LARGEST_BYTES:,} bytes")
        return bytes(parts)

    try:
        return await asyncio.wait_for(read(), BODY_S)
    except TimeoutError:
        raise RequestError(408, f"the body took longer than {BODY_S:g} s") from None
    except ClientDisconnect:
        raise RequestError(GONE_STATUS, GONE_REASON) from None


async def _while_connected(request: Request, future: "Future[Fix]") -> Fix:
    """Wait for a fix while its client is connected, at most ANSWER_S.

    If the client disconnects, its fix leaves the queue. Raises RequestError without a fix.
    """
    disconnect = asyncio.ensure_future(request.receive())
    answer = asyncio.wrap_future(future)
    try:
        await asyncio.wait(
            (disconnect, answer), timeout=ANSWER_S, return_when=asyncio.FIRST_COMPLETED
        )
        if answer.done():
            return answer.result()
        if disconnect.done():
            raise RequestError(GONE_STATUS, GONE_REASON)
        raise RequestError(504, f"no fix within {ANSWER_S:g} s")
    finally:
        disconnect.cancel()
        answer.cancel()


def _points(body: bytes, kind: str) -> tuple[int | None, NDArray[np.float64]]:
    """Decode the stamp and points (n, 3) of a body; raises RequestError if it is no scan."""
    kind = kind.partition(";")[0].strip()
    if kind not in (CDR, FLOATS, FORM, ""):
        raise RequestError(
            415,
            f"a body of {kind[:60]!r}: expected {FLOATS} (float32 x, y, z) or {CDR} (PointCloud2)",
        )
    try:
        return points(body, kind)
    except LogError as error:
        raise RequestError(400, str(error)) from None
