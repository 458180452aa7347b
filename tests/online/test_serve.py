"""The server answers scans by fixes over HTTP, and all else by an error in a line."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import pytest
import requests

from pipeline.core.errors import ConfigError
from pipeline.formats.bag import BagWriter
from pipeline.formats.bag_file import BagFile
from pipeline.online.bodies import CDR, FLOATS, LARGEST_BYTES
from pipeline.online.serve import MOST_WAITING, check_reach
from tests.listening import addresses
from tests.online.made import scan
from tests.readers.bags import cloud
from tests.readers.damage import one_line

TOKEN = "secret"


@dataclass(frozen=True)
class Server:
    """A server of the site of three places, in a process of its own."""

    address: str
    process: psutil.Process

    def ask(
        self, body: bytes, kind: str = FLOATS, token: str = TOKEN, **params: object
    ) -> requests.Response:
        """Post a scan."""
        headers = {"Content-Type": kind, "Authorization": f"Bearer {token}"}
        return requests.post(
            f"{self.address}/localize", body, headers=headers, params=params, timeout=30
        )

    def get(self, path: str, token: str = TOKEN) -> requests.Response:
        return requests.get(
            f"{self.address}{path}", headers={"Authorization": f"Bearer {token}"}, timeout=10
        )


@pytest.fixture(scope="module")
def server(three_places: Path) -> Iterator[Server]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = [str(three_places), "--port", str(port)]
    words = [sys.executable, "-m", "pipeline.cli", "serve", *options]
    process = subprocess.Popen(
        words, env={**os.environ, "YEARLOC_TOKEN": TOKEN}, stderr=subprocess.DEVNULL
    )
    found = Server(f"http://127.0.0.1:{port}", psutil.Process(process.pid))
    for _ in range(150):
        try:
            if found.get("/healthz").ok:
                break
        except requests.ConnectionError:
            time.sleep(0.2)
    yield found
    process.terminate()
    process.wait(10)


def floats() -> bytes:
    """The body of a scan that is accepted."""
    return scan()[0].astype("<f4").tobytes()


def test_a_scan_of_floats_gets_its_fix(server: Server) -> None:
    found = server.ask(floats()).json()
    assert found["verdict"] == "accepted"
    assert server.get("/healthz").json()["unlike"] == []  # no warnings about the scan's sensor
    assert np.hypot(found["x"] - scan()[1][0, 3], found["y"] - scan()[1][1, 3]) < 0.1
    assert server.ask(floats(), target_precision="none").json()["verdict"] == "rejected"
    assert server.ask(b"").json()["verdict"] == "no pose"
    lowered = (scan()[0] - (0, 0, 1.3)).astype("<f4").tobytes()
    as_curl_sends_it = server.ask(lowered, "application/x-www-form-urlencoded", lift_m=1.3)
    assert as_curl_sends_it.json()["verdict"] == "accepted"
    upside_down = ((scan()[0] - (0, 0, 1.3)) * (1, -1, -1)).astype("<f4").tobytes()
    assert server.ask(upside_down, body_T_lidar="0,0,1.3,180,0,0").json()["verdict"] == "accepted"


def test_a_prior_is_taken_and_a_wrong_one_changes_no_answer(server: Server) -> None:
    x_m, y_m = scan()[1][:2, 3]
    for prior in (f"{x_m + 3},{y_m}", f"{x_m - 900},{y_m}"):
        found = server.ask(floats(), prior=prior, prior_sigma="3").json()
        assert found["verdict"] == "accepted"
        assert np.hypot(found["x"] - x_m, found["y"] - y_m) < 0.1


def test_a_cloud_as_ros_sends_it(server: Server, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "day", "mcap") as bag:
        cloud(bag, 1_700_000_000_500_000_000, "lidar", scan()[0])
    found = server.ask(BagFile(tmp_path / "day").first("/points") or b"", CDR).json()
    assert (found["verdict"], found["stamp"]) == ("accepted", 1_700_000_000.5)


@pytest.mark.parametrize(
    ("body", "kind", "status", "says"),
    [
        (b"12345", FLOATS, 400, "5 bytes are no whole number of float32 x, y, z"),
        (bytes(12), "text/html", 415, "expected application/octet-stream"),
        (b"", CDR, 400, "without a whole header"),
        (b"\0\1\0\0" + bytes(40), CDR, 400, "PointCloud2"),
        (bytes(LARGEST_BYTES + 12), FLOATS, 413, "a scan of more than"),
    ],
)
def test_a_body_that_is_no_scan_is_refused_in_a_line(
    server: Server, body: bytes, kind: str, status: int, says: str
) -> None:
    answer = server.ask(body, kind)
    assert answer.status_code == status
    assert says in answer.json()["error"]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"target_precision": "often"}, "target_precision='often': expected a number"),
        (
            {"target_precision": 50},
            "target_precision=50: expected a share above 0 and at most 1, such as 0.99",
        ),
        (
            {"target_precision": 0.999, "strict": "true"},
            "target_precision=0.999: this site has no threshold for it; it has thresholds for 0.95, 0.99",
        ),
        ({"strict": "yes"}, "strict='yes': expected true or false"),
        (
            {"lift": 1.3},
            "?lift: no such option; expected target_precision, strict, lift_m, body_T_lidar, prior or "
            "prior_sigma",
        ),
        ({"body_T_lidar": "0,0,x"}, "body_T_lidar=0,0,x: expected x,y,z,roll,pitch,yaw in metres"),
        ({"body_T_lidar": "0,0,1,0,0,0", "lift_m": 1}, "lift_m: not with body_T_lidar"),
        ({"prior": "1"}, "prior=1: expected x,y or x,y,heading in metres and degrees"),
        ({"prior": "1,nan"}, "prior: its pose has numbers that are not finite"),
        ({"prior": "1,2", "prior_sigma": "0"}, "prior: standard deviations of 0 m"),
        ({"prior_sigma": "3"}, "prior_sigma=3: needs prior"),
        ({"lift_m": "nan"}, "lift_m='nan': expected a number"),
    ],
)
def test_a_wrong_option_is_refused_in_a_line(
    server: Server, options: dict[str, object], says: str
) -> None:
    answer = server.ask(bytes(12), **options)
    assert answer.status_code == 400
    assert says in answer.json()["error"]


def test_asked_for_more_than_it_keeps_it_says_so_in_its_answer(server: Server) -> None:
    answer = server.ask(floats(), target_precision=0.999).json()
    assert (answer["verdict"], answer["target_precision"]) == ("accepted", 0.99)
    assert answer["notice"] == "this site can keep .99, not .999: accepted means .99"
    answer = server.ask(floats(), strict="true").json()
    assert (answer["target_precision"], answer["notice"]) == (0.99, None)


def test_by_default_it_is_reached_from_this_machine_only(server: Server) -> None:
    assert addresses(server.process) == {"127.0.0.1"}


def test_a_request_without_the_token_is_refused(server: Server) -> None:
    assert server.ask(floats(), token="guess").status_code == 401
    assert server.get("/metrics", token="ü").status_code == 401
    with one_line(ConfigError, "--host 0.0.0.0: reachable from other machines"):
        check_reach("0.0.0.0", "")
    check_reach("::1", "")
    check_reach("0.0.0.0", TOKEN)


def test_hostile_bodies_leave_it_running(server: Server) -> None:
    rng = np.random.default_rng(0)
    whole = bytearray(floats())
    for i in range(60):
        body = bytearray(rng.bytes(int(rng.integers(1, 5000))))
        if i % 2:
            body = whole[: int(rng.integers(1, 4000)) * 12]
        for at in rng.integers(len(body), size=20):
            body[at] = rng.integers(256)
        answer = server.ask(bytes(body), FLOATS if i % 4 < 2 else CDR)
        assert answer.status_code in (200, 400)
    assert server.ask(floats()).json()["verdict"] == "accepted"


def test_health_and_metrics(server: Server) -> None:
    assert server.get("/localize").json()["error"].startswith("Method Not Allowed; POST /localize")
    assert server.get("/healthz").json()["site"] == "three/10m/scan_context"
    assert server.get("/healthz").json()["target_precisions"] == [
        0.95,
        0.99,
    ]  # no threshold keeps .999
    server.ask(floats())
    text = server.get("/metrics").text
    assert 'yearloc_fixes_total{verdict="accepted"}' in text
    assert "yearloc_fix_seconds_bucket" in text


def test_scans_whose_client_has_left_are_dropped(server: Server) -> None:
    """A scan more than may wait is refused at once.

    Of the clients that leave, one may have been answered, and one scan may be under way.
    """
    server.ask(floats())
    host, port = server.address.removeprefix("http://").split(":")
    head = (
        f"POST /localize HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer "
        f"{TOKEN}\r\nContent-Type: {FLOATS}\r\n"
    )
    clients = [socket.create_connection((host, int(port))) for _ in range(MOST_WAITING)]
    for client in clients:
        client.sendall(f"{head}Content-Length: {len(floats())}\r\n\r\n".encode() + floats())
    while server.get("/healthz").json()["waiting"] < MOST_WAITING - 2:
        time.sleep(0.01)
    fill = [socket.create_connection((host, int(port))) for _ in range(MOST_WAITING)]
    for client in fill:
        client.sendall(f"{head}Content-Length: 12\r\n\r\n".encode())  # without the body: it waits
    refused = server.ask(floats())
    assert refused.status_code == 503
    assert int(refused.headers["Retry-After"]) >= 1
    for client in (*clients, *fill):
        client.close()
    assert server.ask(floats()).json()["verdict"] == "accepted"
    lines = server.get("/metrics").text.splitlines()
    (gone,) = [line for line in lines if line.startswith('yearloc_refused_total{status="499"}')]
    assert float(gone.split()[1]) >= MOST_WAITING / 2
