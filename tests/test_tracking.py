"""MLflow holds each run once, however often it is published."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import ConfigError, InputError
from pipeline.tracking import KEY, Published, RunRecord, dashboard_url, publish

pytestmark = [
    pytest.mark.filterwarnings("ignore:The ``noload`` loader strategy is deprecated"),  # SQLAlchemy 2.1 about MLflow 3.17
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # MLflow keeps its engines, and their connections, for ever
]


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One database for all tests, each with an experiment of its own: making one takes seconds."""
    return tmp_path_factory.mktemp("tracking") / "new folder" / "mlflow.db"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Work in an empty folder, and leave it as empty."""
    folder = tmp_path / "cwd"
    folder.mkdir()
    monkeypatch.chdir(folder)
    yield
    assert not list(folder.iterdir())


def record(tmp_path: Path, auc: float = 0.9, picture: str = "<svg/>", name: str = "sci") -> RunRecord:
    figure = tmp_path / f"{name}.svg"
    figure.write_text(picture)
    child = RunRecord("2012-02-04", {}, {}, {"train/loss": [(epoch, 1.0 / (epoch + 1)) for epoch in range(1_500)]})
    series = {"test/auc_top1": [(20, auc), (62, 0.8)]}
    return RunRecord(name, {"mlflow.runColor": "#0072B2"}, {"cell_m": 10.0}, series, [figure], [child])


def active(database: Path, experiment_id: str) -> dict[str, Any]:
    return {run.info.run_name: run for run in client(database).search_runs([experiment_id])}


def client(database: Path) -> Any:
    import mlflow

    return mlflow.MlflowClient(tracking_uri=f"sqlite:///{database}")


def test_a_published_run_shows_its_series_parameters_figures_and_children(database: Path, tmp_path: Path) -> None:
    done = publish(database, "shows", [record(tmp_path)])
    assert (done.written, done.kept) == (2, 0)
    runs = active(database, done.experiment_id)
    parent, child = runs["sci"], runs["2012-02-04"]
    points = client(database).get_metric_history(parent.info.run_id, "test/auc_top1")
    assert [(p.step, p.value, p.timestamp) for p in points] == [(20, 0.9, 20), (62, 0.8, 62)]  # no clock in the time
    assert parent.data.params == {"cell_m": "10.0"}
    assert parent.data.tags["mlflow.runColor"] == "#0072B2"
    assert parent.info.status == child.info.status == "FINISHED"
    assert child.data.tags["mlflow.parentRunId"] == parent.info.run_id
    assert len(client(database).get_metric_history(child.info.run_id, "train/loss")) == 1_500
    figure = database.parent / "mlruns" / parent.info.run_id / "artifacts" / "figures" / "sci.svg"
    assert figure.read_text() == "<svg/>"


def test_publishing_twice_changes_nothing(database: Path, tmp_path: Path) -> None:
    first = publish(database, "twice", [record(tmp_path)])
    before = active(database, first.experiment_id)
    assert publish(database, "twice", [record(tmp_path)]) == Published(first.experiment_id, written=0, kept=2)
    after = active(database, first.experiment_id)
    assert {name: run.info.run_id for name, run in after.items()} == {name: run.info.run_id for name, run in before.items()}
    assert len(client(database).get_metric_history(after["sci"].info.run_id, "test/auc_top1")) == 2


@pytest.mark.parametrize("change", [{"auc": 0.7}, {"picture": "<svg></svg>"}])
def test_a_changed_run_replaces_the_old_one_and_its_children(database: Path, tmp_path: Path, change: dict[str, Any]) -> None:
    experiment = f"changed {change}"
    first = publish(database, experiment, [record(tmp_path), record(tmp_path, name="m2dp")])
    before = active(database, first.experiment_id)
    done = publish(database, experiment, [record(tmp_path, **change)])
    assert (done.written, done.kept) == (2, 0)
    runs = client(database).search_runs([done.experiment_id])
    assert sorted(run.info.run_name for run in runs) == ["2012-02-04", "2012-02-04", "m2dp", "sci"]  # m2dp is left alone
    after = active(database, done.experiment_id)
    assert after["sci"].info.run_id != before["sci"].info.run_id
    assert after["m2dp"].info.run_id == before["m2dp"].info.run_id
    assert client(database).get_run(before["sci"].info.run_id).info.lifecycle_stage == "deleted"


def test_a_run_that_was_cut_off_is_written_anew(database: Path, tmp_path: Path) -> None:
    first = publish(database, "cut off", [record(tmp_path)])
    runs = active(database, first.experiment_id)
    client(database).delete_run(runs["2012-02-04"].info.run_id)
    assert publish(database, "cut off", [record(tmp_path)]).written == 2
    assert publish(database, "cut off", [record(tmp_path)]).kept == 2


def test_another_person_s_run_of_the_same_name_is_left_alone(database: Path, tmp_path: Path) -> None:
    first = publish(database, "mine", [])
    mine = client(database).create_run(first.experiment_id, run_name="sci").info.run_id
    publish(database, "mine", [record(tmp_path)])
    publish(database, "mine", [record(tmp_path, auc=0.1)])
    run = client(database).get_run(mine)
    assert run.info.lifecycle_stage == "active"
    assert KEY not in run.data.tags


def test_an_experiment_in_the_bin_is_brought_back(database: Path, tmp_path: Path) -> None:
    first = publish(database, "bin", [record(tmp_path)])
    client(database).delete_experiment(first.experiment_id)
    again = publish(database, "bin", [record(tmp_path)])
    assert again.experiment_id == first.experiment_id
    assert client(database).get_experiment(again.experiment_id).lifecycle_stage == "active"
    assert set(active(database, again.experiment_id)) == {"sci", "2012-02-04"}


def test_figures_kept_in_a_folder_that_moved_are_refused(database: Path, tmp_path: Path) -> None:
    client(database).create_experiment("moved", artifact_location="file:///somewhere/else")
    with pytest.raises(ConfigError, match="delete the database"):
        publish(database, "moved", [record(tmp_path)])


def test_a_new_database_is_filled_as_the_old_one_was(database: Path, tmp_path: Path) -> None:
    old = publish(database, "rebuilt", [record(tmp_path)])
    new_database = tmp_path / "mlflow.db"
    new = publish(new_database, "rebuilt", [record(tmp_path)])
    assert new.written == old.written == 2
    there, here = active(database, old.experiment_id), active(new_database, new.experiment_id)
    for name in ("sci", "2012-02-04"):
        assert there[name].data.tags[KEY] == here[name].data.tags[KEY]
        assert there[name].data.metrics == here[name].data.metrics


def test_a_metric_that_is_no_finite_number_is_refused() -> None:
    with pytest.raises(InputError, match="test/top1"):
        RunRecord("sci", {}, {}, {"test/top1": [(20, float("nan"))]})


def test_a_figure_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.svg"):
        RunRecord("sci", {}, {}, {}, [tmp_path / "gone.svg"])


def test_mlflow_is_loaded_only_to_publish() -> None:
    # A process of its own, for this one has MLflow loaded already.
    code = "import sys, pipeline.tracking; sys.exit('mlflow' in sys.modules)"
    root = Path(__file__).parents[1]
    assert subprocess.run([sys.executable, "-c", code], cwd=root, check=False).returncode == 0


def test_the_dashboard_opens_on_the_charts() -> None:
    url = "http://127.0.0.1:5000/#/experiments/3/runs?compareRunsMode=CHART&workflowType=machine_learning"
    assert dashboard_url("3", 5000) == url
