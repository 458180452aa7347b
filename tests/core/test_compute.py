"""Blocks of rows are computed in order and completely, and are the same in every mode."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest

from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError

ROOT = Path(__file__).parents[2]
SCHEDULERS = ("threads", "processes")


@pytest.fixture(scope="module")
def delivered() -> dict[str, list[np.ndarray]]:
    """The blocks of each scheduler for np.arange: block (start, stop) has the rows' own numbers."""
    return {name: list(Compute(name, workers=2).rows(np.arange, 23, 4)) for name in SCHEDULERS}  # type: ignore[arg-type]


@pytest.mark.parametrize("scheduler", SCHEDULERS)
def test_blocks_cover_every_row_in_order(
    delivered: dict[str, list[np.ndarray]], scheduler: str
) -> None:
    # 23 rows in blocks of 4: five whole ones and one of 3; with 2 workers that is more than one
    # group of 4 blocks.
    assert [len(block) for block in delivered[scheduler]] == [4, 4, 4, 4, 4, 3]
    np.testing.assert_array_equal(np.concatenate(delivered[scheduler]), np.arange(23))


def test_threads_and_processes_give_the_same_bytes(delivered: dict[str, list[np.ndarray]]) -> None:
    assert [block.tobytes() for block in delivered["threads"]] == [
        block.tobytes() for block in delivered["processes"]
    ]


@pytest.mark.parametrize(
    ("n", "block", "spans"),
    [(0, 4, []), (1, 4, [(0, 1)]), (4, 4, [(0, 4)]), (5, 4, [(0, 4), (4, 5)])],
)
def test_a_block_is_never_empty(n: int, block: int, spans: list[tuple[int, int]]) -> None:
    assert list(Compute(workers=1).rows(lambda start, stop: (start, stop), n, block)) == spans


def test_later_blocks_wait_until_earlier_ones_are_taken() -> None:
    # Two workers: at most four blocks are worked ahead, so that memory does not grow with the rows.
    begun: list[int] = []

    def note(start: int, stop: int) -> int:
        begun.append(start)
        return start

    blocks: Iterator[int] = Compute(workers=2).rows(note, 100, 1)
    assert next(blocks) == 0
    assert len(begun) <= 4
    assert list(blocks) == list(range(1, 100))


def test_processes_share_the_blocks() -> None:
    def where(start: int, stop: int) -> int:
        time.sleep(0.5)
        return os.getpid()

    assert len({os.getpid(), *Compute("processes", workers=2).rows(where, 8, 1)}) == 3


WORKS = """
import os, pathlib, time
from pipeline.core.compute import Compute
def work(start, stop):
    pathlib.Path(FOLDER, str(os.getpid())).touch()
    time.sleep(60)
if __name__ == "__main__":
    with Compute(SCHEDULER, workers=2) as compute:
        list(compute.rows(work, 2, 1))
"""


def stage(folder: Path, code: str) -> tuple[list[str], dict[str, str]]:
    """The words and the environment that run a stage of this code."""
    (folder / "stage.py").write_text(code)
    return [sys.executable, str(folder / "stage.py")], os.environ | {"PYTHONPATH": str(ROOT)}


@pytest.mark.parametrize("scheduler", ["processes", "local"])
def test_no_worker_is_left_of_a_stage_that_is_killed(tmp_path: Path, scheduler: str) -> None:
    begun = tmp_path / "begun"
    begun.mkdir()
    code = WORKS.replace("FOLDER", repr(str(begun))).replace("SCHEDULER", repr(scheduler))
    words, env = stage(tmp_path, code)
    running = subprocess.Popen(words, env=env)
    assert within(30, lambda: len(list(begun.iterdir())) == 2)
    workers = psutil.Process(running.pid).children(recursive=True)
    assert {str(worker.pid) for worker in workers} >= {path.name for path in begun.iterdir()}
    running.kill()
    running.wait()
    assert within(10, lambda: not any(map(is_alive, workers)))


def is_alive(process: psutil.Process) -> bool:
    return process.is_running() and process.status() != psutil.STATUS_ZOMBIE


EXITS = """
import sys, time
from pipeline.core.compute import Compute

def slow(start, stop):
    time.sleep(300 if start else 0)

if __name__ == "__main__":
    with Compute("processes", workers=2) as compute:
        for _ in compute.rows(slow, 4, 1):
            sys.exit(7)
"""


def test_a_stage_that_exits_does_not_wait_for_the_blocks_under_way(tmp_path: Path) -> None:
    """Block 0 is done at once; those that are under way then would take five minutes each."""
    words, env = stage(tmp_path, EXITS)
    exited = subprocess.run(
        words, env=env, capture_output=True, text=True, timeout=100, check=False
    )
    assert exited.returncode == 7
    assert not exited.stderr


def within(seconds: float, is_true: Callable[[], bool]) -> bool:
    """Whether a condition comes true within so many seconds."""
    until = time.monotonic() + seconds
    while not is_true() and time.monotonic() < until:
        time.sleep(0.05)
    return is_true()


def test_an_error_in_a_block_reaches_the_caller() -> None:
    def broken(start: int, stop: int) -> int:
        raise ValueError(f"rows {start} to {stop}")

    with pytest.raises(ValueError, match="rows 0 to 2"):
        list(Compute(workers=1).rows(broken, 2, 2))


def test_an_unknown_scheduler_is_a_config_error() -> None:
    with pytest.raises(
        ConfigError,
        match=r"compute\.scheduler=fibres: expected threads, processes, .* or kubernetes",
    ):
        list(Compute("fibres").rows(np.arange, 3, 1))  # type: ignore[arg-type]


def test_one_by_one_in_threads_limits_threads_alone() -> None:
    assert Compute(workers=2).one_by_one_in_threads().workers == 1
    assert Compute("processes", workers=2).one_by_one_in_threads().workers == 2
