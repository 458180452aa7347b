"""Computes blocks of rows in parallel and delivers them in order.

In threads or processes of this machine, or by Dask's distributed workers.
"""

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from threading import Thread
from types import TracebackType
from typing import Any, Literal, Self, TypeVar

from pipeline.core.clusters import connected, in_order
from pipeline.core.settings import Positive, Whole, check

Result = TypeVar("Result")
Item = TypeVar("Item")
Span = tuple[int, int]
Block = Callable[[int, int], Any]
Run = Callable[[Block, Sequence[Span]], Iterator[Any]]
"""Yields a function of each span, in order."""


@dataclass
class Compute:
    """How blocks of rows are computed; results and their order are the same in every mode.

    Within a `with` block its processes stay for all calls, and end with it; else each call has its
    own.
    """

    scheduler: Literal["threads", "processes", "local", "cluster", "slurm", "kubernetes"] = (
        "threads"
    )
    """All but the first two are Dask's distributed (`clusters`)."""
    workers: Whole = 0
    """How many blocks at a time; 0 means one for each core of this machine."""
    wait_s: Positive = 60.0
    """How long to wait for the first worker, and for another when none is left."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Of the scheduler `cluster`, `slurm` or `kubernetes`."""

    def __post_init__(self) -> None:
        check(self, "compute")
        self._run: Run | None = None
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        self._run = self._stack.enter_context(self._started(self.workers or os.cpu_count() or 1))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._run = None
        self._stack.close()

    def rows(self, fn: Callable[[int, int], Result], n: int, block: int) -> Iterator[Result]:
        """Yield fn(start, stop) for the blocks of `block` rows that cover range(n), in order.

        At most two blocks a worker are in memory at a time. Raises ComputeError where workers end
        or cannot be had.
        """
        spans = [(start, min(start + block, n)) for start in range(0, n, block)]
        if self._run:
            yield from self._run(fn, spans)
        elif spans:
            with replace(self) as compute:
                yield from compute.rows(fn, n, block)

    def each(self, fn: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """Yield fn(item) of each item, in order."""
        return self.rows(lambda start, _: fn(items[start]), len(items), 1)

    def one_by_one_in_threads(self) -> Self:
        """The same, but in mode `threads` one block at a time.

        For blocks whose libraries have settings of the whole process.
        """
        return replace(self, workers=1) if self.scheduler == "threads" else self

    @contextmanager
    def _started(self, workers: int) -> Iterator[Run]:
        """Start what computes the blocks, and end it with the block."""
        if self.scheduler == "threads":
            with ThreadPoolExecutor(workers) as threads:

                def run(fn: Block, spans: Sequence[Span]) -> Iterator[Any]:
                    return _ahead(lambda *span: threads.submit(fn, *span), workers, spans)

                yield run
        elif self.scheduler == "processes":
            import cloudpickle
            from dask.multiprocessing import get_context, initialize_worker_process

            with ProcessPoolExecutor(
                workers, get_context(), _initialize, (initialize_worker_process,)
            ) as pool:

                def run(fn: Block, spans: Sequence[Span]) -> Iterator[Any]:
                    job = cloudpickle.dumps(fn)
                    return _ahead(lambda *span: pool.submit(_computed, job, *span), workers, spans)

                try:
                    yield run
                except (KeyboardInterrupt, SystemExit):  # nobody waits for the blocks under way
                    for worker in multiprocessing.active_children():
                        worker.kill()
                    raise
        else:
            with connected(self.scheduler, workers, self.wait_s, self.settings) as client:
                yield partial(in_order, client, self.scheduler, workers)


def _ahead(
    submit: Callable[[int, int], "Future[Any]"], workers: int, spans: Sequence[Span]
) -> Iterator[Any]:
    """Compute blocks, up to two a worker ahead of the one that is asked for."""
    waiting = deque[Future[Any]]()
    try:
        for span in spans:
            waiting.append(submit(*span))
            if len(waiting) == 2 * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for block in waiting:
            block.cancel()


def _computed(job: bytes, start: int, stop: int) -> Any:
    """A block of a pickled function, in a process of its own."""
    import cloudpickle

    return cloudpickle.loads(job)(start, stop)


def _initialize(dask_s: Callable[[], None]) -> None:
    """Start a worker as Dask does, and end it when its stage is killed.

    Else it would keep its memory for ever.
    """

    def end_with(stage: Any) -> None:
        stage.join()
        os.kill(os.getpid(), signal.SIGKILL)

    dask_s()
    Thread(target=end_with, args=(multiprocessing.parent_process(),), daemon=True).start()
