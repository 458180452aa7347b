"""DVC's locks tell whether it works in a project."""

import fcntl
import json
import os
from pathlib import Path

import pytest

from pipeline.core.errors import ConfigError
from pipeline.running.at_work import LOCK, TABLE, refuse_at_work


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project in which DVC has worked before, and does not now."""
    (tmp_path / ".dvc/tmp").mkdir(parents=True)
    (tmp_path / TABLE).write_text("{}")
    (tmp_path / LOCK).write_text(f" {os.getpid()}\n")
    return tmp_path


def test_a_project_in_which_dvc_does_not_work_is_not_refused(project: Path) -> None:
    refuse_at_work(project)
    refuse_at_work(project / "never/used")


def test_dvc_holds_its_lock_between_stages(project: Path) -> None:
    with (project / LOCK).open("a") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(ConfigError, match="works in this folder"):
            refuse_at_work(project)
    refuse_at_work(project)


def test_dvc_is_in_its_table_while_a_stage_runs(project: Path) -> None:
    (project / TABLE).write_text(
        json.dumps({"write": {"artifacts/x": {"pid": os.getpid(), "cmd": "dvc repro"}}})
    )
    with pytest.raises(ConfigError, match="works in this folder"):
        refuse_at_work(project)


def test_a_process_younger_than_the_table_is_not_the_one_that_it_names(project: Path) -> None:
    (project / TABLE).write_text(
        json.dumps({"read": {"artifacts/x": [{"pid": os.getpid(), "cmd": "dvc repro"}]}})
    )
    os.utime(project / TABLE, (1e9, 1e9))  # 2001
    refuse_at_work(project)


def test_a_half_written_table_names_no_process(project: Path) -> None:
    (project / TABLE).write_text('{"write": {"artifacts')
    refuse_at_work(project)
