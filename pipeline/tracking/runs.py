"""Publishing runs to MLflow: each run is stored once, however often it is published.

The database is a view that can be thrown away: publishing again rebuilds it from the artifacts. A
run carries the tag `yearloc.key`, a digest of all that it holds, written last; so a run that stands
whole is recognised and left alone, and one that changed, or was cut off, is replaced. Runs without
that tag are somebody else's and are never touched.
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
from pipeline.tracking import datasets, experiments, page, registry, served, texts
from pipeline.tracking.databases import Database, database
from pipeline.tracking.experiments import KEY as KEY

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import LoggedModel, Run

PARENT = "mlflow.parentRunId"
NOTE = "mlflow.note.content"
BATCH = 1_000  # metric points that MLflow takes at once
SYSTEM = "system/"
"""Metrics of this group are on the page's tab of system metrics, which shows them over their time:
their steps are seconds."""
NO_CLOCK_MS = 946_684_800_000
"""2000-01-01: the time, in ms since 1970, that a point of step 0 bears.

MLflow's page takes small numbers for years.
"""

Models = Mapping[str, Sequence["LoggedModel"]]  # run id to the models that the run logged


@dataclass(frozen=True)
class RunRecord:
    """The content of one MLflow run."""

    name: str
    tags: Mapping[str, str]
    params: Mapping[str, object]
    series: Mapping[
        str, Sequence[tuple[int, float]]
    ]  # metric, such as `cells/auc_top1`, to (days since training or epoch, value)
    figures: Sequence[Path] = ()
    children: Sequence["RunRecord"] = ()  # one level deep: the page nests no further
    model: served.Served | None = None
    registered: str = ""  # the model's name in the registry
    about: str = (
        ""  # the description, in markdown; its $page becomes the address of the experiment's charts
    )
    used: Sequence[datasets.UsedSequence] = ()

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
        """A digest of the whole content, figures and children included."""
        content = {
            "name": self.name,
            "tags": dict(self.tags),
            "params": {name: str(value) for name, value in self.params.items()},
            "series": {
                name: [[step, float(value).hex()] for step, value in points]
                for name, points in self.series.items()
            },
            "figures": [
                [path.name, hashlib.sha256(path.read_bytes()).hexdigest()] for path in self.figures
            ],
            "children": [child.key() for child in self.children],
            "model": self.model and self.model.content(),
            "registered": self.registered,
            "about": self.about,
            "datasets": [asdict(sequence) for sequence in self.used],
        }
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def experiment_of(dataset: str, simulated: bool, question: str = "") -> str:
    """The name of a data set's experiment, which every page of it has as its heading."""
    return f"yearloc {dataset}{f' {question}' * bool(question)}{' (simulated)' * simulated}"


@dataclass(frozen=True)
class Published:
    """What a call of `publish` did; runs include children."""

    experiment_id: str
    written: int
    kept: int
    aside: str = ""
    """The name that an experiment was given whose files went to another folder, where the project
    was moved."""


def publish(
    address: str | Path,
    experiment: str,
    runs: Sequence[RunRecord],
    view: page.View = page.YEAR,
    files: str = "",
) -> Published:
    """Make `experiment` in the database at `address` hold these runs.

    Figures and models go to `files`: see `databases.database`. Its page opens on `view`. A run of
    the same name, or method and grid, whose content differs is marked deleted, with its children;
    others are left alone.
    """
    if len({run.name for run in runs}) != len(runs):
        raise InputError(f"two runs of experiment {experiment} have one name")
    target = database(address, files)
    # One process at a time: two would each make the experiment, and each write the runs that they
    # both find missing.
    with target.alone(), _quiet_client(target) as client:
        experiment_id, aside = experiments.find(client, experiment, target)
        for tag, value in page.tags(view).items():
            client.set_experiment_tag(experiment_id, tag, value)
        own_runs = [
            run
            for run in served.all_results(client.search_runs, experiment_id)
            if KEY in run.data.tags
        ]
        models = served.owners(client, experiment_id)
        kept = 0
        run_ids = []
        now_ms = time.time_ns() // 1_000_000
        for place, record in enumerate(runs):
            earlier = [
                run for run in own_runs if _is_of(run, record) and PARENT not in run.data.tags
            ]
            complete = [
                run.info.run_id for run in earlier if _stands(run, record, own_runs, models)
            ]
            kept += (1 + len(record.children)) * bool(complete)
            family = {page.COLOUR: page.GREY}
            run_id = next(iter(complete), None) or _write(
                client, experiment_id, record, family, now_ms - place
            )
            for run in earlier:
                if run.info.run_id != run_id:
                    _delete(client, run.info.run_id, own_runs, models)
            run_ids.append(run_id)
        logged = served.owners(client, experiment_id)
        registered = {
            record.registered: model
            for record, run_id in zip(runs, run_ids, strict=True)
            for model in logged.get(run_id, ())
            if record.registered
        }
        registry.settle(client, experiment, experiment_id, registered)
    written = sum(1 + len(record.children) for record in runs) - kept
    return Published(experiment_id, written, kept, aside)


