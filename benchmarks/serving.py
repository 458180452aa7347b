"""A load test of `yearloc serve`: requests a second, their times, and a thousand hostile bodies.

`python -m benchmarks.serving SITE FOLDER-OF-SCANS`: the server runs in processes of its own on this
machine. Times are wall times, since a robot waits for them.
"""

import os
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from itertools import islice
from pathlib import Path

import numpy as np
import requests

from pipeline.online.bodies import FLOATS
from pipeline.online.inputs import ScanOptions
from pipeline.online.site_file import read

PORT = 8799
SCANS = 120
HOSTILE = 1000


def post(body: bytes) -> tuple[int, float]:
    """The status of a request and its seconds."""
    start = time.perf_counter()
    answer = requests.post(
        f"http://127.0.0.1:{PORT}/localize", body, headers={"Content-Type": FLOATS}, timeout=60
    )
    return answer.status_code, time.perf_counter() - start


def hostile(whole: bytes, rng: np.random.Generator) -> bytes:
    """Noise, or a scan that is cut or has bytes changed."""
    body = bytearray(
        whole[: int(rng.integers(1, len(whole)))]
        if rng.integers(2)
        else rng.bytes(int(rng.integers(1, 20_000)))
    )
    for at in rng.integers(len(body), size=50):
        body[at] = rng.integers(256)
    return bytes(body)


def main(site: str, folder: str) -> None:
    options = ScanOptions(read(Path(site)).description.reader)
    scans = islice(options.scans(folder, Counter()), SCANS)
    bodies = [scan.points().astype("<f4").tobytes() for scan in scans]
    for workers in (1, os.cpu_count() or 1):
        words = [
            sys.executable,
            "-m",
            "pipeline.cli",
            "serve",
            site,
            "--port",
            str(PORT),
            "--workers",
            str(workers),
        ]
        server = subprocess.Popen(words, stderr=subprocess.DEVNULL)
        try:
            for _ in range(300):
                try:
                    requests.get(f"http://127.0.0.1:{PORT}/healthz", timeout=1)
                    break
                except requests.ConnectionError:
                    time.sleep(0.1)
            for _ in range(3 * workers):
                post(bodies[0])
            for clients in (1, 4 * workers):
                start = time.perf_counter()
                with ThreadPoolExecutor(clients) as pool:
                    answers = list(pool.map(post, bodies))
                spent_s = time.perf_counter() - start
                took = np.percentile([1e3 * one for _, one in answers], (50, 95, 99))
                rate = (
                    f"{len(answers) / spent_s:5.1f} requests/s, 50 % {took[0]:.0f} ms, 95 % "
                    f"{took[1]:.0f}, 99 % {took[2]:.0f}"
                )
                print(
                    f"{workers} workers, {clients} clients: {rate}; "
                    f"{dict(Counter(status for status, _ in answers))}",
                    flush=True,
                )
            if workers == 1:
                rng = np.random.default_rng(0)
                with ThreadPoolExecutor(4) as pool:
                    bad = [hostile(bodies[0], rng) for _ in range(HOSTILE)]
                    statuses = dict(Counter(status for status, _ in pool.map(post, bad)))
                print(
                    f"{HOSTILE} hostile bodies: {statuses}; then a scan: {post(bodies[0])[0]}",
                    flush=True,
                )
        finally:
            server.terminate()
            server.wait(10)


if __name__ == "__main__":
    main(*sys.argv[1:])
