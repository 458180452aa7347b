"""Stops what yearloc runs, and fills its disk: `python -m benchmarks.faults PROJECT --kills 20
--seed 0`.

PROJECT is a clone in which `yearloc repro` has ended, with logs of its own, such as `world=tiny`. A
stage, a run of `dvc repro` or a command is stopped at a random moment and called again: it must end
with the bytes of an undisturbed run. Full disks are small ones, which only root can mount. Every
case ends as one of ENDINGS; the last two must be 0. Cases go to faults.jsonl in the working folder;
a campaign that was cut off goes on after the last of them. Damaged files and strange words on the
command line are tests: tests/test_faults.py and tests/readers.
"""

import argparse
import hashlib
import io
import json
import os
import random
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import tarfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import yaml

from pipeline.core import store
from pipeline.running.dvc_files import DvcLock, files

SAME, REFUSED, TRACEBACK, DIFFERENT = "same", "refused", "traceback", "silently different"
ENDINGS = (SAME, REFUSED, TRACEBACK, DIFFERENT)
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGSTOP)
EVER_S = 600
OUT = re.compile(r"\bout=(\S+)")
YEARLOC = f"{sys.executable} -m pipeline.cli"


class Case(NamedTuple):
    """How one fault ended."""

    what: str
    ending: str
    said: str = ""


Rngs = Iterable[random.Random]
"""A generator of random numbers a case."""


def digest(path: Path) -> str:
    """The digest of a file, or of a folder's files with their names."""
    members = sorted(file for file in path.rglob("*") if file.is_file())
    parts = [f"{file.relative_to(path)}".encode() + file.read_bytes() for file in members]
    return hashlib.sha256(b"".join(parts) if path.is_dir() else path.read_bytes()).hexdigest()


def instances(project: Path) -> dict[str, tuple[str, list[Path]]]:
    """Command and cached outputs of every stage instance that DVC's lock files have, by name."""
    instances = {}
    for name, entry in DvcLock.read(project / "dvc.lock").stages.items():
        outs = [
            project / out["path"]
            for out in entry.get("outs", ())
            if out["path"].endswith((".zarr", store.MODEL)) or "." not in Path(out["path"]).name
        ]
        if outs and all(out.exists() for out in outs):
            instances[name] = entry["cmd"], outs
    return instances


def call(command: str, project: Path) -> "subprocess.CompletedProcess[str]":
    """Run a command to its end."""
    return subprocess.run(
        command,
        shell=True,
        cwd=project,
        capture_output=True,
        text=True,
        encoding="utf-8",
        errors="replace",
        timeout=EVER_S,
    )


def stopped(command: str, project: Path, how: signal.Signals, after_s: float) -> str:
    """The standard error of a command that gets a signal after a time; SIGSTOP only pauses it."""
    process = subprocess.Popen(
        f"exec {command}",
        shell=True,
        cwd=project,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )
    time.sleep(after_s)
    process.send_signal(how)
    if how == signal.SIGSTOP:
        time.sleep(0.2)
        process.send_signal(signal.SIGCONT)
    return str(process.communicate(timeout=EVER_S)[1], errors="replace")


def stage_stops(project: Path, rngs: Rngs) -> Iterator[Case]:
    """Stop a stage, look at what it left, run it to its end, and compare its outputs."""
    stages = instances(project)
    took_s = dict[str, float]()
    for rng in rngs:
        name = rng.choice([*stages])
        command, outs = stages[name]
        right = [digest(out) for out in outs]
        if name not in took_s:
            start = time.monotonic()
            call(command, project).check_returncode()
            took_s[name] = time.monotonic() - start
        how = rng.choice(SIGNALS)
        left = stopped(command, project, how, rng.random() * took_s[name])
        # a link to DVC's cache is read-only; what a stage writes replaces it whole
        is_whole = [digest(out) for out in outs] == right
        call(command, project).check_returncode()
        is_same = is_whole and [digest(out) for out in outs] == right
        yield _case(
            f"{name} {how.name}", is_same, how == signal.SIGINT and "Traceback" in left, left
        )


