"""Kills of the commands that DVC does not run: whatever a kill leaves, the next call ends with what
an undisturbed one gives."""

import io
import json
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import tarfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from benchmarks.faults import EVER_S, SIGNALS, digest, stopped

YEARLOC = f"{sys.executable} -m pipeline.cli"
MADE = """\
base: http://127.0.0.1:PORT/
archives: [{path: made.tar.gz, target: made}]
sequence: made
sequences: [made]
"""
"""Of conf/fetch, for the local server."""


def published(project: Path) -> Any:
    """Name, settings and numbers of every run in MLflow's database."""
    with closing(sqlite3.connect(project / "mlflow.db")) as database:
        of_runs = (
            "select r.name, m.key, m.value from {} m join runs r using (run_uuid) where "
            "r.lifecycle_stage = 'active'"
        )
        return [
            sorted(map(repr, database.execute(of_runs.format(table))))
            for table in ("params", "latest_metrics")
        ]


def swept(project: Path) -> Any:
    """The rows that the last sweep recorded; of artifacts that it found or built anew alike."""
    last = max((project / ".sweeps/runs").iterdir(), key=lambda folder: folder.stat().st_mtime_ns)
    return [
        json.loads(path.read_text(encoding="utf-8"))["rows"] for path in sorted(last.glob("*.json"))
    ]


COMMANDS: dict[str, tuple[str, tuple[str, ...], Callable[[Path], Any]]] = {
    "publish": (
        f"{sys.executable} -m stages.publish study=campus artifacts=artifacts",
        ("mlflow.db", "mlruns"),
        published,
    ),
    "pack": (
        f"{YEARLOC} pack campus/10m/scan_context -o killed.site",
        ("killed.site",),
        lambda at: digest(at / "killed.site"),
    ),
    "sweep": (
        f"{sys.executable} -m stages.sweep grid.cell_m=5,20 method=scan_context "
        "tracking.database=swept.db",
        (".sweeps", "swept.db", "mlruns"),
        swept,
    ),
    "fetch": (
        f"{YEARLOC} fetch made root=fetched",
        ("fetched",),
        lambda at: digest(at / "fetched"),
    ),
}
"""Of each command what it makes, which is removed before, and what of that must be the same."""


def cases(project: Path, number: int, seed: int, done: int) -> Iterator[dict[str, Any]]:
    """Stop a command at a random moment, call it again, and compare."""
    right: dict[str, tuple[Any, float]] = {}
    with _served(project):
        for case in range(done, number):
            rng = random.Random(f"{seed} command {case}")
            name = rng.choice([*COMMANDS])
            how = rng.choice(SIGNALS)
            part = rng.random()
            command, made, found = COMMANDS[name]
            if name not in right:
                _remove(project, made)
                start = time.monotonic()
                subprocess.run(
                    command,
                    shell=True,
                    cwd=project,
                    capture_output=True,
                    timeout=EVER_S,
                    check=True,
                )
                right[name] = found(project), time.monotonic() - start
            _remove(project, made)
            left = stopped(command, project, how, part * right[name][1])
            again = subprocess.run(
                command, shell=True, cwd=project, capture_output=True, timeout=EVER_S
            )
            said = again.stderr.decode(errors="replace")
            traced = "Traceback" in said or (how == signal.SIGINT and "Traceback" in left)
            same = again.returncode == 0 and found(project) == right[name][0]
            ending = "traceback" if traced else "same" if same else "silently different"
            yield {
                "case": case,
                "file": f"{name} {how.name}",
                "ending": ending,
                "said": "" if ending == "same" else (left + said)[-300:],
            }


def _remove(project: Path, made: tuple[str, ...]) -> None:
    for name in made:
        shutil.rmtree(project / name, ignore_errors=True)
        with suppress(FileNotFoundError, IsADirectoryError):
            (project / name).unlink()


@contextmanager
def _served(project: Path) -> Iterator[None]:
    """A server of an archive that comes slowly and goes on where it was cut off, and its file in
    conf/fetch."""
    with io.BytesIO() as packed:
        with tarfile.open(fileobj=packed, mode="w:gz") as tar:
            for number in range(200):
                about = tarfile.TarInfo(f"made/{number:03d}.bin")
                about.size = 20_000
                tar.addfile(about, io.BytesIO(random.Random(number).randbytes(about.size)))
        data = packed.getvalue()

    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

        def do_HEAD(self) -> None:
            self.send_response(200)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()

        def do_GET(self) -> None:
            start = int((self.headers.get("Range") or "bytes=0-")[6:-1])
            self.send_response(206 if start else 200)
            self.send_header("ETag", '"made"')
            self.send_header("Content-Length", str(len(data) - start))
            if start:
                self.send_header("Content-Range", f"bytes {start}-{len(data) - 1}/{len(data)}")
            self.end_headers()
            with suppress(OSError):  # who fetches was killed
                for at in range(start, len(data), 65_536):
                    self.wfile.write(data[at : at + 65_536])
                    time.sleep(0.02)

    file = project / "conf/fetch/made.yaml"
    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        file.write_text(MADE.replace("PORT", str(server.server_port)), encoding="utf-8")
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield
        finally:
            server.shutdown()
            file.unlink()
