"""A site answers scans over Zenoh, in a process of its own."""

import json
import queue
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pipeline.online.bodies import CDR, points
from pipeline.online.bridge import connected
from tests.commands import Command
from tests.online.made import scan


@pytest.fixture
def endpoint() -> str:
    """An endpoint at a free port of this machine."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{free.getsockname()[1]}"


@pytest.fixture
def bridge(endpoint: str, three_places: Path) -> Iterator[Callable[..., dict[str, object]]]:
    """A function that sends a scan to another process, which connects here, and returns its
    answer."""
    options = [str(three_places), "--zenoh", endpoint, "--key", "robot"]
    words = [sys.executable, "-m", "pipeline.cli", "serve", *options]
    with connected(endpoint, "listen") as session:
        process = subprocess.Popen(words, stderr=subprocess.PIPE, text=True)
        fixes: queue.Queue[dict[str, object]] = queue.Queue()
        fixed = session.declare_subscriber(
            "robot/fix", lambda sample: fixes.put(json.loads(sample.payload.to_bytes()))
        )
        scans = session.declare_publisher("robot/points")
        assert "robot/points" in process.stderr.readline()
        for _ in range(100):  # a subscription takes a moment to be known here
            if scans.matching_status.matching:
                break
            time.sleep(0.05)

        def ask(body: bytes, encoding: str = "application/octet-stream") -> dict[str, object]:
            scans.put(body, encoding=encoding)
            return fixes.get(timeout=60)

        yield ask
        process.terminate()
        process.communicate(timeout=10)
        fixed.undeclare()


def test_scans_are_answered_by_fixes_and_other_bodies_by_an_error_in_a_line(bridge) -> None:
    points_m, world_T_robot = scan()
    for _ in range(2):
        fix = bridge(points_m.astype("<f4").tobytes())
        assert fix["verdict"] == "accepted"
        assert np.hypot(fix["x"] - world_T_robot[0, 3], fix["y"] - world_T_robot[1, 3]) < 0.2
    assert bridge(b"12345") == {"error": "5 bytes are no whole number of float32 x, y, z"}
    assert "error" in bridge(b"\0" * 40, CDR)
    assert bridge(points_m.astype("<f4").tobytes())["verdict"] == "accepted"


def test_an_endpoint_where_nobody_answers_is_an_error_in_a_line(
    endpoint: str, three_places: Path, yearloc: Command
) -> None:
    said = yearloc.refused("serve", three_places, "--zenoh", endpoint)
    assert f"--zenoh {endpoint}: Unable to connect" in said


def test_a_body_of_floats_is_decoded_to_points() -> None:
    stamp_ns, points_m = points(
        np.array([[1, 2, 3], [4, 5, 6]], "<f4").tobytes(), "application/octet-stream"
    )
    assert stamp_ns is None
    assert points_m.tolist() == [[1, 2, 3], [4, 5, 6]]
