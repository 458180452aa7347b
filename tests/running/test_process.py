"""A process that is asked to end cleans up: it leaves no semaphores and no scratch files."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from tests.online.made import packed, scan

POOL = """
import time
from pipeline.core.compute import Compute
from pipeline.running.process import end_when_asked

def slow(start, stop):
    time.sleep(0.2)
    return start

if __name__ == "__main__":
    end_when_asked()
    with Compute("processes", workers=2) as compute:
        for row in compute.rows(slow, 1000, 1):
            print(row, flush=True)
"""


def ended(*words: object) -> tuple[int, float, str]:
    """Run a Python program, and ask it to end after its first line of output.

    Returns its exit code, the seconds that it then took, and its standard error with that of its
    workers.
    """
    with subprocess.Popen(
        [sys.executable, *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        asked_s = time.monotonic()
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=60)
        return process.returncode, time.monotonic() - asked_s, said


def test_workers_leave_no_semaphores(tmp_path: Path) -> None:
    (tmp_path / "pool.py").write_text(POOL)
    code, took_s, said = ended(tmp_path / "pool.py")
    assert code == 143
    assert took_s < 20  # of 200 s of work
    assert not said


def test_a_command_leaves_no_scratch_file(tmp_path: Path) -> None:
    """The log has so many scans that the command is asked to end in the midst of them."""
    log = tmp_path / "log"
    log.mkdir()
    for number in range(500):
        (log / f"{number}.npy").symlink_to(tmp_path / "scan.npy")
    np.save(tmp_path / "scan.npy", scan()[0].astype(np.float32))
    out = tmp_path / "out"
    out.mkdir()
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    program = (
        "import os, sys, tempfile; tempfile.tempdir = sys.argv.pop(1); from pipeline.cli import "
        "main\n"
    )
    program += "summary = sys.modules['pipeline.cli.summary'].Summary\nadd = summary.add\n"
    program += "summary.add = lambda *given: (add(*given), print('one', flush=True))\n"
    words = ("localize", packed(tmp_path), log, "--mcap", "-o", out / "fixes.mcap")
    code, _, said = ended("-c", program + "main()", scratch, *words)
    assert code == 143
    assert "Traceback" not in said
    assert not [*out.iterdir()]
    assert not [*scratch.iterdir()]
