"""Real servers, on 127.0.0.1 alone: PostgreSQL of the system, and moto's S3 server.

`make test-servers` runs what needs them.
"""

import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import pytest

PATIENCE_S = 30
USER = "yearloc"
FOUND = sorted(Path("/usr/lib/postgresql").glob("*/bin"))


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def wait(ready: Callable[[], bool], what: str) -> None:
    for _ in range(10 * PATIENCE_S):
        if ready():
            return
        time.sleep(0.1)
    raise TimeoutError(f"{what} does not answer within {PATIENCE_S} s")


def listening(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0


@dataclass(frozen=True)
class Postgres:
    port: int
    password: str

    def url(self, name: str = USER, password: str | None = None, user: str = USER) -> str:
        return f"postgresql://{user}:{password or self.password}@127.0.0.1:{self.port}/{name}"

    def database(self, name: str) -> str:
        """The address of a new database."""
        import psycopg

        with psycopg.connect(self.url("postgres"), autocommit=True) as connection:
            connection.execute(f'create database "{name}"')  # type: ignore[call-overload]
        return self.url(name)


@pytest.fixture(scope="session")
def postgres() -> Iterator[Postgres]:
    """A cluster of its own in a folder of its own; root may not start one, so then the system's
    user nobody does."""
    if not find_spec("psycopg"):
        pytest.skip("no psycopg: `make test-servers` installs it")
    bin_folder = FOUND[-1] if FOUND else Path(shutil.which("initdb") or "/").parent
    if not (bin_folder / "initdb").is_file():
        pytest.skip("no PostgreSQL server on this machine: Debian's package is `postgresql`")
    folder = Path(tempfile.mkdtemp(prefix="yearloc-postgres-"))
    who = {"user": "nobody", "extra_groups": []} if os.getuid() == 0 else {}
    server = Postgres(free_port(), secrets.token_urlsafe(12))
    (folder / "password").write_text(server.password)
    if who:
        for path in (folder, folder / "password"):
            shutil.chown(path, "nobody")
    data = folder / "data"
    initdb = [
        bin_folder / "initdb",
        "-D",
        data,
        "-U",
        USER,
        "-A",
        "scram-sha-256",
        f"--pwfile={folder / 'password'}",
        "-N",
    ]
    subprocess.run(
        [*initdb, "-E", "UTF8", "--locale=C"], check=True, capture_output=True, cwd=folder, **who
    )
    settings = {
        "port": server.port,
        "listen_addresses": "127.0.0.1",
        "unix_socket_directories": "",
        "fsync": "off",
    }
    words = [word for key, value in settings.items() for word in ("-c", f"{key}={value}")]
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(
            [bin_folder / "postgres", "-D", data, *words], stdout=log, stderr=log, cwd=folder, **who
        )
    try:
        wait(lambda: listening(server.port), "PostgreSQL")
        yield server
    finally:
        process.send_signal(signal.SIGINT)  # at SIGTERM it would wait for MLflow's connections
        process.wait(PATIENCE_S)
        shutil.rmtree(folder)


@dataclass(frozen=True)
class ObjectStore:
    """A server that takes one pair of keys and no other."""

    endpoint: str
    env: Mapping[str, str]
    """What a client needs in its environment."""

    def bucket(self, name: str) -> str:
        """The address of a new bucket."""
        import boto3

        keys = {
            "aws_access_key_id": self.env["AWS_ACCESS_KEY_ID"],
            "aws_secret_access_key": self.env["AWS_SECRET_ACCESS_KEY"],
        }
        client = boto3.client("s3", endpoint_url=self.endpoint, region_name="us-east-1", **keys)
        client.create_bucket(Bucket=name)
        client.close()
        return f"s3://{name}"


EVERYTHING = (
    '{"Version": "2012-10-17", "Statement": [{"Effect": "Allow", "Action": "*", "Resource": "*"}]}'
)


@pytest.fixture(scope="session")
def object_store() -> Iterator[ObjectStore]:
    if not (find_spec("moto") and find_spec("flask") and find_spec("s3fs")):
        pytest.skip("no moto or s3fs: `make test-servers` installs them")
    import boto3

    port = free_port()
    endpoint = f"http://127.0.0.1:{port}"
    first = {
        "INITIAL_NO_AUTH_ACTION_COUNT": "3"
    }  # those that make the user; from then on moto checks keys and signatures
    command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    process = subprocess.Popen(
        command, env=os.environ | first, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        wait(lambda: listening(port), "moto")
        anybody = {
            "aws_access_key_id": "none",
            "aws_secret_access_key": "none",
            "region_name": "us-east-1",
        }
        iam = boto3.client("iam", endpoint_url=endpoint, **anybody)
        iam.create_user(UserName=USER)
        iam.put_user_policy(UserName=USER, PolicyName="everything", PolicyDocument=EVERYTHING)
        made = iam.create_access_key(UserName=USER)["AccessKey"]
        iam.close()
        keys = {
            "AWS_ACCESS_KEY_ID": made["AccessKeyId"],
            "AWS_SECRET_ACCESS_KEY": made["SecretAccessKey"],
        }
        yield ObjectStore(
            endpoint, {**keys, "AWS_ENDPOINT_URL": endpoint, "AWS_DEFAULT_REGION": "us-east-1"}
        )
    finally:
        process.terminate()
        process.wait(PATIENCE_S)


@pytest.fixture
def keys(object_store: ObjectStore, monkeypatch: pytest.MonkeyPatch) -> ObjectStore:
    """The object store, with its keys in this process's environment."""
    for name, value in object_store.env.items():
        monkeypatch.setenv(name, value)
    return object_store
