"""MLflow holds each run once, however often it is published."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.core.errors import InputError
from pipeline.core.store import write_model
from pipeline.tracking import page
from pipeline.tracking.runs import KEY, Published, RunRecord, UsedSequence, experiment_of, publish
from pipeline.tracking.served import Served

pytestmark = [
    pytest.mark.filterwarnings(
        "ignore:The ``noload`` loader strategy is deprecated"
    ),  # SQLAlchemy 2.1 about MLflow 3.17
    pytest.mark.filterwarnings(
        "ignore::ResourceWarning"
    ),  # MLflow keeps its engines, and their connections, for ever
]


class Experiment:
    """An experiment of a database; figures that its runs show lie in a folder."""

    def __init__(self, database: Path, name: str, folder: Path = Path()) -> None:
        self.database = database
        self.name = name
        self.folder = folder

    def record(self, auc: float = 0.9, picture: str = "<svg/>", name: str = "sci") -> RunRecord:
        """A run of 2 points with a figure, and a child of 1,500 points."""
        figure = self.folder / f"{name}.svg"
        figure.write_text(picture)
        child = RunRecord(
            "2012-02-04",
            {},
            {},
            {"train/loss": [(epoch, 1.0 / (epoch + 1)) for epoch in range(1_500)]},
        )
        series = {"test/auc_top1": [(20, auc), (62, 0.8)]}
        return RunRecord(
            name, {"mlflow.runColor": "#0072B2"}, {"cell_m": 10.0}, series, [figure], [child]
        )

    def publish(self, *runs: RunRecord) -> Published:
        return publish(self.database, self.name, runs)

    @property
    def client(self) -> Any:
        import mlflow

        return mlflow.MlflowClient(tracking_uri=f"sqlite:///{self.database}")

    @property
    def found(self) -> Any:
        return self.client.get_experiment_by_name(self.name)

    @property
    def runs(self) -> dict[str, Any]:
        """The runs that are not deleted, by name."""
        return {
            run.info.run_name: run for run in self.client.search_runs([self.found.experiment_id])
        }

    @property
    def model(self) -> Any:
        """The only logged model."""
        (model,) = self.client.search_logged_models([self.found.experiment_id])
        return model


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A database for all tests, which takes seconds to make; each has an experiment of its own."""
    return tmp_path_factory.mktemp("tracking") / "new folder" / "mlflow.db"


