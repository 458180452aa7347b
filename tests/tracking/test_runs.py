"""MLflow holds each run once, however often it is published."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import save_file

from pipeline.errors import ConfigError, InputError
from pipeline.tracking import page
from pipeline.tracking.runs import KEY, Published, RunRecord, experiment_of, publish
from pipeline.tracking.served import Served

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
    year_2000 = 30 * 365.25 * 86_400_000 - 43_200_000  # 7 leap days since 1970, not 7.5
    times = [(p.step, p.value, p.timestamp - year_2000) for p in points]
    assert times == [(20, 0.9, 20_000), (62, 0.8, 62_000)]  # no clock in the time
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
    code = "import sys, pipeline.tracking.runs; sys.exit('mlflow' in sys.modules)"
    root = Path(__file__).parents[2]
    assert subprocess.run([sys.executable, "-c", code], cwd=root, check=False).returncode == 0


def test_an_experiment_opens_on_the_view_of_the_dashboard(database: Path, tmp_path: Path) -> None:
    done = publish(database, "view", [record(tmp_path)])
    tags = client(database).get_experiment(done.experiment_id).tags
    assert tags.items() >= page.tags().items()


def test_a_parent_started_after_all_children_so_that_the_page_loads_it_first(database: Path, tmp_path: Path) -> None:
    """The page loads the 100 newest runs: of two families the parents, in the order given, and only then the children."""
    family = [record(tmp_path, name="sci"), record(tmp_path, name="m2dp")]
    done = publish(database, "order", [replace(one, children=[*one.children, RunRecord("later", {}, {}, {})]) for one in family])
    newest = client(database).search_runs([done.experiment_id], order_by=["attributes.start_time DESC"])
    assert [run.info.run_name for run in newest[:2]] == ["sci", "m2dp"]
    assert [run.info.run_name for run in newest[2:]] == ["2012-02-04", "2012-02-04", "later", "later"]


def test_a_sweep_s_jobs_have_colours_of_their_own(database: Path) -> None:
    jobs = [RunRecord(f"job {number}", {}, {}, {}) for number in range(9)]
    done = publish(database, "sweep", [RunRecord("sweep", {}, {}, {}, children=jobs)])
    runs = active(database, done.experiment_id)
    assert len({run.data.tags["mlflow.runColor"] for run in runs.values()}) == 10
    assert runs["sweep"].data.tags["mlflow.runColor"] == "#808080"
    assert runs["job 0"].data.tags["mlflow.runColor"] == "#440154"  # viridis begins so


def test_a_run_lasts_as_long_as_its_system_metrics(database: Path) -> None:
    series = {"system/process_memory_megabytes": [(1, 50.0), (90, 60.0)], "cells/auc_top1": [(400, 0.5)]}
    done = publish(database, "duration", [RunRecord("sci", {}, {}, series)])
    info = active(database, done.experiment_id)["sci"].info
    assert info.end_time - info.start_time == 90_000


TINY = """
from dataclasses import dataclass
from types import SimpleNamespace
import numpy as np

@dataclass
class Tiny:
    step: int

    def localizer(self, model):
        def localize(views, k):
            places = self.step * np.arange(k) + model["first"] + np.zeros((len(views.images), 1), np.int64)
            return SimpleNamespace(
                places=places,
                costs=places.astype(np.float32),
                xy_m=np.zeros((*places.shape, 2)),
                novelty=views.images[:, :1, 0],
                confidence=np.ones(len(places), np.float32),
                heading_deg=np.full(len(places), 90, np.float32),
            )

        return localize
"""


def with_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: int = 5) -> RunRecord:
    """A run whose model ranks places first, first + 3 …; a parameter that its class does not know is left out."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "tiny_method.py").write_text(TINY)
    save_file({"first": np.array(first)}, tmp_path / "tiny.safetensors")
    served = Served(tmp_path / "tiny.safetensors", "tiny_method:Tiny", {"step": 3, "budget": 0.25}, (4, 12), k=3)
    return RunRecord("tiny", {}, {}, {}, model=served)


def models(database: Path, experiment_id: str) -> list[Any]:
    return list(client(database).search_logged_models([experiment_id]))


@pytest.fixture
def load(database: Path) -> Iterator[Any]:
    """MLflow's own way to read a model, from the database of these tests."""
    import mlflow

    path = list(sys.path)
    mlflow.set_tracking_uri(f"sqlite:///{database}")
    yield lambda uri: mlflow.pyfunc.load_model(uri)  # only then imported, which warns; `publish` has done so
    mlflow.set_tracking_uri(None)
    sys.path[:] = path  # MLflow puts the model's code first


