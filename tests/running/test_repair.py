"""What a fresh clone lacks and what a kill leaves of DVC's own files."""

import json
import os
from pathlib import Path

import pytest
import yaml

from pipeline.running.repair import add_missing_locks, repair


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A project with a root file and one stage, whose locks are links into .dvc/locks."""
    for folder, link in (("", ".dvc/locks/root.lock"), ("dag/train", "../../.dvc/locks/train.lock")):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        (tmp_path / folder / "dvc.yaml").write_text("stages: {}\n")
        (tmp_path / folder / "dvc.lock").symlink_to(link)
    return tmp_path


def test_a_fresh_clone_gets_the_lock_files_that_its_links_name(clone: Path) -> None:
    assert repair(clone) == []
    assert [yaml.safe_load((clone / name / "dvc.lock").read_text()) for name in ("", "dag/train")] == [{"schema": "2.0"}] * 2


def test_missing_locks_alone_are_written_where_only_they_are_asked_for(clone: Path) -> None:
    (clone / ".dvc/locks").mkdir(parents=True)
    (clone / ".dvc/locks/train.lock").write_text("torn: {")
    add_missing_locks(clone)
    assert yaml.safe_load((clone / "dvc.lock").read_text()) == {"schema": "2.0"}
    assert (clone / "dag/train/dvc.lock").read_text() == "torn: {"


def test_a_torn_lock_is_emptied_and_stays_a_link(clone: Path) -> None:
    repair(clone)
    lock = clone / "dag/train/dvc.lock"
    lock.write_text("schema: '2.0'\nstages:\n  a: {cmd: 'x")
    assert repair(clone) == [lock]
    assert lock.is_symlink()
    assert yaml.safe_load(lock.read_text()) == {"schema": "2.0"}


def test_a_whole_lock_is_left_alone(clone: Path) -> None:
    repair(clone)
    (clone / "dvc.lock").write_text("schema: '2.0'\nstages: {a: {cmd: x}}\n")
    assert repair(clone) == []
    assert "a" in (clone / "dvc.lock").read_text()


@pytest.mark.parametrize(("pid", "kept"), [(os.getpid(), True), (2**22 + 1, False)], ids=["alive", "dead"])
def test_the_table_of_locks_goes_once_its_holders_are_dead(clone: Path, pid: int, kept: bool) -> None:
    table = clone / ".dvc/tmp/rwlock"
    table.parent.mkdir(parents=True)
    table.write_text(json.dumps({"x": {"write": {"pid": pid, "cmd": "dvc repro"}}}))
    repair(clone)
    assert table.exists() == kept
