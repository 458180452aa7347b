"""MLflow on a PostgreSQL server, its files in an object store: as in a sqlite file, for many who
publish at once."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import requests

from pipeline.core.errors import ConfigError
from pipeline.core.store import write_model
from pipeline.tracking.runs import Published, RunRecord, publish
from pipeline.tracking.served import Served
from tests.servers.conftest import ObjectStore, Postgres, free_port, listening, wait

pytestmark = [
    pytest.mark.filterwarnings(
        "ignore::DeprecationWarning"
    ),  # of MLflow's own ways with SQLAlchemy and boto
    pytest.mark.filterwarnings(
        "ignore::ResourceWarning"
    ),  # MLflow keeps its engines, and their connections, for ever
]
ROOT = Path(__file__).parents[2]
EIGHT = 8


class Shared:
    """A server's database with the bucket of its files."""

    def __init__(self, url: str, files: str) -> None:
        self.url = url
        self.files = files

    def publish(self, *runs: RunRecord, experiment: str = "shared") -> Published:
        return publish(self.url, experiment, runs, files=self.files)

    @property
    def client(self) -> Any:
        import mlflow

        return mlflow.MlflowClient(tracking_uri=self.url.replace("://", "+psycopg://"))

    def runs(self, experiment: str = "shared") -> dict[str, Any]:
        found = self.client.get_experiment_by_name(experiment)
        return {run.info.run_name: run for run in self.client.search_runs([found.experiment_id])}

    def files_there(self) -> set[str]:
        import s3fs

        return set(s3fs.S3FileSystem(skip_instance_cache=True).find(self.files))


@pytest.fixture(scope="module")
def made(postgres: Postgres, object_store: ObjectStore) -> Shared:
    return Shared(postgres.database("runs"), f"{object_store.bucket('runs')}/mlflow")


@pytest.fixture
def shared(made: Shared, keys: ObjectStore) -> Shared:
    return made


@pytest.fixture
def record(tmp_path: Path) -> Iterator[Any]:
    """Makes a run with a figure, a child and a model of a few numbers."""

    def make(auc: float = 0.9) -> RunRecord:
        (tmp_path / "sci.svg").write_text("<svg/>")
        write_model(tmp_path / "tiny.zarr.zip", {"first": np.array(5)}, {})
        served = Served(tmp_path / "tiny.zarr.zip", "pipeline.methods.sci:Sci", {}, (4, 12))
        child = RunRecord("2012-02-04", {}, {}, {})
        series = {"cells/auc_top1": [(20, auc)]}
        return RunRecord(
            "sci", {}, {"cell_m": 10.0}, series, [tmp_path / "sci.svg"], [child], served, "tiny"
        )

    return make


def test_published_twice_changes_nothing_and_a_changed_run_is_replaced(
    shared: Shared, record: Any
) -> None:
    first = shared.publish(record())
    assert (first.written, first.kept) == (2, 0)
    runs = shared.runs()
    files = shared.files_there()
    (model,) = shared.client.search_logged_models([first.experiment_id])
    assert any(
        file.endswith(f"{runs['sci'].info.run_id}/artifacts/figures/sci.svg") for file in files
    )
    assert any(
        f"/models/{model.model_id}/" in file and file.endswith("tiny.zarr.zip") for file in files
    )
    assert shared.publish(record()) == Published(first.experiment_id, written=0, kept=2)
    assert {name: run.info.run_id for name, run in shared.runs().items()} == {
        n: run.info.run_id for n, run in runs.items()
    }
    assert shared.files_there() == files
    assert shared.publish(record(auc=0.8)).written == 2
    assert shared.runs()["sci"].data.metrics == {"cells/auc_top1": 0.8}
    assert shared.client.get_run(runs["sci"].info.run_id).info.lifecycle_stage == "deleted"
    assert not [
        file for file in shared.files_there() if model.model_id in file
    ]  # the old model's files are gone
    (version,) = shared.client.search_model_versions("name='tiny'")
    assert version.version == 2