def test_a_logged_model_answers_again(database: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, load: Any) -> None:
    done = publish(database, "model", [with_model(tmp_path, monkeypatch)])
    (model,) = models(database, done.experiment_id)
    loaded = load(f"models:/{model.model_id}")
    heights_m = np.full((2, 4, 12), 1.5, np.float32)
    answer = loaded.predict(heights_m)
    assert answer["places"].tolist() == [[5, 8, 11], [5, 8, 11]]
    assert answer["novelty"].tolist() == [[1.5], [1.5]]
    assert answer["heading_deg"].tolist() == [90, 90]
    assert loaded.predict(heights_m, params={"k": 1})["places"].tolist() == [[5], [5]]
    assert loaded.metadata.signature.inputs.inputs[0].shape == (-1, 4, 12)
    assert loaded.metadata.signature.outputs.input_names() == list(answer)


def test_a_logged_model_holds_its_code_and_no_pickle(database: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = publish(database, "no pickle", [with_model(tmp_path, monkeypatch)])
    (model,) = models(database, done.experiment_id)
    files = [path for path in (database.parent / "mlruns" / "models" / model.model_id).rglob("*") if path.is_file()]
    assert {path.suffix for path in files} <= {".py", ".yaml", ".txt", ".safetensors", ""}
    assert [path.name for path in files if path.suffix == ".safetensors"] == ["tiny.safetensors"]
    assert all(path.read_bytes()[:1] != b"\x80" for path in files)  # as every pickle since protocol 2 begins
    (root,) = [path.parent for path in files if path.name == "MLmodel"]
    assert (root / "code" / "pipeline" / "store.py").is_file()
    assert "torch==" in (root / "requirements.txt").read_text()
    assert "float32 (query, 4, 12)" in model.tags["mlflow.note.content"]


def test_publishing_a_model_twice_logs_it_once(database: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done = publish(database, "model twice", [with_model(tmp_path, monkeypatch)])
    (before,) = models(database, done.experiment_id)
    assert publish(database, "model twice", [with_model(tmp_path, monkeypatch)]).kept == 1
    (after,) = models(database, done.experiment_id)
    assert after.model_id == before.model_id


def test_a_changed_model_replaces_the_old_one_and_its_files(
    database: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = publish(database, "model changed", [with_model(tmp_path, monkeypatch)])
    (before,) = models(database, done.experiment_id)
    assert publish(database, "model changed", [with_model(tmp_path, monkeypatch, first=6)]).written == 1
    (after,) = models(database, done.experiment_id)
    assert after.model_id != before.model_id
    kept = {path.name for path in (database.parent / "mlruns" / "models").iterdir()}
    assert after.model_id in kept
    assert before.model_id not in kept


def test_a_run_whose_model_somebody_deleted_is_written_anew(
    database: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = publish(database, "model gone", [with_model(tmp_path, monkeypatch)])
    client(database).delete_logged_model(models(database, done.experiment_id)[0].model_id)
    assert publish(database, "model gone", [with_model(tmp_path, monkeypatch)]).written == 1
    assert len(models(database, done.experiment_id)) == 1


PUBLISH_THREE = """
import sys
from pathlib import Path
from pipeline.tracking.runs import RunRecord, publish

publish(Path(sys.argv[1]), "together", [RunRecord(f"run {n}", {}, {}, {"cells/auc_top1": [(20, 0.5)]}) for n in range(3)])
"""


def test_two_processes_that_publish_at_once_write_each_run_once(database: Path) -> None:
    """Neither finds the experiment when it starts."""
    publish(database, "apart", [])  # the database is there
    both = [subprocess.Popen([sys.executable, "-c", PUBLISH_THREE, str(database)]) for _ in range(2)]
    assert [process.wait() for process in both] == [0, 0]
    experiment = client(database).get_experiment_by_name("together")
    runs = client(database).search_runs([experiment.experiment_id])
    assert sorted(run.info.run_name for run in runs) == ["run 0", "run 1", "run 2"]


def test_an_experiment_says_in_its_name_that_the_data_is_simulated() -> None:
    assert experiment_of("campus", simulated=True) == "yearloc campus (simulated)"
    assert experiment_of("nclt", simulated=False) == "yearloc nclt"
