"""How a process ends that is asked to: as after an error, so that what it holds is given back."""

import signal
import threading
from types import FrameType

TERMINATED = 128 + signal.SIGTERM


def end_when_asked() -> None:
    """Let SIGTERM raise SystemExit in the main thread: else nothing is cleaned up: no semaphore of workers, no scratch file.

    Its exit code is what shells and supervisors know a terminated process by. Called in another thread it does nothing.
    """
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, _end)


def _end(number: int, frame: FrameType | None) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough: a second one would cut the cleaning up
    raise SystemExit(TERMINATED)
