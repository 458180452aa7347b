"""Publishes runs to MLflow: each run is stored once, however often it is published.

In: `RunRecord`s, as `records` builds them. The database can be thrown away: publishing again
rebuilds it from the artifacts. A run carries the tag `yearloc.key`, a digest of its metrics, data,
model and figures, which is written last. A run that has the right one stays as it is; one that
changed, or was cut off, is written again. What people added to a run of ours goes over to the run
that replaces it: their tags, their note, and the aliases, tags and descriptions of versions in the
registry. Runs without our tag are somebody else's and are never touched.
"""

import hashlib
import json
import logging
import math
import os
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from pipeline.core.errors import InputError
from pipeline.core.replacing import replace
from pipeline.tracking import page, registry, served
from pipeline.tracking.databases import KEY as KEY
from pipeline.tracking.databases import Database, database, find_experiment

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import LoggedModel, Run

PARENT = "mlflow.parentRunId"
NOTE = "mlflow.note.content"
OUR_NOTE = "yearloc.note"  # the tag with the note as it was written here
BATCH = 1_000  # metric points that MLflow takes at once
# The group of metrics that the page shows on its tab of system metrics, over time, in seconds.
SYSTEM = "system/"
# The time of a point of step 0: 2000-01-01, in ms since 1970. MLflow's page reads small numbers as
# years.
NO_CLOCK_MS = 946_684_800_000
Models = Mapping[str, Sequence["LoggedModel"]]  # run id to the models that the run logged


@dataclass(frozen=True)
class UsedSequence:
    """One sequence of a study, and whether a run trained or tested on it."""

    name: str  # study and sequence
    digest: str
    context: str  # train or test
    source: str  # its submaps' path inside the project


