"""Localises over Zenoh: scans come in on KEY/points, their fixes go out as JSON on KEY/fix."""

import json
from collections.abc import Callable

import zenoh

from pipeline.core.errors import ConfigError, YearlocError
from pipeline.core.frames import Poses, transformed
from pipeline.online.bodies import CDR, FLOATS, points
from pipeline.online.inputs import NO_POSE, Scan
from pipeline.online.outputs import person, record
from pipeline.online.site import Site
from pipeline.online.tracking import Tracker
from pipeline.readers.log import raised

CONNECT_MS = 5000
"""How long a peer or router may take to answer, in milliseconds."""


def connected(endpoint: str, how: str = "connect") -> zenoh.Session:
    """Open a session with one peer or router, at an endpoint such as tcp/127.0.0.1:7447.

    No other peer on the network is looked for. `how` is `connect`, or `listen` to wait for a peer.
    Raises ConfigError if nobody answers.
    """
    config = zenoh.Config()
    if "/" not in endpoint:
        raise ConfigError(f"--zenoh {endpoint}: expected an endpoint such as tcp/127.0.0.1:7447")
    try:
        config.insert_json5(f"{how}/endpoints", json.dumps([endpoint]))
        config.insert_json5("connect/timeout_ms", str(CONNECT_MS))
        config.insert_json5("scouting/multicast/enabled", "false")
        if how == "connect":
            config.insert_json5("mode", '"client"')
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise ConfigError(f"--zenoh {endpoint}: {str(error).partition(' at /')[0]}") from None


def run(
    site: Site,
    session: zenoh.Session,
    key: str,
    target_precision: float | None,
    ready: Callable[[], None],
    tell: Callable[[str], None],
    body_T_lidar: Poses | None = None,
) -> None:
    """Track the robot by the scans that come in, until the session is closed.

    `ready` is called before the first scan, `tell` with a line for each scan. While a scan is
    localised, only the newest scan waits; older scans are dropped. Points are transformed to the
    robot's frame by `body_T_lidar` (4, 4); by default they are raised like the training scans.
    """
    if body_T_lidar is None:
        body_T_lidar = raised(site.description.sensor.lift_m)
    tracker = Tracker(site, target_precision)
    publisher = session.declare_publisher(f"{key}/fix", encoding=zenoh.Encoding.APPLICATION_JSON)
    scans = session.declare_subscriber(f"{key}/points", zenoh.handlers.RingChannel(1))
    ready()
    for number, sample in enumerate(scans):
        kind = CDR if str(sample.encoding) == CDR else FLOATS
        try:
            stamp_ns, points_m = points(sample.payload.to_bytes(), kind)
            points_m = transformed(body_T_lidar, points_m)
            fix = tracker.localize(points_m, None, stamp_ns)
        except YearlocError as error:
            tell(str(error))
            publisher.put(json.dumps({"error": str(error)}))
            continue
        scan = Scan(
            str(number),
            stamp_ns,
            lambda points_m=points_m: points_m,  # type: ignore[misc]
            NO_POSE,
            NO_POSE,
        )
        tell(person(scan, fix))
        publisher.put(json.dumps(record(scan, fix), allow_nan=False))
