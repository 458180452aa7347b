"""Everything parallel goes through here: blocks of rows, computed by Dask, delivered in order."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from threading import Thread
from typing import Any, Literal, TypeVar

from pipeline.errors import ConfigError
from pipeline.running.settings import check

Result = TypeVar("Result")
Item = TypeVar("Item")


@dataclass(frozen=True)
class Compute:
    """How blocks of rows are computed; results and their order are the same in every mode."""

    scheduler: Literal["threads", "processes", "cluster"] = "threads"
    """`cluster` takes its address from DASK_SCHEDULER_ADDRESS; its workers need this package and absolute data paths."""
    workers: int = 0
    """How many blocks at a time; 0 means one for each core."""

    def __post_init__(self) -> None:
        check(self, "compute")

    def rows(self, fn: Callable[[int, int], Result], n: int, block: int) -> Iterator[Result]:
        """Yield fn(start, stop) for the blocks of `block` rows that cover range(n), in order.

        At most two blocks a worker are in memory at a time. Raises ConfigError for an unknown scheduler.
        """
        import dask
        from dask.system import CPU_COUNT

        spans = [(start, min(start + block, n)) for start in range(0, n, block)]
        workers = self.workers or CPU_COUNT
        with self._scheduler(workers) as get:
            for first in range(0, len(spans), 2 * workers):
                group = [dask.delayed(fn, pure=False)(*span) for span in spans[first : first + 2 * workers]]
                yield from dask.compute(*group, scheduler=get, num_workers=workers)

    def each(self, fn: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """Yield fn(item) of each item, in order."""
        return self.rows(lambda start, _: fn(items[start]), len(items), 1)

    @contextmanager
    def _scheduler(self, workers: int) -> Iterator[Callable[..., object]]:
        """Dask's function that computes a graph; a scheduler given by name would import distributed each time."""
        if self.scheduler == "threads":
            from dask.threaded import get

            yield get
        elif self.scheduler == "processes":
            from dask.multiprocessing import get, get_context, initialize_worker_process

            with ProcessPoolExecutor(workers, get_context(), _initialize, (initialize_worker_process,)) as pool:
                yield partial(get, pool=pool, chunksize=1)  # Dask's own 6 would give all blocks to one process
        else:
            address = os.environ.get("DASK_SCHEDULER_ADDRESS")
            if not address:
                raise ConfigError(
                    "compute=cluster: set DASK_SCHEDULER_ADDRESS to the scheduler's address, such as tcp://host:8786"
                )
            from distributed import Client

            with Client(address, set_as_default=False) as client:
                yield client.get


def _initialize(dask_s: Callable[[], None]) -> None:
    """Dask's own start of a worker; and the worker ends when its stage is killed, else it would keep its memory for ever."""

    def end_with(stage: Any) -> None:
        stage.join()
        os.kill(os.getpid(), signal.SIGKILL)

    dask_s()
    Thread(target=end_with, args=(multiprocessing.parent_process(),), daemon=True).start()
