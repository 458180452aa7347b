"""`make demo` leaves `dvc repro` out only if no file is other than it was."""

import os
import shutil
from pathlib import Path

import pytest

from pipeline.cli import main
from pipeline.running.unchanged import STATE, remember, unchanged

FILES = ("conf/a.yaml", "pipeline/b/c.py", "stages/d.py", "dag/e/dvc.yaml", "dvc.yaml", ".dvc/locks/root.lock", ".dvc/config")
REPORT = "artifacts/report/campus/report.md"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """One that `dvc repro` has built."""
    for name in (*FILES, REPORT):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("1")
    assert not unchanged(tmp_path)
    assert remember(tmp_path)
    return tmp_path


def test_nothing_moved(project: Path) -> None:
    (project / "pipeline/__pycache__").mkdir()
    (project / "pipeline/__pycache__/b.pyc").write_text("compiled")
    (project / ".telemetry").mkdir()
    assert unchanged(project)


@pytest.mark.parametrize("name", [*FILES, REPORT])
def test_an_edit_is_seen_though_size_and_time_are_the_same(project: Path, name: str) -> None:
    before = (project / name).stat()
    (project / name).write_text("2")
    os.utime(project / name, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert not unchanged(project)
    assert not unchanged(project)  # until `dvc repro` has ended well


@pytest.mark.parametrize("name", [*FILES, REPORT])
def test_a_deleted_file_is_seen(project: Path, name: str) -> None:
    (project / name).unlink()
    assert not unchanged(project)


def test_a_deleted_folder_and_a_new_file_are_seen(project: Path) -> None:
    shutil.rmtree(project / "artifacts/report")
    assert not unchanged(project)
    assert remember(project)
    (project / "conf/new.yaml").write_text("1")
    assert not unchanged(project)


def test_another_file_in_its_place_is_seen(project: Path) -> None:
    shutil.copy2(project / REPORT, project / "copy")
    os.replace(project / "copy", project / REPORT)
    assert not unchanged(project)


def test_a_source_that_changed_during_dvc_repro_is_built_next_time(project: Path) -> None:
    (project / "conf/a.yaml").write_text("2")
    assert not unchanged(project)
    (project / "conf/a.yaml").write_text("3")  # after the stage had read it, maybe
    assert not remember(project)
    assert not unchanged(project)


@pytest.mark.parametrize("state", ["", "{", "[1]", "null", "{}"])
def test_a_torn_state_is_none(project: Path, state: str) -> None:
    (project / STATE).write_text(state)
    assert not remember(project)
    assert not unchanged(project)


def test_the_command_ends_in_one_where_a_file_changed(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(project)
    main(["unchanged"])
    (project / REPORT).unlink()
    with pytest.raises(SystemExit) as ended:
        main(["unchanged"])
    assert ended.value.code == 1
    main(["unchanged", "--remember"])
    main(["unchanged"])
