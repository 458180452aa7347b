"""A long list of drives is split into parts, and each part has its own dvc.yaml and dvc.lock."""

from pathlib import Path

import pytest
import yaml

from pipeline.cli.repro import count_instances
from pipeline.running.dvc_files import DvcLock, definition
from pipeline.studies import parts
from pipeline.studies.parts import split_drives, write_parts

STAGE = """\
stages:
  {0}:
    foreach: ${{lists.drives}}
    do: {{cmd: "{0} ${{key}}"}}
"""
LINES = "schema: '2.0'\nstages:\n"


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A project of two stages, with locks of the drives a to e, and parts of two."""
    monkeypatch.setattr(parts, "MOST", 2)
    (tmp_path / "dvc.yaml").write_text("stages: {report: {cmd: report}}\n")
    for stage in parts.STAGES:
        (tmp_path / f"dag/{stage}").mkdir(parents=True)
        (tmp_path / f"dag/{stage}/dvc.yaml").write_text(STAGE.format(stage))
        entries = [
            f"  {stage}@{drive}: {{cmd: {drive}, outs: [{{path: {stage}/{drive}, rate: 2e-05}}]}}\n"
            for drive in "abcde"
        ]
        (tmp_path / f"dag/{stage}/dvc.lock").write_text(LINES + "".join(entries))
    return tmp_path


def chosen(root: Path, drives: str) -> dict[str, list[str]]:
    """Choose these drives, one a letter; returns the instances that each lock file has then."""
    lists = split_drives({"drives": {drive: {} for drive in drives}, "models": {"x": {}}})
    (root / "conf").mkdir(exist_ok=True)
    (root / "conf/lists.yaml").write_text(yaml.safe_dump({"lists": lists}))
    write_parts(root, lists)
    locks = sorted(root.glob("dag/scans*/dvc.lock"))
    return {path.parent.name: list(yaml.safe_load(path.read_text())["stages"]) for path in locks}


def test_a_list_is_cut_into_parts_of_the_same_order() -> None:
    drives = {f"drive{number}": {"n": number} for number in range(2 * parts.MOST + 1)}
    lists = split_drives({"drives": drives, "models": {"x": {}}})
    assert list(lists) == ["drives", "models", "drives_2", "drives_3"]
    assert [len(lists[name]) for name in ("drives", "drives_2", "drives_3")] == [
        parts.MOST,
        parts.MOST,
        1,
    ]
    assert {**lists["drives"], **lists["drives_2"], **lists["drives_3"]} == drives
    assert split_drives({"drives": {}}) == {"drives": {}}


def test_what_is_recorded_moves_to_the_lock_file_of_its_part_and_back(root: Path) -> None:
    recorded = dict(DvcLock.read(root / "dvc.lock").stages)
    assert chosen(root, "abcde") == {
        "scans": ["scans@a", "scans@b"],
        "scans-2": ["scans@c", "scans@d"],
        "scans-3": ["scans@e"],
    }
    assert DvcLock.read(root / "dvc.lock").stages == recorded
    assert recorded["scans@a"]["outs"][0]["rate"] == 2e-05
    assert "${lists.drives_3}" in (root / "dag/scans-3/dvc.yaml").read_text()
    # x was never run, d and e are no more
    assert chosen(root, "xcab") == {"scans": ["scans@c"], "scans-2": ["scans@a", "scans@b"]}
    assert chosen(root, "ab") == {"scans": ["scans@a", "scans@b"]}
    assert sorted(path.name for path in (root / "dag").iterdir()) == ["logs", "scans"]
    assert DvcLock.read(root / "dvc.lock").stages["scans@a"] == recorded["scans@a"]


def test_a_short_list_leaves_the_lock_files_alone(root: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in root.rglob("*") if path.is_file()}
    chosen(root, "ab")
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_stages_are_counted_over_parts_and_defined_by_the_first(root: Path) -> None:
    chosen(root, "abcde")
    assert count_instances(root) == {"report": 1, "logs": 5, "scans": 5}
    assert definition(root)["stages"]["scans"]["foreach"] == "${lists.drives}"


def test_a_torn_lock_file_records_nothing_and_is_removed(root: Path) -> None:
    (root / "dag/scans/dvc.lock").write_text(LINES + "  scans@a: {cmd: [")
    write_parts(root, split_drives({"drives": {key: {} for key in "abc"}}))
    assert DvcLock.read(root / "dvc.lock").stages.keys() == {"logs@a", "logs@b", "logs@c"}
    assert not (root / "dag/scans/dvc.lock").exists()
