"""Dask's workers: the same results as threads, what a killed worker costs, and errors in one
line."""

import gc
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import yaml

from pipeline.core import clusters
from pipeline.core.clusters import pods
from pipeline.core.compute import Compute
from pipeline.core.errors import ComputeError, ConfigError, LogError, NotInstalledError
from stages import compute_words
from tests.core.test_compute import within
from tests.listening import addresses

ROOT = Path(__file__).parents[2]
SLURM_CONF = os.environ.get("SLURM_CONF")
# dask-jobqueue's files of keys
LEFT_OPEN = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture(scope="module")
def local() -> Iterator[Compute]:
    """Two worker processes, kept for all tests of this module."""
    with Compute("local", workers=2) as compute:
        yield compute


def worker_pid(start: int, stop: int) -> int:
    """A block whose result is the process that computed it."""
    time.sleep(0.05)
    return os.getpid()


def test_two_processes_give_the_bytes_of_threads_in_order_and_stay_for_the_next_call(
    local: Compute,
) -> None:
    factor = np.pi  # a closure, as stages have

    def scaled(start: int, stop: int) -> np.ndarray:
        return factor * np.arange(start, stop)

    blocks = list(local.rows(scaled, 23, 4))
    assert [block.tobytes() for block in blocks] == [
        block.tobytes() for block in Compute().rows(scaled, 23, 4)
    ]
    workers = set(local.rows(worker_pid, 8, 1))
    assert len(workers) == 2
    assert set(local.rows(worker_pid, 8, 1)) == workers
    assert os.getpid() not in workers


def test_at_most_two_blocks_a_worker_are_begun_before_the_first_is_taken(
    local: Compute, tmp_path: Path
) -> None:
    def note(start: int, stop: int) -> int:
        (tmp_path / str(start)).touch()
        return start

    blocks = local.rows(note, 50, 1)
    assert next(blocks) == 0
    assert len(list(tmp_path.iterdir())) <= 4
    assert list(blocks) == list(range(1, 50))


def test_a_worker_has_one_thread_for_everything_and_listens_on_this_machine_alone(
    local: Compute,
) -> None:
    asked = local.rows(
        lambda start, stop: (os.environ["OMP_NUM_THREADS"], os.environ["OPENBLAS_NUM_THREADS"]),
        4,
        1,
    )
    assert set(asked) == {("1", "1")}
    assert addresses(psutil.Process()) == {"127.0.0.1"}


def test_a_killed_worker_costs_its_block(local: Compute, tmp_path: Path) -> None:
    """Block 3 kills its worker the first time; nothing else runs on that worker."""

    def once(start: int, stop: int) -> int:
        with open(tmp_path / str(start), "a") as file:
            file.write("begun ")
        if start == 3 and (tmp_path / "3").read_text() == "begun ":
            time.sleep(0.3)  # the stage fetches what this worker computed before
            os.kill(os.getpid(), signal.SIGKILL)
        return start

    assert list(local.rows(once, 8, 1)) == list(range(8))
    begun = Counter({path.name: path.read_text().count("begun") for path in tmp_path.iterdir()})
    assert begun["3"] == 2
    assert sum(begun.values()) <= 8 + 2  # and one that the worker had done and not delivered yet


def test_a_block_that_ends_every_worker_is_one_line(local: Compute) -> None:
    def deadly(start: int, stop: int) -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    with pytest.raises(
        ComputeError, match="compute=local: four workers ended while they computed a block"
    ) as raised:
        list(local.rows(deadly, 1, 1))
    assert "\n" not in str(raised.value)
    # the next call finds new workers
    assert list(local.rows(lambda start, stop: start, 2, 1)) == [0, 1]


def test_an_error_of_a_block_comes_as_it_is(local: Compute) -> None:
    def broken(start: int, stop: int) -> None:
        raise LogError(f"row {start} is torn")

    with pytest.raises(LogError, match=r"^row 0 is torn$"):
        list(local.rows(broken, 1, 1))


def test_a_scheduler_that_runs_already_is_left_as_it_was() -> None:
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        scheduler_kwargs=clusters.NO_DASHBOARD,
    ) as cluster:
        with Compute("cluster", settings={"address": cluster.scheduler_address}) as compute:
            assert [block.tolist() for block in compute.rows(np.arange, 5, 2)] == [
                [0, 1],
                [2, 3],
                [4],
            ]
        assert within(
            5,
            lambda: not [name for name in cluster.scheduler.clients if name.startswith("Client-")],
        )
        assert len(cluster.scheduler.workers) == 1