def chain_stops(project: Path, rngs: Rngs) -> Iterator[Case]:
    """Stop `dvc repro` while it runs some stages again, itself or all that it started, and let
    `yearloc repro` end it."""
    places = {
        name: name if lock.parent == project else f"dag/{lock.parent.name}/dvc.yaml:{name}"
        for lock in files(project / "dvc.lock")
        for name in (yaml.safe_load(lock.read_text(encoding="utf-8")) or {}).get("stages", {})
    }
    stages = instances(project)
    right = {out: digest(out) for _, outs in stages.values() for out in outs}
    for rng in rngs:
        names = rng.sample(sorted(stages), 3)
        how = rng.choice(SIGNALS[:3])
        stops_all = rng.random() < 0.5
        words = ["dvc", "repro", "--force", "--single-item", *(places[name] for name in names)]
        start = partial(
            subprocess.Popen,
            words,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=project,
        )
        process = start(start_new_session=True)
        second = start() if rng.random() < 0.25 else None  # refused by DVC's lock, or waits for it
        time.sleep(rng.uniform(0.5, 20))
        if process.poll() is None:
            (os.killpg if stops_all else os.kill)(process.pid, how)
        process.wait(timeout=EVER_S)
        if second:
            second.wait(timeout=EVER_S)
        again = call("yearloc repro", project)
        is_same = again.returncode == 0 and {out: digest(out) for out in right} == right
        target = f"{'to all' if stops_all else 'to dvc'}{' of two' if second else ''}"
        what = f"{' '.join(names)} {how.name} {target}"
        yield _case(what, is_same, "Traceback" in again.stderr, again.stderr or again.stdout)


def full_disks(project: Path, rngs: Rngs) -> Iterator[Case]:
    """Let a stage write where less room is than it needs: it says so in a line and leaves nothing,
    or all of it did fit."""
    stages = instances(project)
    writing = sorted(name for name, (command, _) in stages.items() if OUT.search(command))
    for rng in rngs:
        name = rng.choice(writing)
        command, outs = stages[name]
        members = [file for out in outs for file in (out, *out.rglob("*")) if file.is_file()]
        room = rng.randint(4096, sum(file.stat().st_size for file in members) + 4096)
        (out,) = OUT.findall(command)
        with TemporaryDirectory() as folder:
            tmpfs = ["mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", folder]
            subprocess.run(tmpfs, check=True)
            try:
                process = call(OUT.sub(f"out={folder}/{Path(out).name}", command), project)
                left = [
                    digest(path)
                    for path in Path(folder).iterdir()
                    if "scratch" not in path.name and path.suffix != ".lock"
                ]
            finally:
                subprocess.run(["umount", folder], check=True)
        ending = SAME if left == [digest(project / out)] else DIFFERENT
        if "Traceback" in process.stderr or process.returncode not in (0, 1):
            ending = TRACEBACK
        elif process.returncode:
            ending = DIFFERENT if left else REFUSED
        last_lines = process.stderr.strip().splitlines()[-1:] or [""]
        yield Case(f"{name} in {room} bytes", ending, last_lines[0][-300:])


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
    """The rows that the last sweep recorded, the same for found and for rebuilt artifacts."""
    last = max((project / ".sweeps/runs").iterdir(), key=lambda folder: folder.stat().st_mtime_ns)
    return [
        json.loads(path.read_text(encoding="utf-8"))["rows"] for path in sorted(last.glob("*.json"))
    ]


class Command(NamedTuple):
    """A command that DVC does not run."""

    words: str
    made: tuple[str, ...]
    """The files that it makes; they are removed before."""
    result: Callable[[Path], Any]
    """Reads the part of them that must be the same."""