@dataclass(frozen=True)
class RunRecord:
    """The content of one MLflow run; raises InputError if MLflow could not show all of it."""

    name: str
    tags: Mapping[str, str]
    params: Mapping[str, object]
    # name of a metric, such as `cells/auc_top1`, to points: (days since training or epoch, value)
    series: Mapping[str, Sequence[tuple[int, float]]]
    figures: Sequence[Path] = ()
    children: Sequence["RunRecord"] = ()  # one level deep: the page nests no further
    model: served.Served | None = None
    registered: str = ""  # the model's name in the registry
    about: str = ""  # markdown; its $page becomes the address of the experiment's charts
    used: Sequence[UsedSequence] = ()

    def __post_init__(self) -> None:
        for metric, points in self.series.items():
            if not all(math.isfinite(value) for _, value in points):
                raise InputError(
                    f"run {self.name}: metric {metric} has a value that is no finite number; leave "
                    "its point out"
                )
        if missing := [path for path in self.figures if not path.is_file()]:
            raise InputError(f"run {self.name}: no figure {missing[0]}")
        if len({path.name for path in self.figures}) != len(self.figures):
            raise InputError(f"run {self.name}: two figures have one file name")
        if any(child.children for child in self.children):
            raise InputError(f"run {self.name}: a child run cannot have children")

    def key(self) -> str:
        """A digest of metrics, data, model and figures, those of the children included."""
        content = {
            "name": self.name,
            "params": {name: str(value) for name, value in self.params.items()},
            "series": {
                name: [[step, float(value).hex()] for step, value in points]
                for name, points in self.series.items()
            },
            "figures": [[path.name, served.digest(path)] for path in self.figures],
            "children": [child.key() for child in self.children],
            "model": self.model and self.model.content(),
            "registered": self.registered,
            "datasets": [asdict(sequence) for sequence in self.used],
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def experiment_of(dataset: str, simulated: bool, experiment: str = "") -> str:
    """The name of a data set's experiment, which every page of it has as its heading."""
    name = f"yearloc {dataset}"
    if experiment:
        name += f" {experiment}"
    return f"{name} (simulated)" if simulated else name


@dataclass(frozen=True)
class Published:
    """What a call of `publish` did: how many runs it wrote, and how many it left as they were.

    Children are counted too.
    """

    experiment_id: str
    written: int
    kept: int
    aside: str = ""  # the new name of an older experiment, if the project's folder was moved


def publish(
    address: str | Path,
    experiment: str,
    runs: Sequence[RunRecord],
    view: page.View = page.YEAR,
    files: str = "",
) -> Published:
    """Make `experiment` in the database at `address` hold these runs.

    Figures and models go to `files`: see `databases.database`. The experiment's page opens on
    `view`. A run of the same name, or of the same method and grid, whose content differs is marked
    deleted, with its children; other runs are left alone.
    """
    if len({run.name for run in runs}) != len(runs):
        raise InputError(f"two runs of experiment {experiment} have one name")
    target = database(address, files)
    # One process at a time: two would each make the experiment, and each write the runs that they
    # both find missing.
    with target.alone(), _quiet_client(target) as client:
        experiment_id, aside = find_experiment(client, experiment, target)
        for tag, value in page.tags(view).items():
            client.set_experiment_tag(experiment_id, tag, value)
        own_runs = [
            run
            for run in served.all_results(client.search_runs, experiment_id)
            if KEY in run.data.tags
        ]
        models = served.models_by_run(client, experiment_id)
        kept = 0
        registered_of_run = {}
        now_ms = time.time_ns() // 1_000_000
        for place, record in enumerate(runs):
            earlier = [
                run for run in own_runs if PARENT not in run.data.tags and _is_of(run, record)
            ]
            whole = [run for run in earlier if _is_whole(run, record, own_runs, models)]
            if whole:
                run_id = whole[0].info.run_id
                kept += 1 + len(record.children)
            else:
                tags = {page.COLOUR: page.GREY}
                replaced = dict[str, "Run"]()
                for run in reversed(earlier):  # the newest, which may be cut off, last
                    replaced |= _states_by_name(run, record, own_runs)
                run_id = _write(client, experiment_id, record, tags, now_ms - place, replaced)
            # earlier states of the run go
            for run in earlier:
                if run.info.run_id != run_id:
                    _delete(client, run.info.run_id, own_runs, models)
            if record.registered:
                registered_of_run[run_id] = record.registered
        logged = served.models_by_run(client, experiment_id)
        registered = {
            name: model
            for run_id, name in registered_of_run.items()
            for model in logged.get(run_id, ())
        }
        registry.settle(client, experiment, experiment_id, registered)
    written = sum(1 + len(record.children) for record in runs) - kept
    return Published(experiment_id, written, kept, aside)


@contextmanager
def _quiet_client(target: Database) -> Iterator["MlflowClient"]:
    """A client of a database for the block, without telemetry and log lines."""
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = os.environ["DO_NOT_TRACK"] = "true"
    os.environ["MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR"] = "false"
    import mlflow

    quiet = {
        "alembic": logging.WARNING,
        "mlflow": logging.WARNING,
        # it logs the error that it raises, which we report in one line
        "mlflow.store.db.utils": logging.CRITICAL,
        "sqlalchemy.pool": logging.CRITICAL,
    }
    levels = {name: logging.getLogger(name).level for name in quiet}
    try:
        for name, level in quiet.items():
            logging.getLogger(name).setLevel(level)
        # made elsewhere first: a kill while MLflow makes its tables would leave some of them
        if target.path and not target.path.is_file():
            with replace(target.path) as scratch, TemporaryDirectory() as folder:
                new = mlflow.MlflowClient(tracking_uri=f"sqlite:///{folder}/new.db")
                new.search_experiments(max_results=1)
                shutil.copyfile(f"{folder}/new.db", scratch)
        yield mlflow.MlflowClient(tracking_uri=target.uri, registry_uri=target.uri)
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _is_of(run: "Run", record: RunRecord) -> bool:
    """Whether a run is an earlier state of a record: of its name, or of its method and grid."""
    identity = {tag: record.tags.get(tag) for tag in ("method", "grid")}
    has_identity = all(identity.values())
    is_same = all(run.data.tags.get(tag) == value for tag, value in identity.items())
    return run.info.run_name == record.name or (has_identity and is_same)


def _is_whole(run: "Run", record: RunRecord, own_runs: Sequence["Run"], models: Models) -> bool:
    """Whether a run holds this record completely, with its children and model."""
    run_id = run.info.run_id
    has_model = len(models.get(run_id, ())) == (record.model is not None)
    children = [child.data.tags[KEY] for child in _children(run_id, own_runs)]
    has_children = sorted(children) == sorted(child.key() for child in record.children)
    return has_model and has_children and run.data.tags[KEY] == record.key()


def _children(run_id: str, own_runs: Sequence["Run"]) -> list["Run"]:
    return [run for run in own_runs if run.data.tags.get(PARENT) == run_id]


def _states_by_name(run: "Run", record: RunRecord, own_runs: Sequence["Run"]) -> dict[str, "Run"]:
    """The earlier states of a record and of its children, by the names that they have now."""
    children = {child.info.run_name: child for child in _children(run.info.run_id, own_runs)}
    return {**children, record.name: run}


def _added(run: "Run", record: RunRecord) -> dict[str, str]:
    """What people added to a run that this record replaces: their tags and their note."""
    added = {
        tag: value
        for tag, value in run.data.tags.items()
        if tag not in record.tags and not tag.startswith(("mlflow.", "yearloc."))
    }
    note = run.data.tags.get(NOTE, "")
    return added if note == run.data.tags.get(OUR_NOTE, note) else added | {NOTE: note}


def _delete(client: "MlflowClient", run_id: str, own_runs: Sequence["Run"], models: Models) -> None:
    """Delete a run with its children and their models."""
    child_ids = [child.info.run_id for child in _children(run_id, own_runs)]
    for deleted_id in (*child_ids, run_id):
        for model in models.get(deleted_id, ()):
            served.delete(client, model)
        client.delete_run(deleted_id)


def _write(
    client: "MlflowClient",
    experiment_id: str,
    record: RunRecord,
    own_tags: Mapping[str, str],
    start_ms: int,
    replaced: Mapping[str, "Run"],
) -> str:
    """Write one run and its children, its key last, when it is whole; returns its id."""
    from mlflow.entities import Metric, Param

    note = page.linked(record.about, experiment_id)
    tags = {**own_tags, **record.tags, NOTE: note, OUR_NOTE: note}
    if record.name in replaced:
        tags |= _added(replaced[record.name], record)
    run = client.create_run(experiment_id, start_ms, {**tags, KEY: "unfinished"}, record.name)
    run_id = str(run.info.run_id)
    params = [Param(name, str(value)) for name, value in record.params.items()]
    client.log_batch(run_id, params=params)
    # the time of a point is its step in seconds, so that the same record gives the same points
    points = [
        Metric(name, float(value), NO_CLOCK_MS + 1_000 * step, step)
        for name, series in record.series.items()
        for step, value in series
    ]
    for start in range(0, len(points), BATCH):
        client.log_batch(run_id, metrics=points[start : start + BATCH])
    for path in record.figures:
        client.log_artifact(run_id, str(path), "figures")
    _log_datasets(client, run_id, record)
    if record.model is not None:
        served.log(client, experiment_id, run_id, record.name, record.model)
    # The page loads the newest 100 runs first, and nests them only if they are sorted by their
    # start. Children start in 2000, in the order given: no sweep's jobs push a method off the page.
    for place, child in enumerate(record.children):
        child_tags = {PARENT: run_id, page.COLOUR: page.shade(place, len(record.children))}
        _write(client, experiment_id, child, child_tags, NO_CLOCK_MS - place, replaced)
    lasted_s = max((point.step for point in points if point.key.startswith(SYSTEM)), default=0)
    client.set_terminated(run_id, end_time=start_ms + 1_000 * lasted_s)
    client.set_tag(run_id, KEY, record.key())
    return run_id


def _log_datasets(client: "MlflowClient", run_id: str, record: RunRecord) -> None:
    """Add the sequences that a run used, as MLflow's datasets."""
    from mlflow.entities import Dataset, DatasetInput, InputTag
    from mlflow.utils.mlflow_tags import MLFLOW_DATASET_CONTEXT

    inputs = [
        DatasetInput(
            Dataset(sequence.name, sequence.digest, "local", json.dumps({"uri": sequence.source})),
            [InputTag(MLFLOW_DATASET_CONTEXT, sequence.context)],
        )
        for sequence in record.used
    ]
    if inputs:
        client.log_inputs(run_id, inputs)