@pytest.fixture
def own(database: Path, request: pytest.FixtureRequest, tmp_path: Path) -> Experiment:
    return Experiment(database, request.node.name, tmp_path)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Each test works in an empty folder, and leaves it empty."""
    folder = tmp_path / "cwd"
    folder.mkdir()
    monkeypatch.chdir(folder)
    yield
    assert not list(folder.iterdir())


def test_a_published_run_shows_its_series_parameters_figures_and_children(own: Experiment) -> None:
    done = own.publish(own.record())
    assert (done.written, done.kept) == (2, 0)
    parent = own.runs["sci"]
    child = own.runs["2012-02-04"]
    points = own.client.get_metric_history(parent.info.run_id, "test/auc_top1")
    year_2000 = 30 * 365.25 * 86_400_000 - 43_200_000  # 7 leap days since 1970, not 7.5
    times = [(p.step, p.value, p.timestamp - year_2000) for p in points]
    assert times == [(20, 0.9, 20_000), (62, 0.8, 62_000)]  # no clock in the time
    assert parent.data.params == {"cell_m": "10.0"}
    assert parent.data.tags["mlflow.runColor"] == "#0072B2"
    assert parent.info.status == child.info.status == "FINISHED"
    assert child.data.tags["mlflow.parentRunId"] == parent.info.run_id
    assert len(own.client.get_metric_history(child.info.run_id, "train/loss")) == 1_500
    figure = (
        own.database.parent / "mlruns" / parent.info.run_id / "artifacts" / "figures" / "sci.svg"
    )
    assert figure.read_text() == "<svg/>"
    assert (
        own.found.tags.items() >= page.tags(page.YEAR).items()
    )  # it opens on the view of the dashboard


def test_publishing_twice_changes_nothing(own: Experiment) -> None:
    first = own.publish(own.record())
    before = own.runs
    assert own.publish(own.record()) == Published(first.experiment_id, written=0, kept=2)
    assert {name: run.info.run_id for name, run in own.runs.items()} == {
        name: run.info.run_id for name, run in before.items()
    }
    assert len(own.client.get_metric_history(before["sci"].info.run_id, "test/auc_top1")) == 2


@pytest.mark.parametrize("change", [{"auc": 0.7}, {"picture": "<svg></svg>"}])
def test_a_changed_run_replaces_the_old_one_and_its_children(
    own: Experiment, change: dict[str, Any]
) -> None:
    own.publish(own.record(), own.record(name="m2dp"))
    before = own.runs
    done = own.publish(own.record(**change))
    assert (done.written, done.kept) == (2, 0)
    runs = own.client.search_runs([done.experiment_id])
    assert sorted(run.info.run_name for run in runs) == [
        "2012-02-04",
        "2012-02-04",
        "m2dp",
        "sci",
    ]  # m2dp is left alone
    after = own.runs
    assert after["sci"].info.run_id != before["sci"].info.run_id
    assert after["m2dp"].info.run_id == before["m2dp"].info.run_id
    assert own.client.get_run(before["sci"].info.run_id).info.lifecycle_stage == "deleted"


def test_what_people_added_goes_over_to_the_run_that_replaces_theirs(own: Experiment) -> None:
    own.publish(replace(own.record(), about="SCI. [All]($page)"))
    for name, tag, value in (
        ("sci", "mine", "1"),
        ("2012-02-04", "mine", "2"),
        ("2012-02-04", "mlflow.note.content", "snow"),
    ):
        own.client.set_tag(own.runs[name].info.run_id, tag, value)
    assert (
        own.publish(replace(own.record(), about="Described better")).kept == 2
    )  # no number changed
    assert own.publish(replace(own.record(auc=0.7), about="Another")).written == 2
    sci = own.runs["sci"].data.tags
    day = own.runs["2012-02-04"].data.tags
    assert (sci["mine"], sci["mlflow.note.content"]) == ("1", "Another")
    assert (day["mine"], day["mlflow.note.content"]) == ("2", "snow")


def test_a_run_that_was_cut_off_is_written_again(own: Experiment) -> None:
    own.publish(own.record())
    own.client.delete_run(own.runs["2012-02-04"].info.run_id)
    assert own.publish(own.record()).written == 2
    assert own.publish(own.record()).kept == 2


def test_another_person_s_run_of_the_same_name_is_left_alone(own: Experiment) -> None:
    mine = own.client.create_run(own.publish().experiment_id, run_name="sci").info.run_id
    own.publish(own.record())
    own.publish(own.record(auc=0.1))
    run = own.client.get_run(mine)
    assert run.info.lifecycle_stage == "active"
    assert KEY not in run.data.tags


def test_an_experiment_in_the_bin_is_brought_back(own: Experiment) -> None:
    first = own.publish(own.record())
    own.client.delete_experiment(first.experiment_id)
    assert own.publish(own.record()).experiment_id == first.experiment_id
    assert own.found.lifecycle_stage == "active"
    assert set(own.runs) == {"sci", "2012-02-04"}


def test_a_moved_folder_publishes_again_and_leaves_the_files_where_they_were(
    own: Experiment, tiny: Any, tmp_path: Path
) -> None:
    """As if the project had been copied: the database names the old folder, which the old copy
    still shows."""
    own.publish(replace(tiny(5), registered="moved-tiny"), own.record())
    first = own.found
    model = own.model
    copy = Experiment(tmp_path / "copy" / "mlflow.db", own.name, own.folder)
    copy.database.parent.mkdir()
    shutil.copyfile(own.database, copy.database)
    done = copy.publish(replace(tiny(5), registered="moved-tiny"), copy.record())
    assert (done.written, done.kept) == (3, 0)
    assert done.aside == f"{own.name}, folder moved ({first.experiment_id})"
    assert copy.found.artifact_location == (copy.database.parent / "mlruns").as_uri()
    assert set(copy.runs) == {"tiny", "sci", "2012-02-04"}
    assert copy.client.get_experiment(first.experiment_id).lifecycle_stage == "deleted"
    (version,) = copy.client.search_model_versions("name='moved-tiny'")
    assert version.source == copy.model.artifact_location
    assert (own.database.parent / "mlruns/models" / model.model_id).is_dir()
    again = copy.publish(replace(tiny(5), registered="moved-tiny"), copy.record())
    assert (again.written, again.kept, again.aside) == (0, 3, "")


def test_a_moved_folder_keeps_other_people_s_runs(own: Experiment) -> None:
    old = own.client.create_experiment(own.name, artifact_location="file:///somewhere/else")
    theirs = own.client.create_run(old, run_name="mine").info.run_id
    ours = own.client.create_run(old, run_name="sci", tags={KEY: "1"}).info.run_id
    done = own.publish(own.record())
    kept = own.client.get_experiment(old)
    assert (kept.name, kept.lifecycle_stage) == (done.aside, "active")
    assert own.client.get_run(theirs).info.lifecycle_stage == "active"
    assert own.client.get_run(ours).info.lifecycle_stage == "deleted"
    assert set(own.runs) == {"sci", "2012-02-04"}


def test_a_moved_folder_whose_experiment_is_in_the_bin_publishes_again(own: Experiment) -> None:
    old = own.client.create_experiment(own.name, artifact_location="file:///somewhere/else")
    own.client.delete_experiment(old)
    assert own.publish(own.record()).written == 2
    assert own.client.get_experiment(old).lifecycle_stage == "deleted"


def test_a_run_shows_its_description_with_a_link_back_and_its_data_sets(own: Experiment) -> None:
    used = [
        UsedSequence("campus april", "0123abcd", "train", "artifacts/submaps/campus/april.zarr")
    ]
    done = own.publish(RunRecord("sci", {}, {}, {}, about="SCI. [All]($page)", used=used))
    run = own.runs["sci"]
    view = "viewStateShareKey=yearloc&compareRunsMode=CHART&workflowType=machine_learning"
    assert (
        run.data.tags["mlflow.note.content"]
        == f"SCI. [All](#/experiments/{done.experiment_id}/runs?{view})"
    )
    (data,) = run.inputs.dataset_inputs
    assert (data.dataset.name, data.dataset.digest) == ("campus april", "0123abcd")
    assert [(tag.key, tag.value) for tag in data.tags] == [("mlflow.data.context", "train")]


def test_a_run_of_the_same_method_and_grid_is_replaced_though_its_name_changed(
    own: Experiment,
) -> None:
    tags = {"method": "sci", "grid": "10m"}
    own.publish(
        RunRecord("sci 10m", tags, {}, {}), RunRecord("sci 5m", tags | {"grid": "5m"}, {}, {})
    )
    own.publish(RunRecord("sci", tags, {}, {}))
    assert set(own.runs) == {"sci", "sci 5m"}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"series": {"test/top1": [(20, float("nan"))]}}, "test/top1"),  # no finite number
        ({"figures": [Path("gone.svg")]}, r"gone\.svg"),  # not there
    ],
)
def test_what_mlflow_cannot_show_is_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        RunRecord(**{"name": "sci", "tags": {}, "params": {}, "series": {}, **given})


def test_mlflow_is_loaded_only_to_publish() -> None:
    # A process of its own, for this one has MLflow loaded already.
    code = "import sys, pipeline.tracking.runs; sys.exit('mlflow' in sys.modules)"
    root = Path(__file__).parents[2]
    assert subprocess.run([sys.executable, "-c", code], cwd=root, check=False).returncode == 0


def test_a_parent_started_after_all_children_so_that_the_page_loads_it_first(
    own: Experiment,
) -> None:
    """The page loads the 100 newest runs: of two families the parents, in the order given, and only
    then the children."""
    family = [own.record(name="sci"), own.record(name="m2dp")]
    done = own.publish(
        *(replace(one, children=[*one.children, RunRecord("later", {}, {}, {})]) for one in family)
    )
    newest = own.client.search_runs([done.experiment_id], order_by=["attributes.start_time DESC"])
    assert [run.info.run_name for run in newest] == [
        "sci",
        "m2dp",
        "2012-02-04",
        "2012-02-04",
        "later",
        "later",
    ]


def test_a_sweep_s_jobs_have_colours_of_their_own(own: Experiment) -> None:
    own.publish(
        RunRecord(
            "sweep",
            {},
            {},
            {},
            children=[RunRecord(f"job {number}", {}, {}, {}) for number in range(9)],
        )
    )
    colours = {name: run.data.tags["mlflow.runColor"] for name, run in own.runs.items()}
    assert len(set(colours.values())) == 10
    assert colours["sweep"] == "#808080"
    assert colours["job 0"] == "#440154"  # viridis begins so


def test_a_run_lasts_as_long_as_its_system_metrics(own: Experiment) -> None:
    series = {
        "system/process_memory_megabytes": [(1, 50.0), (90, 60.0)],
        "cells/auc_top1": [(400, 0.5)],
    }
    own.publish(RunRecord("sci", {}, {}, series))
    info = own.runs["sci"].info
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
            novelty, one = views.images[:, :1, 0], np.ones(places.shape, np.float32)
            reported = {"novelty": novelty, "confidence": one[:, 0], "heading_deg": 90 * one, "xy_m": np.zeros((*places.shape, 2))}
            return SimpleNamespace(places=places, costs=places.astype(np.float32), **reported)

        return localize
"""


