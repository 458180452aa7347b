"""Addresses of MLflow's database are read without asking a server, and no password is shown."""

import sys
from pathlib import Path

import pytest

from pipeline.core.errors import ConfigError, NotInstalledError
from pipeline.tracking.databases import database
from stages.sweep.__main__ import split_tracking_words, tracking_of

SERVER = "postgresql://me:secret@127.0.0.1:5432/mlflow"


def test_a_sqlite_file_has_its_files_beside_it_or_where_they_are_given(tmp_path: Path) -> None:
    path = tmp_path / "new" / "mlflow.db"
    assert database(path).uri == f"sqlite:///{path}"
    assert path.parent.is_dir()
    assert database(str(path)).files == (path.parent / "mlruns").as_uri()
    assert database(path, str(tmp_path / "files")).files == (tmp_path / "files").as_uri()


def test_a_server_has_its_files_where_they_are_given(tmp_path: Path) -> None:
    found = database(SERVER, str(tmp_path))
    assert (found.uri, found.files) == (
        "postgresql+psycopg://me:secret@127.0.0.1:5432/mlflow",
        tmp_path.as_uri(),
    )


@pytest.mark.parametrize(
    "address", [SERVER, "postgresql://me@127.0.0.1:5432/mlflow?password=secret"]
)
def test_a_server_without_a_place_for_files_is_refused_and_its_password_not_shown(
    address: str,
) -> None:
    with pytest.raises(
        ConfigError, match=r"^tracking\.artifacts: \S+@127.0.0.1:5432/mlflow needs a place"
    ) as error:
        database(address)
    assert "secret" not in str(error.value)


@pytest.mark.parametrize(
    "address",
    [
        "postgresql://me:half@secret@host/mlflow",  # the @ is not written %40
        "postgresql://me:se/cret@host:secret/mlflow",
        "mysql://me:secret@host/mlflow",
        "postgresql+psycopg2://me:secret@host/mlflow",
        "postgresql:///secret",
        "://secret",
    ],
)
def test_of_an_address_that_is_not_understood_nothing_is_shown(
    address: str, tmp_path: Path
) -> None:
    with pytest.raises(
        ConfigError, match=r"^tracking\.database: expected a sqlite file or postgresql://"
    ) as error:
        database(address, str(tmp_path))
    assert "secret" not in str(error.value)


def test_what_is_not_installed_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("psycopg", "s3fs"):
        monkeypatch.setitem(sys.modules, name, None)
    with (
        pytest.raises(
            NotInstalledError, match=r"^psycopg: not installed; `pip install 'yearloc\[postgres\]'`"
        ),
        database(SERVER, str(tmp_path)).alone(),
    ):
        pass
    with pytest.raises(
        NotInstalledError, match=r"^s3fs: not installed; `pip install 'yearloc\[s3\]'`"
    ):
        database(SERVER, "s3://bucket/mlflow")


def test_a_sweep_s_jobs_are_not_reported_of_the_database() -> None:
    """Hydra writes their words into the folder of the sweep."""
    words = [
        f"tracking.database='{SERVER}'",
        "-m",
        "grid.cell_m=5,10",
        "+tracking.artifacts=s3://bucket/mlflow",
    ]
    given, about = split_tracking_words(words)
    assert given == ["-m", "grid.cell_m=5,10"]
    tracking = tracking_of([word.removeprefix("+") for word in about])
    assert (tracking.database, tracking.artifacts) == (SERVER, "s3://bucket/mlflow")
    assert tracking_of([]).database == "mlflow.db"


@pytest.mark.parametrize(
    "word", ["tracking.databse=secret", "tracking.database='secret", "tracking=secret"]
)
def test_a_word_about_tracking_that_is_not_understood_is_not_shown(word: str) -> None:
    with pytest.raises(ConfigError, match=r"^tracking: not understood") as error:
        tracking_of([word])
    assert "secret" not in str(error.value)
