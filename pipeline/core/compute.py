"""Computes blocks of rows in parallel: a function and a number of rows in; results, in order, out.

Every stage that computes much does it by one `Compute`, which conf/compute sets up: in threads or
processes of this machine, or on Dask's workers (`clusters`). The results are the same in each mode.
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
from pipeline.core.settings import Positive, Whole, checked

Result = TypeVar("Result")
Item = TypeVar("Item")
Span = tuple[int, int]
"""The first row of a block, and the row after its last."""
Block = Callable[[int, int], Any]
"""A function of a block of rows, given by its first row and the row after its last."""
Run = Callable[[Block, Sequence[Span]], Iterator[Any]]
"""Takes a function and spans (start, stop), and yields the function's results in their order."""


@dataclass
@checked("compute")
class Compute:
    """Computes blocks of rows; results and their order are the same in every mode.

    Inside a `with` statement the workers serve all calls, and end when the statement ends. Without
    a `with` statement, each call starts workers of its own.
    """

    scheduler: Literal["threads", "processes", "local", "cluster", "slurm", "kubernetes"] = (
        "threads"
    )
    """The mode. All but the first two are Dask's workers, started by `clusters`."""
    workers: Whole = 0
    """How many blocks at a time; 0 means one for each core of this machine."""
    wait_s: Positive = 60.0
    """How long to wait for the first worker, and for another when none is left."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Settings of the scheduler `cluster`, `slurm` or `kubernetes` alone."""

    def __post_init__(self) -> None:
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
        self._stack.__exit__(kind, error, traceback)

    def rows(self, fn: Callable[[int, int], Result], n: int, block: int) -> Iterator[Result]:
        """Yield fn(start, stop) for the blocks of `block` rows that cover `n` rows, in order.

        At most two blocks a worker are in memory at a time. Raises ComputeError if workers end, or
        none can be started.
        """
        spans = [(start, min(start + block, n)) for start in range(0, n, block)]
        if self._run:
            yield from self._run(fn, spans)
        elif spans:
            with replace(self) as compute:
                yield from compute.rows(fn, n, block)

    def each(self, fn: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
        """Yield fn(item) for each item, in order."""
        return self.rows(lambda start, _: fn(items[start]), len(items), 1)

    def one_by_one_in_threads(self) -> Self:
        """This compute; if its mode is `threads`, it is limited to one worker.

        It is for blocks that use libraries with settings of the whole process, such as torch.
        """
        return replace(self, workers=1) if self.scheduler == "threads" else self

    @contextmanager
    def _started(self, workers: int) -> Iterator[Run]:
        """Start the workers, yield the function that runs blocks on them, and end them."""
        if self.scheduler == "threads":
            with ThreadPoolExecutor(workers) as threads:
                yield lambda fn, spans: _ahead(
                    lambda start, stop: threads.submit(fn, start, stop), workers, spans
                )
        elif self.scheduler == "processes":
            with _process_pool(workers) as processes:
                yield partial(_run_in_processes, processes, workers)
        else:
            with connected(self.scheduler, workers, self.wait_s, self.settings) as client:
                yield partial(in_order, client, self.scheduler, workers)


def _run_in_processes(
    processes: ProcessPoolExecutor, workers: int, fn: Block, spans: Sequence[Span]
) -> Iterator[Any]:
    """A `Run` in processes of this machine, to which the function is sent pickled."""
    import cloudpickle

    job = cloudpickle.dumps(fn)
    return _ahead(lambda start, stop: processes.submit(_computed, job, start, stop), workers, spans)


@contextmanager
def _process_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Processes that are killed, with the blocks under way, when the stage is interrupted."""
    from dask.multiprocessing import get_context, initialize_worker_process

    with ProcessPoolExecutor(
        workers, get_context(), _initialize_worker, (initialize_worker_process,)
    ) as processes:
        try:
            yield processes
        except (KeyboardInterrupt, SystemExit):  # nobody waits for the blocks under way
            for worker in multiprocessing.active_children():
                worker.kill()
            raise


def _ahead(
    submit: Callable[[int, int], "Future[Any]"], workers: int, spans: Sequence[Span]
) -> Iterator[Any]:
    """Yield the results of all spans, with up to two blocks a worker computed ahead."""
    waiting = deque[Future[Any]]()
    try:
        for start, stop in spans:
            waiting.append(submit(start, stop))
            if len(waiting) == 2 * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for block in waiting:
            block.cancel()


def _computed(job: bytes, start: int, stop: int) -> Any:
    """Compute a block in a worker process by a pickled function."""
    import cloudpickle

    return cloudpickle.loads(job)(start, stop)


def _initialize_worker(initialize_dask_worker: Callable[[], None]) -> None:
    """Start a worker process as Dask does, and end it when its stage is killed.

    The worker would otherwise keep its memory for ever.
    """

    def end_with(stage: Any) -> None:
        """Wait until the stage has ended, then kill this worker."""
        stage.join()
        os.kill(os.getpid(), signal.SIGKILL)

    initialize_dask_worker()
    Thread(target=end_with, args=(multiprocessing.parent_process(),), daemon=True).start()