PUBLISH_THREE = """
import sys
from pipeline.tracking.runs import RunRecord, publish

runs = [RunRecord(f"run {n}", {}, {}, {"cells/auc_top1": [(20, 0.5)]}) for n in range(3)]
publish(sys.argv[1], "together", runs, files=sys.argv[2])
"""


def test_eight_that_publish_at_once_to_an_empty_database_write_each_run_once(
    postgres: Postgres, shared: Shared, tmp_path: Path
) -> None:
    """None finds MLflow's tables when it starts."""
    empty = Shared(postgres.database("eight"), shared.files)
    command = [sys.executable, "-c", PUBLISH_THREE, empty.url, empty.files]
    all_of_them = [
        subprocess.Popen(command, cwd=ROOT, env=os.environ, stderr=subprocess.PIPE)
        for _ in range(EIGHT)
    ]
    said = [process.communicate()[1].decode() for process in all_of_them]
    assert [process.returncode for process in all_of_them] == [0] * EIGHT, said
    found = [one for one in empty.client.search_experiments() if one.name != "Default"]
    assert [one.name for one in found] == ["together"]
    runs = empty.client.search_runs([found[0].experiment_id])
    assert sorted(run.info.run_name for run in runs) == ["run 0", "run 1", "run 2"]


def test_files_of_an_experiment_stay_where_it_has_them(
    shared: Shared, record: Any, tmp_path: Path
) -> None:
    """Another place given by a second machine would take the first one's runs off the page."""
    shared.publish(record(), experiment="stays")
    with pytest.raises(ConfigError, match=f"keeps its files at {shared.files}; say that"):
        Shared(shared.url, str(tmp_path)).publish(record(), experiment="stays")
    assert shared.publish(record(), experiment="stays").kept == 2


def test_the_page_shows_runs_and_files_and_no_process_shows_the_password(
    postgres: Postgres, shared: Shared, record: Any, tmp_path: Path
) -> None:
    """As `make dashboard` serves it."""
    shared.publish(record(), experiment="page")
    run_id = shared.runs("page")["sci"].info.run_id
    port = free_port()
    log = tmp_path / "mlflow.log"
    command = [
        sys.executable,
        "-m",
        "mlflow",
        "server",
        "--host",
        "127.0.0.1",
        "--port",
        str(port),
        "--workers",
        "1",
    ]
    env = os.environ | {
        "MLFLOW_BACKEND_STORE_URI": shared.url.replace(":", "+psycopg:", 1),
        "MLFLOW_DISABLE_TELEMETRY": "true",
    }
    with log.open("w") as out:
        server = psutil.Popen(command, cwd=tmp_path, env=env, stdout=out, stderr=out)
        try:
            wait(lambda: listening(port), "MLflow")
            page = f"http://127.0.0.1:{port}"
            reported = requests.get(
                f"{page}/api/2.0/mlflow/runs/get", {"run_id": run_id}, timeout=60
            ).json()
            figure = requests.get(
                f"{page}/get-artifact", {"run_uuid": run_id, "path": "figures/sci.svg"}, timeout=60
            ).text
            processes = [server, *server.children(recursive=True)]
            commands = [process.as_dict(["cmdline"])["cmdline"] for process in processes]
            lines = [" ".join(words or ()) for words in commands]  # one that has ended has none
        finally:
            for process in [*server.children(recursive=True), server]:
                process.terminate()
            server.wait()
    assert reported["run"]["data"]["metrics"][0]["value"] == 0.9
    assert figure == "<svg/>"
    assert not [line for line in [*lines, log.read_text()] if postgres.password in line]