COMMANDS = {
    "publish": Command(
        f"{sys.executable} -m stages.publish study=campus artifacts=artifacts",
        ("mlflow.db", "mlruns"),
        published,
    ),
    "pack": Command(
        f"{YEARLOC} pack campus/10m/scan_context -o killed.site",
        ("killed.site",),
        lambda project: digest(project / "killed.site"),
    ),
    "sweep": Command(
        f"{sys.executable} -m stages.sweep grid.cell_m=5,20 method=scan_context "
        "tracking.database=swept.db",
        (".sweeps", "swept.db", "mlruns"),
        swept,
    ),
    "fetch": Command(
        f"{YEARLOC} fetch made root=fetched",
        ("fetched",),
        lambda project: digest(project / "fetched"),
    ),
}


def command_stops(
    project: Path, rngs: Rngs, commands: Mapping[str, Command] = COMMANDS
) -> Iterator[Case]:
    """Stop a command, call it again, and compare."""
    right: dict[str, tuple[Any, float]] = {}
    with _served(project):
        for rng in rngs:
            name = rng.choice([*commands])
            how = rng.choice(SIGNALS)
            command = commands[name]
            if name not in right:
                _remove(project, command.made)
                start = time.monotonic()
                call(command.words, project).check_returncode()
                right[name] = command.result(project), time.monotonic() - start
            result, took_s = right[name]
            _remove(project, command.made)
            left = stopped(command.words, project, how, rng.random() * took_s)
            again = call(command.words, project)
            is_same = again.returncode == 0 and command.result(project) == result
            is_traced = "Traceback" in again.stderr or (
                how == signal.SIGINT and "Traceback" in left
            )
            yield _case(f"{name} {how.name}", is_same, is_traced, left + again.stderr)


def _case(what: str, is_same: bool, is_traced: bool, said: str) -> Case:
    ending = TRACEBACK if is_traced else SAME if is_same else DIFFERENT
    return Case(what, ending, "" if ending == SAME else said[-300:])


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
        settings = {
            "base": f"http://127.0.0.1:{server.server_port}/",
            "archives": [{"path": "made.tar.gz", "target": "made"}],
            "sequence": "made",
            "sequences": ["made"],
        }
        file.write_text(yaml.safe_dump(settings), encoding="utf-8")
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield
        finally:
            server.shutdown()
            file.unlink()


CAMPAIGNS = {
    "kills": (stage_stops, "Number of stages to stop [0]"),
    "chains": (chain_stops, "Number of runs of dvc repro to stop [0]"),
    "full": (full_disks, "Number of stages to run on a full disk [0]"),
    "commands": (command_stops, "Number of commands to stop: publish, pack, a sweep, fetch [0]"),
}


def main() -> None:
    """Run the cases that are not done yet, and print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks.faults", description=__doc__)
    parser.add_argument("project", type=Path, help="A clone in which `yearloc repro` has ended")
    for kind, (_, help_text) in CAMPAIGNS.items():
        parser.add_argument(f"--{kind}", type=int, default=0, help=help_text)
    parser.add_argument("--seed", type=int, default=0, help="Seed of the random moments [0]")
    options = parser.parse_args()
    with Path("faults.jsonl").open("a+", encoding="utf-8") as file:
        file.seek(0)
        cases = [json.loads(line) for line in file]
        done = Counter(case["kind"] for case in cases)
        for kind, (campaign, _) in CAMPAIGNS.items():
            numbers = range(done[kind], getattr(options, kind))
            rngs = (random.Random(f"{options.seed} {kind} {number}") for number in numbers)
            if not numbers:
                continue
            for case in campaign(options.project.resolve(), rngs):
                cases.append({"kind": kind, **case._asdict()})
                file.write(json.dumps(cases[-1]) + "\n")
                file.flush()
    for kind in CAMPAIGNS:
        counts = Counter(case["ending"] for case in cases if case["kind"] == kind)
        print(f"{kind}: " + ", ".join(f"{counts[ending]:,} {ending}" for ending in ENDINGS))
    failed = [case for case in cases if case["ending"] in ENDINGS[-2:]]
    for case in failed:
        print(f"  {case['what']}: {case['ending']} {case['said']}")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