def test_a_worker_of_another_version_or_without_the_disk_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"a worker has Python .*, the stage Python 2; install the same"
    ):
        clusters.run_block(b"", str(tmp_path), "Python 2", 0, 1)
    with pytest.raises(
        ConfigError, match="nowhere; a worker needs the project's disk at the same path"
    ):
        clusters.run_block(b"", str(tmp_path / "nowhere"), clusters.versions(), 0, 1)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({}, "compute=cluster: set DASK_SCHEDULER_ADDRESS"),
        ({"address": "tcp://127.0.0.1:9"}, "compute=cluster: no workers: .*127.0.0.1:9"),
        ({"address": "post://office"}, "compute=cluster: no workers: "),
        ({"adress": "tcp://127.0.0.1:9"}, "compute=cluster: settings: .*adress"),
    ],
)
def test_a_scheduler_that_is_not_there_is_one_line_in_time(
    monkeypatch: pytest.MonkeyPatch, settings: dict[str, str], said: str
) -> None:
    monkeypatch.delenv("DASK_SCHEDULER_ADDRESS", raising=False)
    started = time.monotonic()
    with (
        pytest.raises((ComputeError, ConfigError), match=said) as raised,
        Compute("cluster", 1, 0.5, settings),
    ):
        pass
    assert time.monotonic() - started < 10
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("name", "package", "extra"),
    [("slurm", "dask_jobqueue", "slurm"), ("kubernetes", "dask_kubernetes.operator", "kubernetes")],
)
def test_a_missing_package_names_its_extra(
    monkeypatch: pytest.MonkeyPatch, name: str, package: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with (
        pytest.raises(NotInstalledError, match=rf"yearloc\[{extra}\]"),
        Compute(name, 1, 1, described(name)["settings"]),
    ):  # type: ignore[arg-type]
        pass


def described(name: str) -> dict[str, Any]:
    return dict(yaml.safe_load((ROOT / f"conf/compute/{name}.yaml").read_text()))


def test_the_environment_chooses_for_stages_that_compute_blocks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("YEARLOC_COMPUTE", "local")
    assert compute_words("scans", ["out=a"]) == ["compute=local"]
    assert compute_words("scans", ["compute=threads"]) == []
    assert compute_words("train", []) == []
    monkeypatch.delenv("YEARLOC_COMPUTE")
    assert compute_words("scans", []) == []


@LEFT_OPEN
def test_a_job_of_slurm_is_one_worker_of_one_thread_and_a_refused_one_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The script is composed by dask-jobqueue; no job is sent."""
    from dask_jobqueue import SLURMCluster

    error = "sbatch: error: no queue night\nsbatch: error: failed\n"
    said = iter([subprocess.CompletedProcess((), 0), subprocess.CompletedProcess((), 1, "", error)])
    monkeypatch.setattr(clusters.subprocess, "run", lambda *words, **given: next(said))
    settings = described("slurm")["settings"] | {"queue": "night", "folder": str(tmp_path)}
    with monkeypatch.context() as stub:
        stub.setattr(SLURMCluster, "scale", lambda self, workers: None)
        stub.setattr(SLURMCluster, "adapt", lambda self, **limits: None)
        with clusters.CLUSTERS["slurm"](2, **settings) as cluster:
            lines = cluster.job_script().splitlines()
        del cluster
        gc.collect()
    asked = {"-p night", "-n 1", "--cpus-per-task=1", "--mem=4G", "-t 04:00:00"}
    assert asked <= {line.removeprefix("#SBATCH ") for line in lines}
    assert f"{sys.executable} -m distributed.cli.dask_worker tls://" in lines[-1]
    assert "--nthreads 1" in lines[-1]
    refusal = r"compute=slurm: no job .* no queue night sbatch: error: failed$"
    with pytest.raises(ConfigError, match=refusal):
        Compute("slurm", 1, 1, settings).__enter__()
    gc.collect()


@LEFT_OPEN
@pytest.mark.skipif(
    not SLURM_CONF, reason="SLURM_CONF names no SLURM; tests/servers/slurm.sh runs one"
)
def test_jobs_of_a_real_slurm_give_the_bytes_of_threads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with Compute("slurm", 2, 60, described("slurm")["settings"] | {"memory": "1GB"}) as compute:
        blocks = list(compute.rows(np.arange, 23, 4))
        jobs = set(compute.rows(lambda start, stop: os.environ["SLURM_JOB_ID"], 8, 1))
    assert [block.tobytes() for block in blocks] == [
        block.tobytes() for block in Compute().rows(np.arange, 23, 4)
    ]
    assert jobs
    assert within(
        20, lambda: not subprocess.run(["squeue", "-h"], capture_output=True, check=True).stdout
    )
    gc.collect()


def test_a_pod_of_kubernetes_sees_the_project_where_the_stage_does() -> None:
    """What Dask's operator would be sent; there is no Kubernetes."""
    given = {"image": "yearloc:1", "claim": "data", "mounted": "/srv", "cpu": 2, "memory": "8Gi"}
    spec = pods(3, "/srv/yearloc", **given)["spec"]["worker"]  # type: ignore[arg-type]
    worker = spec["spec"]["containers"][0]
    assert spec["replicas"] == 3
    assert (worker["image"], worker["workingDir"]) == ("yearloc:1", "/srv/yearloc")
    assert worker["args"][:3] == ["dask-worker", "--nthreads", "1"]
    assert (
        worker["resources"]["limits"]
        == worker["resources"]["requests"]
        == {"cpu": "2", "memory": "8Gi"}
    )
    assert spec["spec"]["volumes"] == [
        {"name": "project", "persistentVolumeClaim": {"claimName": "data"}}
    ]
    assert worker["volumeMounts"] == [{"name": "project", "mountPath": "/srv"}]
