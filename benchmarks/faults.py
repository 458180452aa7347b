"""A campaign of faults against a built project: `python -m benchmarks.faults PROJECT --tries 1000
--kills 20 --seed 0`.

PROJECT is a clone in which `yearloc repro` has ended, with logs of its own, such as `world=tiny`;
what is damaged is a copy, and a stage that is killed is run again. Full disks are small ones, which
only root can mount. Every case ends as one of ENDINGS; the last two must be 0. Cases go to
faults.jsonl in the working folder; a campaign that was cut off goes on after the last of them.
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
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout, suppress
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from pipeline.cli import main as yearloc
from pipeline.core import store
from pipeline.core.errors import YearlocError
from pipeline.formats import nclt
from pipeline.inspection.kinds import KINDS
from pipeline.online import site_file
from pipeline.running.dvc_files import DvcLock, files

ENDINGS = ("same", "another input", "refused", "traceback", "silently different")
"""`another input`: a log, which has no checksum, was read as what it now says."""
SEALED = (".zarr", store.MODEL, ".site")
LONGEST = 300_000  # bytes of a log that is mutated; of a longer one the beginning
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGSTOP)
EVER_S = 600
OUT = re.compile(r"\bout=(\S+)")


def mutated(data: bytes, rng: random.Random) -> bytes:
    """With a bit turned, bytes overwritten, a part cut out or doubled, the end cut off, or a number
    made another one."""
    if not data:
        return b"\0"
    at = rng.randrange(len(data))
    length = rng.choice((1, 2, 4, 14, 100))
    ways: tuple[Callable[[], bytes], ...] = (
        lambda: data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :],
        lambda: data[:at] + rng.randbytes(length) + data[at + length :],
        lambda: data[:at] + data[at + length :],
        lambda: data[:at] + data[at : at + length] + data[at:],
        lambda: data[:at],
        lambda: (
            data[:at]
            + rng.choice((b"\0" * length, b"\xff" * length, b"nan", b"-1", b"1e999", b"{}", b"\n"))
            + data[at + length :]
        ),
    )
    return rng.choice(ways)()


def read(path: Path) -> Any:
    """What a reader makes of a path, in a form that can be compared; raises what the reader
    raises."""
    if path.suffix == ".zarr":
        artifact = store.read(path, *KINDS.values())
        return artifact.attrs, {name: artifact.load(name).tobytes() for name in artifact.columns}
    if path.name.endswith(store.MODEL):
        return store.read_recipe(path), {
            name: array.tobytes() for name, array in store.read_model(path).items()
        }
    if path.suffix == ".site":
        parts = site_file.read(path)
        return str(parts.description), {
            name: np.asarray(array).tobytes()
            for name, array in {**parts.model, **parts.arrays}.items()
        }
    return shown(["inspect", str(path)])


def shown(words: list[str]) -> str:
    """What a command prints; raises YearlocError with its line where it refuses."""
    out = io.StringIO()
    err = io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            yearloc(words)
        except SystemExit as error:
            if error.code:
                lines = err.getvalue().strip().splitlines()
                raise YearlocError(lines[-1] if lines else "") from None
    return out.getvalue()


def samples(
    project: Path, folder: Path, also: Sequence[Path] = ()
) -> list[tuple[Path, list[Path]]]:
    """Copies of artifacts, models, a site, logs, drives of scans and poses; each with the files of
    it that are damaged."""
    artifacts = project / "artifacts"
    found = []
    for path in [
        *sorted(artifacts.rglob("*.zarr")),
        *sorted(artifacts.rglob(f"*{store.MODEL}")),
        *sorted(project.glob("*.site")),
    ]:
        copy = folder / path.relative_to(project)
        copy.parent.mkdir(parents=True, exist_ok=True)
        (shutil.copytree if path.is_dir() else shutil.copy)(path, copy)
        found.append(
            (copy, [one for one in copy.rglob("*") if one.is_file()] if copy.is_dir() else [copy])
        )
    seen: Counter[str] = Counter()
    for path in sorted(
        one for root in (artifacts / "logs", *also) for one in root.rglob("*") if one.is_file()
    ):
        seen[f"{path.parent} {path.suffix}"] += 1
        if seen[f"{path.parent} {path.suffix}"] <= 4:
            copy = folder / path.absolute().relative_to("/")
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes()[: LONGEST // nclt.RECORD_BYTES * nclt.RECORD_BYTES])
            found.append((copy, [copy]))
    for drive in sorted(
        scans.parent for root in also for scans in root.rglob("scans") if scans.is_dir()
    ):
        copy = folder / "drives" / drive.absolute().relative_to("/")  # as a whole, with its poses
        shutil.copytree(drive, copy)
        found.append((copy, [one for one in copy.rglob("*") if one.is_file()]))
    return found


def mutations(
    project: Path, tries: int, seed: int, done: int, also: Sequence[Path] = ()
) -> Iterator[dict[str, Any]]:
    """Damage a file of a sample, read the sample, and put the file back."""
    with TemporaryDirectory() as scratch:
        found = samples(project, Path(scratch), also)
        right: dict[Path, Any] = {}
        for path, _ in found:
            with suppress(YearlocError):  # what is refused as it is shows nothing
                right[path] = read(path)
        found = [one for one in found if one[0] in right]
        for number in range(done, tries):
            rng = random.Random(f"{seed} {number}")
            path, files = rng.choice(found)
            file = rng.choice(files)
            before = file.read_bytes()
            file.write_bytes(mutated(before, rng))
            said = ""
            try:
                same = read(path) == right[path]
                ending = (
                    "same"
                    if same
                    else "silently different"
                    if path.name.endswith(SEALED)
                    else "another input"
                )
            except YearlocError as error:
                said = str(error)
                ending = "refused" if "\n" not in str(error).strip() else "traceback"
            except Exception as error:  # what no reader may let through
                said = f"{type(error).__name__}: {error}"[:300]
                ending = "traceback"
            file.write_bytes(before)
            yield {
                "case": number,
                "file": str(file.relative_to(scratch)),
                "ending": ending,
                "said": said,
            }


def digest(path: Path) -> str:
    """Of a file, or of a folder's files and their names."""
    files = sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]
    return hashlib.sha256(
        b"".join(f"{one.relative_to(path)}".encode() + one.read_bytes() for one in files)
    ).hexdigest()