@pytest.mark.parametrize(
    ("user", "password", "name", "said"),
    [
        ("yearloc", "not-it", "runs", 'password authentication failed for user "yearloc"'),
        ("yearloc", "", "nowhere", 'database "nowhere" does not exist'),
        ("nobody", "not-it", "runs", 'password authentication failed for user "nobody"'),
    ],
)
def test_who_is_refused_is_reported_in_one_line_without_a_password(
    postgres: Postgres, shared: Shared, user: str, password: str, name: str, said: str
) -> None:
    with pytest.raises(ConfigError) as error:
        Shared(postgres.url(name, password, user), shared.files).publish()
    line = str(error.value)
    assert said in line
    assert f"{user}:***@127.0.0.1:{postgres.port}/{name}" in line
    assert "not-it" not in line
    assert postgres.password not in line
    assert "\n" not in line


def test_a_server_that_is_not_there_is_reported_in_one_line(shared: Shared) -> None:
    with pytest.raises(
        ConfigError,
        match=r"^tracking\.database=\S*u:\*\*\*@127.0.0.1:\d+/x: cannot be opened: .*refused$",
    ):
        Shared(f"postgresql://u:secret@127.0.0.1:{free_port()}/x", shared.files).publish()


def test_a_server_that_goes_while_runs_are_written_is_reported_in_one_line_and_the_next_time_goes_on(
    postgres: Postgres,
    keys: ObjectStore,
    shared: Shared,
    record: Any,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    import psycopg

    from pipeline.tracking import runs

    own = Shared(postgres.database("goes"), shared.files)
    write = runs._write

    def write_one_and_lose_the_server(*given: Any) -> None:
        write(*given)
        if given[2].name != "sci":  # a run is whole once its children are
            return
        with psycopg.connect(postgres.url("postgres"), autocommit=True) as connection:
            connection.execute("alter database goes allow_connections false")
            connection.execute(
                "select pg_terminate_backend(pid) from pg_stat_activity where datname = 'goes'"
            )

    monkeypatch.setattr(runs, "_write", write_one_and_lose_the_server)
    with pytest.raises(
        ConfigError, match=r"^tracking\.database=\S+goes: failed under way: .*; publish again"
    ) as error:
        own.publish(record(), RunRecord("second", {}, {}, {}))
    assert "\n" not in str(error.value)
    assert postgres.password not in str(error.value)
    assert [
        entry.message for entry in caplog.records if entry.levelname in ("ERROR", "CRITICAL")
    ] == []
    with psycopg.connect(postgres.url("postgres"), autocommit=True) as connection:
        connection.execute("alter database goes allow_connections true")
    monkeypatch.undo()
    for name, value in keys.env.items():
        monkeypatch.setenv(name, value)
    done = own.publish(record(), RunRecord("second", {}, {}, {}))
    assert (done.written, done.kept) == (1, 2)


def test_a_bucket_that_goes_while_runs_are_written_is_reported_in_one_line(
    postgres: Postgres,
    keys: ObjectStore,
    shared: Shared,
    record: Any,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from pipeline.tracking import runs

    own = Shared(postgres.database("without-files"), shared.files)
    write = runs._write

    def write_to_nobody(*given: Any) -> None:
        monkeypatch.setenv(
            "MLFLOW_S3_ENDPOINT_URL", f"http://127.0.0.1:{free_port()}"
        )  # MLflow keeps a client for each address
        write(*given)

    monkeypatch.setattr(runs, "_write", write_to_nobody)
    with pytest.raises(
        ConfigError, match=r"^tracking\.database=\S+without-files: failed under way: .*"
    ) as error:
        own.publish(record())
    assert "\n" not in str(error.value)


def test_a_bucket_that_is_not_there_is_reported_before_anything_is_written(shared: Shared) -> None:
    with pytest.raises(
        ConfigError, match=r"^tracking\.artifacts: s3://nowhere: not in the object store"
    ):
        Shared(shared.url, "s3://nowhere/mlflow").publish(experiment="never")
    assert shared.client.get_experiment_by_name("never") is None
