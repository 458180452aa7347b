"""Artifacts in an object store: DVC takes them there and back, `store.read` reads them where they
are."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core import remote, store
from pipeline.core.errors import ArtifactError
from pipeline.core.schemas import Labels
from pipeline.core.store import Array, Artifact
from tests.servers.conftest import ObjectStore, free_port


@dataclass(frozen=True, eq=False)
class Things(Artifact, kind="things", version=1):
    """Points three a row."""

    points: Annotated[NDArray[np.int16], Array(("point", "xyz"), "three a row", chunk=4, shard=8)]
    grain_m: Annotated[float, "metres"]


POINTS = np.arange(60, dtype=np.int16).reshape(20, 3)
MODEL = {"weights": np.arange(6, dtype=np.float32)}


def write(folder: Path) -> None:
    store.write(folder / "a.zarr", Things(POINTS, 0.005))
    store.write_model(folder / "a.zarr.zip", MODEL, {"seed": 1})


def digests(folder: Path) -> dict[str, str]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {
        path.relative_to(folder).as_posix(): sha256(path.read_bytes()).hexdigest() for path in files
    }


def upload(folder: Path, url: str) -> None:
    import s3fs

    s3fs.S3FileSystem(skip_instance_cache=True).put(str(folder), url, recursive=True)


def dvc(folder: Path, env: Mapping[str, str], *words: str) -> str:
    command = [sys.executable, "-m", "dvc", *words]
    done = subprocess.run(
        command, cwd=folder, env={**os.environ, **env}, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_what_dvc_pushed_comes_back_with_the_same_bytes(
    object_store: ObjectStore, tmp_path: Path
) -> None:
    project = tmp_path / "project"
    env = object_store.env
    (project / "artifacts").mkdir(parents=True)
    write(project / "artifacts")
    before = digests(project / "artifacts")
    assert {"a.zarr.zip", "a.zarr/zarr.json", "a.zarr/points/c.2.0"} <= before.keys()
    dvc(project, env, "init", "--no-scm")
    dvc(project, env, "remote", "add", "-d", "shelf", f"{object_store.bucket('shelf')}/yearloc")
    dvc(project, env, "add", "artifacts")
    assert "pushed" in dvc(project, env, "push")
    for folder in ("artifacts", ".dvc/cache"):
        shutil.rmtree(project / folder)
    dvc(project, env, "pull")
    assert digests(project / "artifacts") == before
    assert "Everything is up to date" in dvc(project, env, "push")
    stored = (project / ".dvc/config").read_text()
    assert not [value for value in env.values() if value in stored]  # neither keys nor address


def test_an_artifact_is_read_where_it_lies(keys: ObjectStore, tmp_path: Path) -> None:
    write(tmp_path)
    url = f"{keys.bucket('read')}/campus/a.zarr"
    upload(tmp_path / "a.zarr", url)
    there = store.read(url, Things)
    here = store.read(tmp_path / "a.zarr", Things)
    np.testing.assert_array_equal(there.load("points"), here.load("points"))
    np.testing.assert_array_equal(there["points"][9:11], POINTS[9:11])  # of two shards
    assert there.attrs == here.attrs
    assert there.path == url


def test_of_another_kind_or_torn_is_said_as_of_a_local_one(
    keys: ObjectStore, tmp_path: Path
) -> None:
    write(tmp_path)
    bucket = keys.bucket("torn")
    upload(tmp_path / "a.zarr", f"{bucket}/a.zarr")
    with pytest.raises(ArtifactError, match="expected labels version 1, found things version 1"):
        store.read(f"{bucket}/a.zarr", Labels)
    (tmp_path / "a.zarr/zarr.json").write_text('{"zarr_fo')
    upload(tmp_path / "a.zarr/zarr.json", f"{bucket}/b.zarr/zarr.json")
    with pytest.raises(ArtifactError, match="not a whole zarr group"):
        store.read(f"{bucket}/b.zarr", Things)


def test_no_such_key_and_no_such_bucket_are_reported_apart(keys: ObjectStore) -> None:
    bucket = keys.bucket("empty")
    with pytest.raises(
        ArtifactError, match=r"^s3://empty/a\.zarr/zarr\.json: not in the object store \(empty/a"
    ):
        store.read(f"{bucket}/a.zarr", Things)
    with pytest.raises(
        ArtifactError, match=r"not in the object store \(The specified bucket does not exist\)$"
    ):
        store.read("s3://nowhere/a.zarr", Things)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"AWS_SECRET_ACCESS_KEY": "not-it"}, "Forbidden"),
        ({"AWS_ACCESS_KEY_ID": "nobody"}, "Forbidden"),
        ({"AWS_ACCESS_KEY_ID": "", "AWS_SECRET_ACCESS_KEY": ""}, "Unable to locate credentials"),
    ],
)
def test_wrong_keys_are_reported_and_not_shown(
    keys: ObjectStore, monkeypatch: pytest.MonkeyPatch, changed: dict[str, str], reason: str
) -> None:
    for name, value in changed.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(
        ArtifactError, match=rf"refuses these keys \({reason}\); set AWS_ACCESS_KEY_ID"
    ) as error:
        store.read("s3://read/campus/a.zarr", Things)
    secrets = {*keys.env.values(), *changed.values()} - {"", "us-east-1"}
    assert not [secret for secret in secrets if secret in str(error.value)]


@pytest.mark.parametrize("address", ["http://127.0.0.1:{port}", "no address"])
def test_a_store_that_does_not_answer_is_reported(
    keys: ObjectStore, monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", address.format(port=free_port()))
    with pytest.raises(
        ArtifactError, match=r"the object store does not answer \(.*\); set AWS_ENDPOINT_URL$"
    ):
        remote.look("s3://read/campus/a.zarr")
