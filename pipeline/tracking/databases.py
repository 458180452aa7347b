"""Where runs are published: a sqlite file or PostgreSQL server, a place for files, an experiment.

In: the address and the place from conf/tracking. Out: a `Database`, whose lock one publisher holds
at a time, and the id of the experiment that runs are published to. MLflow fixes the folder of an
experiment's files when it is made, so one whose folder has moved is put aside for a new one.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from filelock import FileLock

from pipeline.core import remote
from pipeline.core.errors import ArtifactError, ConfigError, needed
from pipeline.tracking import served

if TYPE_CHECKING:
    from mlflow import MlflowClient
    from mlflow.entities import Experiment
    from sqlalchemy import URL

KEY = "yearloc.key"  # the tag of a run that was published here

WAIT_S = 10  # for a server to take a connection
# The number of the advisory lock that publishers hold: "yearloc" in ASCII. Each database has locks
# of its own, so it holds back publishers to the same database alone.
LOCK = 0x7965_6172_6C6F_63
EXPECTED = (
    "a sqlite file or postgresql://USER:PASSWORD@HOST/NAME; in a password, @ is %40 and / is %2F"
)


@dataclass(frozen=True)
class Database:
    """A tracking database that MLflow can open."""

    uri: str  # as SQLAlchemy takes it; it may hold a password, so it is neither shown nor stored
    files: str  # URI of the folder or bucket of the files of new experiments
    shared: bool  # a server's, which others may publish to from elsewhere

    @property
    def path(self) -> Path | None:
        """The sqlite file; None for a server."""
        return None if self.shared else Path(self.uri.removeprefix("sqlite:///"))

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Hold the database's lock for the block, so that no other process publishes to it.

        Raises ConfigError if a server does not answer in WAIT_S, or it or the object store fails
        before the block ends.
        """
        if self.path:
            with FileLock(f"{self.path}.lock"), _failures_as_config_errors(str(self.path)):
                yield
            return
        from sqlalchemy import NullPool, create_engine, make_url, text
        from sqlalchemy.exc import OperationalError

        settings = {"connect_timeout": WAIT_S, "application_name": "yearloc publish"}
        try:
            with needed("postgres", "13 MB"):
                engine = create_engine(
                    self.uri,
                    poolclass=NullPool,
                    isolation_level="AUTOCOMMIT",
                    connect_args=settings,
                )
                connection = engine.connect()
        except OperationalError as error:
            reason = str(error.orig).partition("\n")[0]
            raise ConfigError(
                f"tracking.database={shown(make_url(self.uri))}: cannot be opened: {reason}"
            ) from None
        # the server lets the lock go with the connection, however that ends
        with connection, _failures_as_config_errors(shown(make_url(self.uri))):
            connection.execute(text("select pg_advisory_lock(:key)"), {"key": LOCK})
            yield


@contextmanager
def _failures_as_config_errors(place: str) -> Iterator[None]:
    """Convert failures of the database or object store in the block into a ConfigError."""
    from mlflow.exceptions import MlflowException

    try:
        yield
    except Exception as error:
        package = type(error).__module__.partition(".")[0]
        unavailable = (
            isinstance(error, MlflowException) and error.error_code == "TEMPORARILY_UNAVAILABLE"
        )
        if not unavailable and package not in ("boto3", "botocore", "sqlalchemy"):
            raise
        reason = next((line.strip() for line in str(error).splitlines() if line.strip()), package)
        raise ConfigError(
            f"tracking.database={place}: failed under way: {reason}; publish again, and whole runs "
            "stay"
        ) from error


def shown(url: "URL") -> str:
    """An address without its password, which may stand in the query too."""
    return url.set(query={}).render_as_string(hide_password=True)


def database(place: str | Path, files: str = "") -> Database:
    """The database at a path or postgresql:// address, with its files in a folder or s3://BUCKET/.

    If `files` is empty, files go to `mlruns` beside a sqlite file; a server needs a place for them.
    Raises ConfigError for another kind of address, or a bucket that does not answer.
    """
    if "://" not in str(place):
        path = Path(place).absolute()
        path.parent.mkdir(parents=True, exist_ok=True)
        return Database(f"sqlite:///{path}", _folder(files or path.parent / "mlruns"), shared=False)
    url = _server(str(place))
    if not files:
        raise ConfigError(
            f"tracking.artifacts: {shown(url)} needs a place for files, such as s3://BUCKET/mlflow"
        )
    return Database(url.render_as_string(hide_password=False), _folder(files), shared=True)


def _server(address: str) -> "URL":
    """Parse a postgresql:// address."""
    from sqlalchemy import make_url
    from sqlalchemy.exc import ArgumentError

    try:
        url = make_url(address)
    # an address that cannot be read is not shown: any part of it may belong to the password
    except (ArgumentError, ValueError):
        raise ConfigError(f"tracking.database: expected {EXPECTED}") from None
    if url.drivername != "postgresql" or not url.host or "@" in url.host:
        raise ConfigError(f"tracking.database: expected {EXPECTED}")
    return url.set(drivername="postgresql+psycopg")


def _folder(files: str | Path) -> str:
    """The URI of a folder or bucket; raises ConfigError for a bucket that does not answer."""
    if not remote.is_remote(files):
        return Path(files).absolute().as_uri()
    bucket = str(files).split("/")[2]
    try:
        remote.look(f"{remote.S3}{bucket}")
    except ArtifactError as error:
        raise ConfigError(f"tracking.artifacts: {error}") from None
    return str(files).rstrip("/")


def find_experiment(client: "MlflowClient", name: str, database: Database) -> tuple[str, str]:
    """The id of the experiment of this name whose files go where the database says, and `aside`.

    `aside` is the new name of an older experiment of this name whose files went to another folder,
    else empty. Raises ConfigError for such an experiment in a server's database: it may belong to
    somebody else, who would put ours aside in turn.
    """
    aside = ""
    if experiment := client.get_experiment_by_name(name):
        has_moved = experiment.artifact_location != database.files
        if has_moved and database.shared:
            raise ConfigError(
                f"tracking.artifacts={database.files}: {name} keeps its files at "
                f"{experiment.artifact_location}; say that"
            )
        if experiment.lifecycle_stage == "deleted":
            client.restore_experiment(experiment.experiment_id)
        if not has_moved:
            return str(experiment.experiment_id), ""
        aside = _put_aside(client, experiment)
    return str(client.create_experiment(name, artifact_location=database.files)), aside


def _put_aside(client: "MlflowClient", experiment: "Experiment") -> str:
    """Rename an experiment, delete its runs that were published here, and return its new name."""
    # its files are left alone, since another copy of the project may show them
    aside = f"{experiment.name}, folder moved ({experiment.experiment_id})"
    client.rename_experiment(experiment.experiment_id, aside)
    runs = list(served.all_results(client.search_runs, experiment.experiment_id))
    for models in served.models_by_run(client, experiment.experiment_id).values():
        for model in models:
            client.delete_logged_model(model.model_id)
    for run in runs:
        if KEY in run.data.tags:
            client.delete_run(run.info.run_id)
    if all(KEY in run.data.tags for run in runs):
        client.delete_experiment(experiment.experiment_id)
    return aside
