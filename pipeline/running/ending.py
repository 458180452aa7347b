"""Ends processes in order: on SIGTERM as after an error, so that they clean up what they hold."""

import signal
import threading
from contextlib import suppress
from subprocess import Popen
from types import FrameType
from typing import Any

import psutil

TERMINATED = 128 + signal.SIGTERM
"""The exit code by which shells and supervisors know a terminated process."""
WAIT_S = 10
"""A process that was asked to end is waited for as long as this."""


def end_when_asked() -> None:
    """Let SIGTERM raise SystemExit in the main thread, so that `with` and `finally` are run.

    Otherwise semaphores of workers and scratch files would stay behind. Called in another thread
    than the main one, it does nothing.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _end)


def end_all(process: Popen[Any]) -> None:
    """Ask a process and all that it has started to end, and wait for them.

    A process that a shell started would outlive the shell otherwise.
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
    """Handle the first SIGTERM; a second one, which would interrupt the cleaning up, is ignored."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit(TERMINATED)
