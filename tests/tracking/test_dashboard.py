"""The server of `make dashboard`, started as the Makefile does."""

import os
import shlex
import socket
import subprocess
import time
from pathlib import Path

import psutil

from tests.clone import BIN, ROOT
from tests.listening import addresses


def recipe() -> list[str]:
    """The words of the last command of the target."""
    shown = subprocess.run(
        ["make", "--dry-run", "dashboard"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    return shlex.split(shown[shown.rindex("mlflow server") :].replace("\\\n", " "))


def test_mlflow_is_reached_from_this_machine_alone(tmp_path: Path) -> None:
    words = recipe()
    with socket.create_server(("127.0.0.1", 0)) as free:
        words[words.index("--port") + 1] = str(free.getsockname()[1])
    env = {
        **os.environ,
        "PATH": f"{BIN}:{os.environ['PATH']}",
        "MLFLOW_BACKEND_STORE_URI": f"sqlite:///{tmp_path}/mlflow.db",
    }
    silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    server = subprocess.Popen(
        words[: words.index(">mlflow.log")], cwd=tmp_path, env=env, start_new_session=True, **silent
    )
    process = psutil.Process(server.pid)
    try:
        for _ in range(600):
            if found := addresses(process):
                break
            assert server.poll() is None
            time.sleep(0.2)
        assert found == {"127.0.0.1"}
    finally:
        for one in [*process.children(recursive=True), process]:
            one.kill()
        server.wait()
