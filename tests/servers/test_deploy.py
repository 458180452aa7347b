"""deploy/: what its files promise, by linters and by hand; and its commands, run here without
Docker until they are healthy."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest
import yaml

from pipeline.core.compute import Compute
from tests.servers.conftest import ObjectStore, Postgres, free_port, wait

ROOT = Path(__file__).parents[2]
COMPOSE = ROOT / "deploy/compose.yaml"
SERVICES: dict[str, Any] = yaml.safe_load(COMPOSE.read_text())["services"]
BIN = Path(sys.executable).parent


def test_every_port_is_on_this_machine_alone_and_every_service_says_whether_it_is_healthy() -> None:
    assert {*SERVICES} == {"postgres", "objects", "bucket", "mlflow", "scheduler", "worker"}
    assert not [
        port
        for one in SERVICES.values()
        for port in one.get("ports", ())
        if not port.startswith("127.0.0.1:")
    ]
    assert not [name for name, one in SERVICES.items() if "healthcheck" not in one]
    assert "network_mode" not in COMPOSE.read_text()


def test_images_have_versions_and_ours_is_the_project_s() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert {one["image"].partition(":")[2] for one in SERVICES.values() if "build" in one} == {
        version
    }
    docker = (ROOT / "deploy/Dockerfile").read_text()
    tags = [one["image"].partition(":")[2] for one in SERVICES.values()]
    assert all(re.search(r"\d+\.\d+|\d{4}-\d\d-\d\d", tag) for tag in tags)
    assert re.search(r"^ARG PYTHON=3\.\d+\.\d+$", docker, re.MULTILINE)
    assert re.findall(r"^FROM python:(\S+)", docker, re.MULTILINE) == [
        "${PYTHON}-bookworm",
        *["${PYTHON}-slim-bookworm"] * 2,
    ]
    torch = next(
        line
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if line.startswith("torch==")
    )
    assert torch in docker
    assert docker.rpartition("FROM ")[2].count("USER 1000") == 1  # the last stage is nobody's root


def test_keys_and_passwords_come_from_the_environment_and_have_no_defaults() -> None:
    given = [pair for one in SERVICES.values() for pair in one.get("environment", {}).items()]
    secret = [value for name, value in given if re.search("PASSWORD|KEY|_ROOT_USER", name)]
    assert len(secret) == 8  # postgres 1, objects 2, bucket 2, mlflow 3
    assert [value for value in secret if not re.fullmatch(r"\$\{[A-Z_]+:\?\}", value)] == []
    assert not re.search(r"://\w+:\w+@", COMPOSE.read_text())


def test_the_dev_container_builds_the_stage_that_there_is() -> None:
    conf = json.loads((ROOT / ".devcontainer/devcontainer.json").read_text())
    stage = conf["build"]["target"]
    assert f"AS {stage}\n" in (ROOT / ".devcontainer" / conf["build"]["dockerfile"]).read_text()


@pytest.mark.parametrize(
    "command",
    [
        ("hadolint", "--failure-threshold=info", "deploy/Dockerfile"),
        ("check-jsonschema", "--builtin-schema", "vendor.compose-spec", "deploy/compose.yaml"),
    ],
    ids=lambda words: words[0],
)
def test_linters_find_nothing(command: tuple[str, ...]) -> None:
    if not (program := shutil.which(command[0], path=f"{BIN}{os.pathsep}{os.environ['PATH']}")):
        pytest.skip(f"no {command[0]}: `make test-servers` installs it")
    done = subprocess.run([program, *command[1:]], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


class Here:
    """The services of ours as processes of this machine, on ports that are free, with the servers
    of these tests."""

    def __init__(self, postgres: Postgres, store: ObjectStore, folder: Path) -> None:
        self.ports = {port: str(free_port()) for port in ("5000", "8786", "8787", "8788")}
        self.given = {**store.env, "PGPASSWORD": postgres.password, "YEARLOC": str(ROOT)}
        self.hosts = {
            "http://objects:9000": store.endpoint,
            "postgres:5432": f"127.0.0.1:{postgres.port}",
            "0.0.0.0": "127.0.0.1",
        }
        self.folder = folder

    def said(self, text: str) -> str:
        text = re.sub(r"\$\{(\w+):\?\}", lambda found: self.given[found[1]], text)
        for old, new in self.hosts.items():
            text = text.replace(old, new)
        text = re.sub(r"^:(?=\d)|scheduler:", "127.0.0.1:", text)
        return re.sub(r"\b(5000|878\d)\b", lambda found: self.ports[found[1]], text)

    def command(self, words: list[str]) -> list[str]:
        return [sys.executable if word == "python" else self.said(word) for word in words]

    def env(self, name: str) -> dict[str, str]:
        own = {
            key: self.said(value) for key, value in SERVICES[name].get("environment", {}).items()
        }
        return {
            "PATH": os.environ["PATH"],
            "HOME": str(self.folder),
            "PYTHONPATH": str(ROOT),
            **own,
        }

    def healthy(self, name: str) -> bool:
        check = self.command(SERVICES[name]["healthcheck"]["test"][1:])
        return subprocess.run(check, env=self.env(name), capture_output=True).returncode == 0

    @contextmanager
    def up(self, name: str) -> Iterator[None]:
        folder = self.said(SERVICES[name].get("working_dir", str(self.folder)))
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        process = psutil.Popen(
            self.command(SERVICES[name]["command"]), cwd=folder, env=self.env(name), **quiet
        )
        try:
            wait(lambda: self.healthy(name), name)
            yield
        finally:
            for one in [*process.children(recursive=True), process]:
                one.terminate()
            process.wait()


@pytest.fixture
def here(postgres: Postgres, object_store: ObjectStore, tmp_path: Path) -> Here:
    return Here(postgres, object_store, tmp_path)


def test_the_bucket_is_made_once_and_mlflow_answers(here: Here, postgres: Postgres) -> None:
    postgres.database("mlflow")
    for _ in range(2):
        subprocess.run(
            here.command(SERVICES["bucket"]["command"]), env=here.env("bucket"), check=True
        )
    with here.up("mlflow"):
        assert here.healthy("mlflow")
    assert not here.healthy("mlflow")


def test_a_stage_computes_on_the_workers(here: Here, monkeypatch: pytest.MonkeyPatch) -> None:
    with here.up("scheduler"), here.up("worker"):
        monkeypatch.setenv("DASK_SCHEDULER_ADDRESS", here.said("tcp://scheduler:8786"))
        found = list(Compute("cluster").each(lambda number: (number * number, os.getpid()), [2, 3]))
    assert [square for square, _ in found] == [4, 9]
    assert os.getpid() not in {process for _, process in found}
