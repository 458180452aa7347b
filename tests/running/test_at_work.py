"""DVC's locks show whether it works in a project, and its files are repaired after a kill."""

import fcntl
import json
import os
from pathlib import Path

import pytest
import yaml

from pipeline.core.errors import ConfigError
from pipeline.running.at_work import LOCK, TABLE, refuse_at_work, repair

WHOLE = "schema: '2.0'\nstages: {a: {cmd: x}}\n"


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


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A project with a root file and one stage, each with a whole lock file."""
    for folder in ("", "dag/train"):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        (tmp_path / folder / "dvc.yaml").write_text("stages: {}\n")
        (tmp_path / folder / "dvc.lock").write_text(WHOLE)
    return tmp_path


def test_a_half_written_lock_is_emptied_and_a_whole_one_stays(clone: Path) -> None:
    half_written = clone / "dag/train/dvc.lock"
    half_written.write_text("schema: '2.0'\nstages:\n  a: {cmd: 'x")
    assert repair(clone) == [half_written]
    assert yaml.safe_load(half_written.read_text()) == {"schema": "2.0"}
    assert (clone / "dvc.lock").read_text() == WHOLE


def test_a_fresh_clone_without_lock_files_needs_no_repair(clone: Path) -> None:
    for lock in clone.rglob("dvc.lock"):
        lock.unlink()
    assert repair(clone) == []
    assert not list(clone.rglob("dvc.lock"))


@pytest.mark.parametrize("links", [True, False], ids=["links still there", "links removed by git"])
def test_lock_files_of_an_old_clone_move_beside_their_stages(clone: Path, links: bool) -> None:
    """An old clone had them in .dvc/locks, and links to them beside the stages."""
    (clone / ".dvc/locks").mkdir(parents=True)
    (clone / ".dvc/locks/.gitignore").write_text("*.lock")
    for folder, name in ((clone, "root"), (clone / "dag/train", "train")):
        (folder / "dvc.lock").replace(clone / f".dvc/locks/{name}.lock")
        if links:
            (folder / "dvc.lock").symlink_to(clone / f".dvc/locks/{name}.lock")
    repair(clone)
    for folder in (clone, clone / "dag/train"):
        assert not (folder / "dvc.lock").is_symlink()
        assert (folder / "dvc.lock").read_text() == WHOLE
    assert not (clone / ".dvc/locks").exists()


def test_a_lock_file_that_is_there_already_is_not_replaced_by_an_old_one(clone: Path) -> None:
    (clone / ".dvc/locks").mkdir(parents=True)
    (clone / ".dvc/locks/train.lock").write_text("schema: '2.0'\n")
    repair(clone)
    assert (clone / "dag/train/dvc.lock").read_text() == WHOLE


@pytest.mark.parametrize(
    ("pid", "kept"), [(os.getpid(), True), (2**22 + 1, False)], ids=["alive", "dead"]
)
def test_the_table_of_running_processes_is_removed_if_none_of_them_lives(
    clone: Path, pid: int, kept: bool
) -> None:
    table = clone / ".dvc/tmp/rwlock"
    table.parent.mkdir(parents=True)
    table.write_text(json.dumps({"x": {"write": {"pid": pid, "cmd": "dvc repro"}}}))
    repair(clone)
    assert table.exists() == kept