@contextmanager
def _quiet_client(target: Database) -> Iterator["MlflowClient"]:
    """A client of a database, without telemetry and without log lines about it.

    The database is created and migrated if need be.
    """
    os.environ["MLFLOW_DISABLE_TELEMETRY"] = os.environ["DO_NOT_TRACK"] = "true"
    os.environ["MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR"] = "false"
    import mlflow

    quiet = {
        "alembic": logging.WARNING,
        "mlflow": logging.WARNING,
        # it logs the error that it raises, which we tell in one line
        "mlflow.store.db.utils": logging.CRITICAL,
        "sqlalchemy.pool": logging.CRITICAL,
    }
    levels = {name: logging.getLogger(name).level for name in quiet}
    try:
        for name, level in quiet.items():
            logging.getLogger(name).setLevel(level)
        if (
            target.path and not target.path.is_file()
        ):  # made elsewhere first: a kill while MLflow makes its tables would leave some
            with replace(target.path) as scratch, TemporaryDirectory() as folder:
                mlflow.MlflowClient(tracking_uri=f"sqlite:///{folder}/new.db").search_experiments(
                    max_results=1
                )
                shutil.copyfile(f"{folder}/new.db", scratch)
        yield mlflow.MlflowClient(tracking_uri=target.uri, registry_uri=target.uri)
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)


def _is_of(run: "Run", record: RunRecord) -> bool:
    """Whether a run is an earlier state of a record: of its name, or of its method and grid."""
    identity = ("method", "grid")
    has_identity = all(record.tags.get(tag) for tag in identity)
    return bool(
        run.info.run_name == record.name
        or (has_identity and all(run.data.tags.get(tag) == record.tags[tag] for tag in identity))
    )


def _stands(run: "Run", record: RunRecord, own_runs: Sequence["Run"], models: Models) -> bool:
    """Whether a run holds this record completely, with its children and model."""
    if len(models.get(run.info.run_id, ())) != (record.model is not None):
        return False
    children = sorted(
        r.data.tags[KEY] for r in own_runs if r.data.tags.get(PARENT) == run.info.run_id
    )
    return run.data.tags[KEY] == record.key() and children == sorted(
        child.key() for child in record.children
    )


def _delete(client: "MlflowClient", run_id: str, own_runs: Sequence["Run"], models: Models) -> None:
    family = [run.info.run_id for run in own_runs if run.data.tags.get(PARENT) == run_id]
    for member in [*family, run_id]:
        for model in models.get(member, ()):
            served.delete(client, model)
        client.delete_run(member)


def _write(
    client: "MlflowClient",
    experiment_id: str,
    record: RunRecord,
    family: Mapping[str, str],
    start_ms: int,
) -> str:
    """Write one run and its children, its key last, when it is whole; returns its id.

    A point's time is its step in seconds, so no clock enters.

    The page loads the newest 100 runs first, and nests them only if they are sorted by start:
    children start in 2000, in the order given, so that no sweep's jobs push a method off the page.
    A run lasts as long as its system metrics.
    """
    from mlflow.entities import Metric, Param

    note = {NOTE: texts.linked(record.about, page.fragment(experiment_id))} if record.about else {}
    tags = {**family, **record.tags, **note}
    run = client.create_run(experiment_id, start_ms, {**tags, KEY: "unfinished"}, record.name)
    run_id = str(run.info.run_id)
    params = [Param(name, str(value)) for name, value in record.params.items()]
    client.log_batch(run_id, params=params)
    points = [
        Metric(name, float(value), NO_CLOCK_MS + 1_000 * step, step)
        for name, series in record.series.items()
        for step, value in series
    ]
    for start in range(0, len(points), BATCH):
        client.log_batch(run_id, metrics=points[start : start + BATCH])
    for path in record.figures:
        client.log_artifact(run_id, str(path), "figures")
    datasets.log(client, run_id, record.used)
    if record.model is not None:
        served.log(client, experiment_id, run_id, record.name, record.model)
    for place, child in enumerate(record.children):
        child_tags = {PARENT: run_id, page.COLOUR: page.shade(place, len(record.children))}
        _write(client, experiment_id, child, child_tags, NO_CLOCK_MS - place)
    lasted_s = max((point.step for point in points if point.key.startswith(SYSTEM)), default=0)
    client.set_terminated(run_id, end_time=start_ms + 1_000 * lasted_s)
    client.set_tag(run_id, KEY, record.key())
    return run_id