@pytest.fixture
def tiny(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[int], RunRecord]:
    """Makes a run whose model ranks places first, first + 3 …; a parameter that its class does not
    know is left out."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "tiny_method.py").write_text(TINY)

    def make(first: int) -> RunRecord:
        write_model(tmp_path / "tiny.zarr.zip", {"first": np.array(first)}, {})
        served = Served(
            tmp_path / "tiny.zarr.zip",
            "tiny_method:Tiny",
            {"step": 3, "budget": 0.25},
            (4, 12),
            k=3,
        )
        return RunRecord("tiny", {}, {}, {}, model=served)

    return make


@pytest.fixture
def load(database: Path) -> Iterator[Any]:
    """MLflow's own way to read a model, from the database of these tests."""
    import mlflow

    path = list(sys.path)
    mlflow.set_tracking_uri(f"sqlite:///{database}")
    yield lambda uri: mlflow.pyfunc.load_model(
        uri
    )  # only then imported, which warns; `publish` has done so
    mlflow.set_tracking_uri(None)
    sys.path[:] = path  # MLflow puts the model's code first


def test_a_logged_model_answers_again_and_holds_its_code_and_no_pickle(
    own: Experiment, tiny: Any, load: Any
) -> None:
    own.publish(tiny(5))
    files = [
        path
        for path in (own.database.parent / "mlruns/models" / own.model.model_id).rglob("*")
        if path.is_file()
    ]  # before loading compiles the code
    loaded = load(f"models:/{own.model.model_id}")
    heights_m = np.full((2, 4, 12), 1.5, np.float32)
    answer = loaded.predict(heights_m)
    assert answer["places"].tolist() == [[5, 8, 11], [5, 8, 11]]
    assert answer["novelty"].tolist() == [[1.5], [1.5]]
    assert answer["heading_deg"].tolist() == [[90, 90, 90], [90, 90, 90]]
    assert loaded.predict(heights_m, params={"k": 1})["places"].tolist() == [[5], [5]]
    assert loaded.metadata.signature.inputs.inputs[0].shape == (-1, 4, 12)
    assert loaded.metadata.signature.outputs.input_names() == list(answer)
    assert {path.suffix for path in files} <= {".py", ".yaml", ".txt", ".zip", ""}
    assert [path.name for path in files if path.suffix == ".zip"] == ["tiny.zarr.zip"]
    assert all(
        path.read_bytes()[:1] != b"\x80" for path in files
    )  # as every pickle since protocol 2 begins
    (root,) = [path.parent for path in files if path.name == "MLmodel"]
    assert (root / "code" / "pipeline" / "core" / "store.py").is_file()
    assert "torch==" in (root / "requirements.txt").read_text()
    assert "float32 (query, 4, 12)" in own.model.tags["mlflow.note.content"]


