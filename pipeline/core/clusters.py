"""Runs blocks of rows on Dask's workers: a function and row ranges in; results, in order, out.

`connected` starts or reaches the workers of one kind of cluster: processes of this machine, a
scheduler that runs already, SLURM jobs or Kubernetes pods. `in_order` sends the blocks to them and
yields their results. `compute.Compute` chooses between these and plain threads or processes.
"""

import logging
import os
import platform
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from functools import cache, lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar, cast
from uuid import uuid4

from pipeline.core.errors import ComputeError, ConfigError, NotInstalledError
from pipeline.core.settings import Count, within

Result = TypeVar("Result")
LIBRARY = Path(__file__).parents[1]
"""The folder `pipeline`, whose source a worker must have too."""
SILENT = logging.CRITICAL
"""The level of Dask's own log, so that an error is printed once, as an error of this project."""
NO_DASHBOARD = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}
"""Options of Dask's scheduler: it serves no web page."""


@contextmanager
def connected(
    scheduler: str, workers: int, wait_s: float, settings: Mapping[str, Any]
) -> Iterator[Any]:
    """Start or reach one of CLUSTERS and yield Dask's client once a worker has connected.

    `scheduler` is a key of CLUSTERS, `workers` how many to start, and `settings` are the further
    arguments of its function. The client and the cluster are closed at the end of the block. Raises
    ConfigError for settings that the cluster does not take, NotInstalledError without the package
    that it needs, and ComputeError if no worker connects within `wait_s`.
    """
    import dask
    from distributed import Client

    for name in ("distributed", "tornado.application", "asyncio"):
        logging.getLogger(name).setLevel(SILENT)
    dask_settings = {
        "distributed.scheduler.no-workers-timeout": f"{wait_s} s",
        "distributed.scheduler.http.routes": [],
        "distributed.worker.http.routes": [],
        # no warning of functions that carry large arrays
        "distributed.admin.large-graph-warning-threshold": "1 TB",
        # results of this machine's workers need not pass through the scheduler
        "distributed.client.direct-to-workers": scheduler == "local",
    }
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(dask_settings))
        try:
            cluster = stack.enter_context(CLUSTERS[scheduler](workers, **settings))
            client = stack.enter_context(Client(cluster, timeout=wait_s, set_as_default=False))
            client.wait_for_workers(1, wait_s)
        except TypeError as error:
            raise ConfigError(f"compute={scheduler}: settings: {error}") from error
        except (OSError, RuntimeError, ValueError) as error:
            raise ComputeError(
                f"compute={scheduler}: no workers: {' '.join(str(error).split())}"
            ) from error
        yield client


def in_order(
    client: Any,
    scheduler: str,
    workers: int,
    fn: Callable[[int, int], Result],
    spans: Sequence[tuple[int, int]],
) -> Iterator[Result]:
    """Yield fn(start, stop) for each span (start, stop), in order.

    `client` is Dask's, connected to a cluster that was started as `scheduler` with `workers`. Up to
    two blocks a worker are computed ahead of the one that is yielded, and each result is fetched as
    soon as it is done. If a worker ends, another one computes its block again. Raises ComputeError
    if four workers ended at one block or no worker is left, and ConfigError if a worker has other
    versions or another disk.
    """
    import cloudpickle
    from distributed import as_completed

    call_id = uuid4().hex
    folder = os.getcwd()
    stage_versions = versions()
    n_sent = 0
    results = dict[int, Result]()
    running = as_completed(loop=client.loop, with_results=True)
    # the function goes to each worker once, not with each block
    job = client.submit(bytes, cloudpickle.dumps(fn), key=("job", call_id))
    with _worker_errors(scheduler):
        for index in range(len(spans)):
            # send blocks until enough are under way
            ahead = 2 * max(workers, len(client.nthreads()))
            while n_sent < min(index + ahead, len(spans)):
                start, stop = spans[n_sent]
                key = ("rows", call_id, n_sent)
                running.add(
                    client.submit(run_block, job, folder, stage_versions, start, stop, key=key)
                )
                n_sent += 1
            # collect results until the next one in order is there
            while index not in results:
                future, result = next(running)
                if future.cancelled():
                    raise ComputeError(
                        f"compute={scheduler}: the connection to the scheduler is lost"
                    )
                _, _, block_index = future.key
                results[block_index] = result
            yield results.pop(index)


@contextmanager
def _worker_errors(scheduler: str) -> Iterator[None]:
    """Convert Dask's errors about workers into this project's."""
    from distributed import KilledWorker
    from distributed.comm import CommClosedError
    from distributed.scheduler import NoValidWorkerError

    try:
        yield
    except KilledWorker:
        raise ComputeError(
            f"compute={scheduler}: four workers ended while they computed a block; had they memory "
            "enough?"
        ) from None
    except NoValidWorkerError:
        raise ComputeError(f"compute={scheduler}: no worker is left") from None
    except CommClosedError:
        raise ComputeError(
            f"compute={scheduler}: the connection to the scheduler is lost"
        ) from None
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"compute={scheduler}: a worker has no {error.name}; install the same there as here"
        ) from None


def run_block(job: bytes, folder: str, stage_versions: str, start: int, stop: int) -> Any:
    """Compute one block in a worker: call the pickled function `job` with (start, stop).

    The worker changes into the stage's `folder`, since DVC's paths are relative to it. Raises
    ConfigError if the worker has other versions than the stage, or has no such folder.
    """
    if (worker_versions := versions()) != stage_versions:
        raise ConfigError(
            f"compute: a worker has {worker_versions}, the stage {stage_versions}; "
            "install the same on both"
        )
    if not Path(folder).is_dir():
        raise ConfigError(
            f"compute: {platform.node()} has no {folder}; a worker needs the project's disk at the "
            "same path"
        )
    os.chdir(folder)
    return _function(job)(start, stop)


