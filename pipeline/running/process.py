"""Sets processes up: they end cleanly on SIGTERM, as after an error, and keep freed memory."""

import ctypes
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
"""How long to wait for a process that was asked to end."""
M_TRIM_THRESHOLD = -1
M_MMAP_THRESHOLD = -3
"""mallopt parameter ids (malloc.h); both parameters are sizes in bytes, above which freed memory is
returned to the kernel."""


def end_when_asked() -> None:
    """Let SIGTERM raise SystemExit in the main thread, so that `with` and `finally` are run.

    Otherwise semaphores of workers and scratch files would stay behind. In any thread but the main
    one the call does nothing.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _end)


def end_all(process: Popen[Any]) -> None:
    """Ask a process and its descendants to end, and wait for them.

    A process that a shell started would outlive the shell otherwise.
    """
    with suppress(psutil.NoSuchProcess):
        descendants = psutil.Process(process.pid).children(recursive=True)
        for descendant in descendants:
            with suppress(psutil.NoSuchProcess):
                descendant.terminate()
        process.terminate()
        psutil.wait_procs(descendants, WAIT_S)
    process.wait()


def _end(number: int, frame: FrameType | None) -> None:
    """Handle the first SIGTERM; a second one, which would interrupt the clean-up, is ignored."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    raise SystemExit(TERMINATED)


def keep_freed_memory() -> None:
    """Let glibc reuse the memory of large arrays instead of asking the kernel for new pages.

    This saves a fifth of a training's CPU time, and half of the time to read a scan of 2 MB and
    rasterise it. It holds for the whole process, whose memory then never shrinks. Without glibc
    nothing is done.
    """
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        libc.mallopt(M_MMAP_THRESHOLD, 2**30)
        libc.mallopt(M_TRIM_THRESHOLD, 2**31 - 1)