def test_a_model_is_logged_once_and_again_where_it_changed_or_somebody_deleted_it(
    own: Experiment, tiny: Any
) -> None:
    own.publish(tiny(5))
    first = own.model.model_id
    assert own.publish(tiny(5)).kept == 1
    assert own.model.model_id == first
    assert own.publish(tiny(6)).written == 1
    second = own.model.model_id
    kept = {path.name for path in (own.database.parent / "mlruns" / "models").iterdir()}
    assert second in kept
    assert first not in kept  # the files of the old one are gone too
    own.client.delete_logged_model(second)
    assert own.publish(tiny(6)).written == 1
    assert own.model.model_id != second


def versions(own: Experiment, name: str) -> list[Any]:
    return list(own.client.search_model_versions(f"name='{name}'"))


def test_a_model_is_registered_once_and_its_version_follows_the_run(
    own: Experiment, tiny: Any, load: Any
) -> None:
    own.publish(replace(tiny(5), registered="tiny-model"))
    own.publish(replace(tiny(5), registered="tiny-model"))
    (first,) = versions(own, "tiny-model")
    assert (first.version, first.run_id) == (1, own.runs["tiny"].info.run_id)
    assert json.loads(own.model.tags["mlflow.modelVersions"]) == [
        {"name": "tiny-model", "version": 1}
    ]
    assert load("models:/tiny-model/1").predict(np.zeros((1, 4, 12), np.float32))[
        "places"
    ].tolist() == [[5, 8, 11]]
    own.publish(replace(tiny(6), registered="tiny-model"))
    (second,) = versions(own, "tiny-model")
    assert (second.version, second.run_id) == (2, own.runs["tiny"].info.run_id)


