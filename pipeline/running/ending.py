"""Ends a process on SIGTERM as after an error, so that what it holds is given back."""

import signal
import threading
from contextlib import suppress
from subprocess import Popen
from types import FrameType
from typing import Any

import psutil

TERMINATED = 128 + signal.SIGTERM
WAIT_S = 10
"""For processes to end that were asked to."""


def end_when_asked() -> None:
    """Let SIGTERM raise SystemExit in the main thread.

    Else nothing is cleaned up: no semaphore of workers, no scratch file. Its exit code is what
    shells and supervisors know a terminated process by. Called in another thread it does nothing.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _end)


def end_all(process: Popen[Any]) -> None:
    """Ask a process and all that it has started to end, and wait for them.

    What a shell started outlives it otherwise.
    """
    with suppress(psutil.NoSuchProcess):
        started = psutil.Process(process.pid).children(recursive=True)
        for child in started:
            with suppress(psutil.NoSuchProcess):
                child.terminate()
        process.terminate()
        psutil.wait_procs(started, WAIT_S)
    process.wait()


def _end(number: int, frame: FrameType | None) -> None:
    signal.signal(
        signal.SIGTERM, signal.SIG_IGN
    )  # once is enough: a second one would cut the cleaning up
    raise SystemExit(TERMINATED)
