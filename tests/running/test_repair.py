"""DVC's own files are repaired after a kill, and moved from where an earlier version kept them."""

import json
import os
from pathlib import Path

import pytest
import yaml

from pipeline.running.repair import repair

WHOLE = "schema: '2.0'\nstages: {a: {cmd: x}}\n"


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