def instances(project: Path) -> list[tuple[str, str, list[Path]]]:
    """Name, command and cached outputs of every stage instance that DVC's lock files have."""
    found = []
    for name, entry in DvcLock.read(project / "dvc.lock").stages.items():
        outs = [
            project / out["path"]
            for out in entry.get("outs", ())
            if out["path"].endswith((".zarr", store.MODEL)) or "." not in Path(out["path"]).name
        ]
        if outs and all(out.exists() for out in outs):
            found.append((name, entry["cmd"], outs))
    return found


def stopped(command: str, project: Path, how: signal.Signals, after_s: float) -> str:
    """What a command says on standard error that is sent a signal after so long; SIGSTOP lets it go
    on a little later."""
    pipes: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    process = subprocess.Popen(f"exec {command}", shell=True, cwd=project, **pipes)
    time.sleep(after_s)
    process.send_signal(how)
    if how == signal.SIGSTOP:
        time.sleep(0.2)
        process.send_signal(signal.SIGCONT)
    return str(process.communicate(timeout=EVER_S)[1], errors="replace")


def kills(project: Path, number: int, seed: int, done: int) -> Iterator[dict[str, Any]]:
    """Stop a stage at a random moment, look at what it left, run it to its end, and compare its
    outputs byte by byte."""
    stages = instances(project)
    took = dict[str, float]()
    for case in range(done, number):
        rng = random.Random(f"{seed} kill {case}")
        name, command, outs = rng.choice(stages)
        for out in outs:  # a link to DVC's cache is read-only; what a stage writes replaces it
            assert out.exists()
        right = [digest(out) for out in outs]
        start = time.monotonic()
        if name not in took:
            subprocess.run(
                command, shell=True, cwd=project, capture_output=True, timeout=EVER_S, check=True
            )
            took[name] = time.monotonic() - start
        how = rng.choice(SIGNALS)
        left = stopped(command, project, how, rng.random() * took[name])
        half = [digest(out) for out in outs] != right
        subprocess.run(
            command, shell=True, cwd=project, capture_output=True, timeout=EVER_S, check=True
        )
        same = not half and [digest(out) for out in outs] == right
        traced = how == signal.SIGINT and "Traceback" in left
        ending = "silently different" if not same else "traceback" if traced else "same"
        yield {
            "case": case,
            "file": f"{name} {how.name}",
            "ending": ending,
            "said": left[-300:] if traced else "",
        }


def chain_kills(project: Path, number: int, seed: int, done: int) -> Iterator[dict[str, Any]]:
    """Stop `dvc repro` while it runs some stages again, itself or all that it started, and let
    `yearloc repro` end it."""
    places = {
        name: name if lock.parent == project else f"dag/{lock.parent.name}/dvc.yaml:{name}"
        for lock in files(project / "dvc.lock")
        for name in (yaml.safe_load(lock.read_text(encoding="utf-8")) or {}).get("stages", {})
    }
    stages = {name: outs for name, _, outs in instances(project)}
    right = {out: digest(out) for outs in stages.values() for out in outs}
    for case in range(done, number):
        rng = random.Random(f"{seed} chain {case}")
        names = rng.sample(sorted(stages), 3)
        how = rng.choice(SIGNALS[:3])
        whole = rng.random() < 0.5
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
            (os.killpg if whole else os.kill)(process.pid, how)
        process.wait(timeout=EVER_S)
        if second:
            second.wait(timeout=EVER_S)
        again = subprocess.run(
            ["yearloc", "repro"],
            cwd=project,
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=EVER_S,
        )
        same = again.returncode == 0 and {out: digest(out) for out in right} == right
        ending = (
            "traceback" if "Traceback" in again.stderr else "same" if same else "silently different"
        )
        said = "" if same else (again.stderr or again.stdout)[-300:]
        what = (
            f"{' '.join(names)} {how.name} "
            f"{'to all' if whole else 'to dvc'}{' of two' if second else ''}"
        )
        yield {"case": case, "file": what, "ending": ending, "said": said}


