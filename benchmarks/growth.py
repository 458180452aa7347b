"""What a study costs as it grows: `python -m benchmarks.growth --sizes 10 30 100`.

For each size a copy of the project gets that many short drives past the same walls, and builds all
of the study. It prints the totals and, between two sizes, the cost of each further drive: a column
in which this cost rises is not linear.
"""

import argparse
import json
import subprocess
import sys
import time
import urllib.request
from collections.abc import Mapping, Sequence
from contextlib import chdir, closing
from itertools import pairwise
from pathlib import Path
from socket import socket
from tempfile import TemporaryDirectory

import numpy as np
import psutil

from pipeline.running.telemetry import FOLDER, Telemetry, Trace
from tests.clone import Clone

SCANS = 20
STEP_M = 5.0
POINTS = 2000
SETTINGS = ("budget=tiny", "methods=sci_ring,scan_context")


def record(folder: Path, sequences: int) -> None:
    """Write `sequences` drives of `SCANS` scans in the layout of conf/dataset/folder.yaml, with
    noise of their own."""
    walls = np.random.default_rng(0).uniform((-80, -60, 0), (180, 60, 8), (20 * POINTS, 3))
    walls = walls[np.sin(walls[:, 0] / 9) * np.cos(walls[:, 1] / 7) > 0.8]
    for number in range(sequences):
        rng = np.random.default_rng(number)
        drive = folder / f"drive{number:04}"
        (drive / "scans").mkdir(parents=True)
        poses = []
        for scan in range(SCANS):
            x_m = scan * STEP_M
            y_m = rng.normal(0, 0.3)
            seen = (
                walls[rng.choice(len(walls), POINTS)]
                + rng.normal(0, 0.05, (POINTS, 3))
                - (x_m, y_m, 0)
            )
            np.save(drive / f"scans/{scan}.npy", seen.astype(np.float32))
            poses.append(f"{scan} {x_m} {y_m} 0 0 0 0 1")
        (drive / "poses.txt").write_text("\n".join(poses), encoding="utf-8")


def build(project: Path) -> tuple[Trace, float]:
    """What `dvc repro` used with its children, and the CPU seconds of its own process alone."""
    own_s = 0.0
    with (
        chdir(project),
        Telemetry("growth", every_s=0.2),
        (project / "repro.log").open("w", encoding="utf-8") as log,
    ):
        dvc = psutil.Popen(
            [Path(sys.executable).with_name("dvc"), "repro"],
            stdout=log,
            stderr=log,
            env=Clone(project, "{}").env,
        )
        while dvc.poll() is None:
            times = (
                dvc.cpu_times()
                if dvc.is_running() and dvc.status() != psutil.STATUS_ZOMBIE
                else None
            )
            own_s = times.user + times.system if times else own_s
            time.sleep(0.2)
    if dvc.returncode:
        last_lines = (project / "repro.log").read_text(encoding="utf-8").splitlines()[-10:]
        sys.exit("\n".join([*last_lines, f"dvc repro ended with {dvc.returncode}"]))
    with chdir(project):
        trace = Trace.read("growth")
    assert trace is not None
    return trace, own_s


def page(project: Path) -> tuple[float, int]:
    """Seconds and bytes of what MLflow's page requests first: the runs of the study, complete."""
    with socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    store = f"sqlite:///{project}/mlflow.db"
    mlflow = Path(sys.executable).with_name("mlflow")
    address = f"--host 127.0.0.1 --port {port}"
    words = f"{mlflow} server {address} --backend-store-uri {store} --workers 1".split()
    server = subprocess.Popen(
        words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=Clone(project, "{}").env
    )
    root = f"http://127.0.0.1:{port}"

    def ask(path: str, **body: object) -> bytes:
        request = urllib.request.Request(
            f"{root}{path}", json.dumps(body).encode(), {"Content-Type": "application/json"}
        )
        with closing(urllib.request.urlopen(request, timeout=600)) as answer:
            return bytes(answer.read())

    try:
        for _ in range(240):
            try:
                answer = json.loads(ask("/api/2.0/mlflow/experiments/search", max_results=100))
                break
            except OSError:
                time.sleep(0.5)
        ids = [experiment["experiment_id"] for experiment in answer["experiments"]]
        took = []
        for _ in range(3):
            start = time.monotonic()
            size = len(ask("/api/2.0/mlflow/runs/search", experiment_ids=ids, max_results=100))
            took.append(time.monotonic() - start)
        return min(took), size
    finally:
        server.terminate()
        server.wait()


def measure(sequences: int, folder: Path) -> dict[str, float]:
    """All that a study of `sequences` drives costs, in a new copy of the project below `folder`."""
    project = folder / "project"
    logs = folder / "logs"
    project.mkdir(parents=True)
    clone = Clone(project)
    record(logs, sequences)
    clone.run("yearloc", "use", "folder", f"root={logs}", *SETTINGS)
    first, own_s = build(project)
    traces = [
        Trace(**json.loads(path.read_text(encoding="utf-8")))
        for path in (project / FOLDER).rglob("*.json")
        if path.name != "growth.json"
    ]
    again, _ = build(project)
    page_s, page_bytes = page(project)
    files = [
        path
        for name in ("artifacts", ".dvc/cache", "mlruns")
        for path in (project / name).rglob("*")
        if path.is_file()
    ]
    return {
        "instances": (project / "repro.log").read_text(encoding="utf-8").count("Stage '"),
        "repro, wall s": first.wall_s,
        "repro, CPU s": first.cpu_s,
        "of it DVC's own process, CPU s": own_s,
        "of it the stages' work, CPU s": sum(trace.cpu_s for trace in traces),
        "repro with nothing to do, wall s": again.wall_s,
        "peak memory, MB": first.peak_memory_mb,
        "largest stage, MB": max(trace.peak_memory_mb for trace in traces),
        "files": len(files),
        "bytes, MB": sum(path.stat().st_size for path in files) * 1e-6,
        "DVC's lock files, MB": sum(path.stat().st_size for path in project.rglob("dvc.lock"))
        * 1e-6,
        "MLflow's runs, s": page_s,
        "MLflow's runs, MB": page_bytes * 1e-6,
    }


def table(measured: Mapping[int, Mapping[str, float]]) -> str:
    """A line for each number: its totals, then the cost of a further drive between two sizes."""
    sizes = sorted(measured)
    steps = list(pairwise(sizes))
    heads = [
        *(f"{size} drives" for size in sizes),
        *(f"{low}→{high}, a drive" for low, high in steps),
    ]
    lines = [f"{'':34}" + "".join(f"{head:>18}" for head in heads)]
    for name in measured[sizes[0]]:
        each = [(measured[high][name] - measured[low][name]) / (high - low) for low, high in steps]
        lines.append(
            f"{name:34}"
            + "".join(f"{one:18.4g}" for one in [*(measured[size][name] for size in sizes), *each])
        )
    return "\n".join(lines)


def main(words: Sequence[str] | None = None) -> None:
    """Measure each size and print the table as it grows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--sizes",
        nargs="+",
        type=int,
        default=[10, 30, 100],
        help="Numbers of drives, a study for each [10 30 100]",
    )
    measured = {}
    for size in parser.parse_args(words).sizes:
        with TemporaryDirectory() as folder:
            measured[size] = measure(size, Path(folder))
        print(table(measured), end="\n\n", flush=True)


if __name__ == "__main__":
    main()