@lru_cache(1)
def _function(job: bytes) -> Callable[[int, int], Any]:
    """Unpickle the function of a call's blocks once, so that what it read for one block is kept."""
    import cloudpickle

    return cast(Callable[[int, int], Any], cloudpickle.loads(job))


@cache
def versions() -> str:
    """The versions that an artifact's bytes depend on, with a digest of this library's source."""
    source = sha256(
        b"".join(path.read_bytes() for path in sorted(LIBRARY.rglob("*.py")))
    ).hexdigest()[:12]
    libraries = [f"{name} {version(name)}" for name in ("numba", "numpy", "scipy", "zarr")]
    return ", ".join([f"Python {platform.python_version()}", *libraries, f"yearloc {source}"])


def _local(workers: int) -> AbstractContextManager[Any]:
    """Start worker processes on this machine, which nothing outside it can reach."""
    from distributed import LocalCluster

    cluster: AbstractContextManager[Any] = LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        host="127.0.0.1",
        security=True,
        dashboard_address=None,
        scheduler_kwargs=NO_DASHBOARD,
        silence_logs=SILENT,
        memory_limit=0,  # Dask would stop workers at a share of the machine's memory
    )
    return cluster


def _running(workers: int, address: str | None = None) -> AbstractContextManager[Any]:
    """Return the address of a running scheduler; raises ConfigError if it is set nowhere."""
    address = address or os.environ.get("DASK_SCHEDULER_ADDRESS")
    if not address:
        raise ConfigError(
            "compute=cluster: set DASK_SCHEDULER_ADDRESS to the scheduler's address, such as "
            "tcp://host:8786"
        )
    return nullcontext(address)


def _slurm(workers: int, folder: str, **settings: Any) -> AbstractContextManager[Any]:
    """Start each worker as a SLURM job of one thread; logs and keys lie in the shared `folder`."""
    within("compute.workers", workers, Count)
    try:
        from dask_jobqueue import SLURMCluster
    except ImportError:
        raise NotInstalledError(
            "compute=slurm: dask-jobqueue is not installed; `pip install 'yearloc[slurm]'`"
        ) from None
    Path(folder).mkdir(mode=0o700, exist_ok=True)
    job = {
        "cores": 1,
        "processes": 1,
        "python": sys.executable,
        "worker_extra_args": ["--no-dashboard"],
        "security": True,
    }
    folders = {
        "scheduler_options": NO_DASHBOARD,
        "log_directory": folder,
        "shared_temp_directory": folder,
        "silence_logs": SILENT,
    }
    cluster: Any = SLURMCluster(**job, **folders, **settings)
    trial = subprocess.run(
        ["sbatch", "--test-only"],
        input=cluster.job_script(),
        capture_output=True,
        encoding="utf-8",
        errors="replace",
        check=False,
    )
    if trial.returncode:
        cluster.close()
        raise ConfigError(
            f"compute=slurm: no job like these is taken: {' '.join(trial.stderr.split())}"
        )
    cluster.scale(workers)
    # a job that SLURM ends is replaced within seconds
    cluster.adapt(minimum=workers, maximum=workers, interval="5 s")
    return cast(AbstractContextManager[Any], cluster)


def _kubernetes(workers: int, **settings: Any) -> AbstractContextManager[Any]:
    """Start each worker as a Kubernetes pod, by Dask's operator."""
    within("compute.workers", workers, Count)
    try:
        from dask_kubernetes.operator import KubeCluster
    except ImportError:
        raise NotInstalledError(
            "compute=kubernetes: dask-kubernetes is not installed; `pip install "
            "'yearloc[kubernetes]'`"
        ) from None
    namespace = settings.pop("namespace", None)
    cluster: AbstractContextManager[Any] = KubeCluster(
        namespace=namespace, custom_cluster_spec=pods(workers, os.getcwd(), **settings), quiet=True
    )
    return cluster


def pods(
    workers: int, folder: str, image: str, claim: str, mounted: str, cpu: float, memory: str
) -> dict[str, Any]:
    """The DaskCluster resource for Kubernetes.

    Its workers start in `folder` and see the disk of the persistent volume claim `claim` at the
    path `mounted`. Each has `cpu` cores and `memory`, such as 4Gi.
    """
    from dask_kubernetes.operator import make_cluster_spec

    limits = {"cpu": str(cpu), "memory": memory}
    resources = {"limits": limits, "requests": limits}
    command = ["dask-worker", "--nthreads", "1", "--memory-limit", "0"]
    spec: dict[str, Any] = make_cluster_spec(
        f"yearloc-{uuid4().hex[:8]}", image, workers, resources, {"OMP_NUM_THREADS": "1"}, command
    )
    pod = spec["spec"]["worker"]["spec"]
    pod["volumes"] = [{"name": "project", "persistentVolumeClaim": {"claimName": claim}}]
    pod["containers"][0] |= {
        "workingDir": folder,
        "volumeMounts": [{"name": "project", "mountPath": mounted}],
    }
    return spec


CLUSTERS: dict[str, Callable[..., AbstractContextManager[Any]]] = {
    "local": _local,
    "cluster": _running,
    "slurm": _slurm,
    "kubernetes": _kubernetes,
}
"""Starts the workers of each kind of cluster; the keys are values of `Compute.scheduler`."""