def full_disks(project: Path, number: int, seed: int, done: int) -> Iterator[dict[str, Any]]:
    """Let a stage write where less room is than it needs: it says so in a line and leaves nothing,
    or all of it did fit."""
    stages = [one for one in instances(project) if OUT.search(one[1])]
    for case in range(done, number):
        rng = random.Random(f"{seed} full {case}")
        name, command, outs = rng.choice(stages)
        sizes = sum(
            file.stat().st_size
            for out in outs
            for file in ([out] if out.is_file() else out.rglob("*"))
            if file.is_file()
        )
        room = rng.randint(4096, sizes + 4096)
        with TemporaryDirectory() as folder:
            subprocess.run(
                ["mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", folder], check=True
            )
            try:
                (out,) = OUT.findall(command)
                words = OUT.sub(f"out={folder}/{Path(out).name}", command)
                process = subprocess.run(
                    words,
                    shell=True,
                    cwd=project,
                    capture_output=True,
                    text=True,
                    encoding="utf-8",
                    timeout=EVER_S,
                )
                left = [
                    path
                    for path in Path(folder).iterdir()
                    if "scratch" not in path.name and path.suffix != ".lock"
                ]
                said = process.stderr.strip().splitlines()[-1:] or [""]
                if "Traceback" in process.stderr or process.returncode not in (0, 1):
                    ending = "traceback"
                elif process.returncode:
                    ending = "silently different" if left else "refused"
                else:
                    ending = (
                        "same"
                        if [digest(path) for path in left] == [digest(project / out)]
                        else "silently different"
                    )
            finally:
                subprocess.run(["umount", folder], check=True)
        yield {
            "case": case,
            "file": f"{name} in {room} bytes",
            "ending": ending,
            "said": said[0][-300:],
        }


def main() -> None:
    """Run all, resume, and print the table."""
    from benchmarks import fault_commands, fault_words  # which take what stands above

    parser = argparse.ArgumentParser("python -m benchmarks.faults", description=__doc__)
    parser.add_argument("project", type=Path)
    parser.add_argument("--tries", type=int, default=1_000, help="mutated files")
    parser.add_argument("--kills", type=int, default=20, help="stages that are stopped")
    parser.add_argument("--chains", type=int, default=0, help="runs of dvc repro that are stopped")
    parser.add_argument("--full", type=int, default=0, help="stages that find the disk full")
    parser.add_argument(
        "--commands",
        type=int,
        default=0,
        help="commands that are stopped: publish, pack, a sweep, fetch",
    )
    parser.add_argument("--words", type=int, default=0, help="commands with changed words")
    parser.add_argument(
        "--also",
        type=Path,
        nargs="*",
        default=[],
        help="folders of recorded logs to damage copies of",
    )
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    path = Path("faults.jsonl")
    cases = (
        [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
        if path.exists()
        else []
    )
    done = Counter(one["kind"] for one in cases)
    runs: dict[str, tuple[Callable[..., Iterator[dict[str, Any]]], int]] = {
        "mutation": (partial(mutations, also=given.also), given.tries),
        "kill": (kills, given.kills),
        "kill of the chain": (chain_kills, given.chains),
        "full disk": (full_disks, given.full),
        "kill of a command": (fault_commands.cases, given.commands),
        "words": (fault_words.cases, given.words),
    }
    with path.open("a", encoding="utf-8") as file:
        for kind, (run, number) in runs.items():
            if done[kind] >= number:
                continue
            for one in run(given.project.resolve(), number, given.seed, done[kind]):
                cases.append({"kind": kind, **one})
                file.write(json.dumps(cases[-1]) + "\n")
                file.flush()
    for kind in runs:
        found = Counter(one["ending"] for one in cases if one["kind"] == kind)
        print(f"{kind}: " + ", ".join(f"{found[ending]:,} {ending}" for ending in ENDINGS))
    for one in (one for one in cases if one["ending"] in ENDINGS[-2:]):
        print(f"  {one['file']}: {one['ending']} {one['said']}")
    sys.exit(any(one["ending"] in ENDINGS[-2:] for one in cases))


if __name__ == "__main__":
    main()