def test_a_version_takes_over_aliases_tags_and_the_description_of_the_one_it_replaces(
    own: Experiment, tiny: Any
) -> None:
    own.publish(replace(tiny(5), registered="tiny-alias"))
    own.client.set_registered_model_alias("tiny-alias", "champion", "1")
    own.client.set_model_version_tag("tiny-alias", "1", "approved", "yes")
    own.client.update_model_version("tiny-alias", "1", "drives on the robot")
    own.publish(replace(tiny(6), registered="tiny-alias"))
    version = own.client.get_model_version_by_alias("tiny-alias", "champion")
    assert int(version.version) == 2
    assert version.tags["approved"] == "yes"
    assert version.description == "drives on the robot"


def test_a_version_that_somebody_deleted_comes_back(own: Experiment, tiny: Any) -> None:
    own.publish(replace(tiny(5), registered="tiny-back"))
    own.client.delete_registered_model("tiny-back")
    assert own.publish(replace(tiny(5), registered="tiny-back")).kept == 1
    assert len(versions(own, "tiny-back")) == 1


def test_no_version_is_left_of_a_model_that_is_gone_and_others_versions_stay(
    own: Experiment, tiny: Any
) -> None:
    both = [
        replace(tiny(5), registered="tiny-gone"),
        replace(tiny(5), name="other", registered="tiny-shared"),
    ]
    own.publish(*both)
    theirs = own.client.create_model_version("tiny-shared", "file:///somewhere/else")
    own.publish(*(RunRecord(one.name, {}, {}, {}) for one in both))
    assert [one.version for one in versions(own, "tiny-shared")] == [theirs.version]
    assert "tiny-gone" not in {one.name for one in own.client.search_registered_models()}


PUBLISH_THREE = """
import sys
from pathlib import Path
from pipeline.tracking.runs import RunRecord, publish

publish(Path(sys.argv[1]), "together", [RunRecord(f"run {n}", {}, {}, {"cells/auc_top1": [(20, 0.5)]}) for n in range(3)])
"""


def test_two_processes_that_publish_at_once_write_each_run_once(database: Path) -> None:
    """Neither finds the experiment when it starts."""
    Experiment(database, "apart").publish()  # the database is there
    both = [
        subprocess.Popen([sys.executable, "-c", PUBLISH_THREE, str(database)]) for _ in range(2)
    ]
    assert [process.wait() for process in both] == [0, 0]
    together = Experiment(database, "together")
    runs = together.client.search_runs([together.found.experiment_id])
    assert sorted(run.info.run_name for run in runs) == ["run 0", "run 1", "run 2"]


def test_an_experiment_says_in_its_name_that_the_data_is_simulated() -> None:
    assert experiment_of("campus", simulated=True) == "yearloc campus (simulated)"
    assert experiment_of("nclt", simulated=False) == "yearloc nclt"


def test_a_kill_while_mlflow_makes_its_tables_leaves_no_database(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mlflow.store.db import utils

    def killed(engine: Any) -> None:
        raise KeyboardInterrupt

    own = Experiment(tmp_path / "mlflow.db", "campus", tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(utils, "_upgrade_db", killed)  # called once some tables are there
        with pytest.raises(KeyboardInterrupt):
            own.publish(own.record())
    assert not own.database.exists()
    own.publish(own.record())
    assert {*own.runs} == {"sci", "2012-02-04"}
