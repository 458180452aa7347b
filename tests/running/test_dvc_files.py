"""The lock files and definitions of the root and of dag/ are read as one."""

from pathlib import Path

import pytest
import yaml

from pipeline.running.dvc_files import DvcLock, definition, files

LOCK = """
schema: '2.0'
stages:
  labels@2012-01-15:
    cmd: python -m stages.labels
    deps:
    - path: artifacts/submaps/2012-01-15.zarr
      md5: abc.dir
    outs:
    - path: artifacts/labels/2012-01-15.zarr
      md5: def.dir
  train@sci:
    cmd: python -m stages.train
    params:
      conf/method/sci.yaml:
        rate: 2e-05
    outs:
    - path: artifacts/models/sci.zarr.zip
      md5: 123
  nothing:
    cmd: 'true'
"""


def test_a_lock_names_the_stage_that_wrote_a_file(tmp_path: Path) -> None:
    (tmp_path / "dvc.lock").write_text(LOCK)
    lock = DvcLock.read(tmp_path / "dvc.lock")
    found = lock.entry(Path("artifacts/models/sci.zarr.zip"))
    assert found is not None
    assert found.stage == "train@sci"
    assert found.params == {"conf/method/sci.yaml": {"rate": 2e-05}}
    labels = lock.entry(Path("artifacts/labels/2012-01-15.zarr/points/c.0.0"))
    assert labels is not None
    assert [(dep.path, dep.md5) for dep in labels.deps] == [
        ("artifacts/submaps/2012-01-15.zarr", "abc.dir")
    ]


@pytest.mark.parametrize(
    "text", [LOCK, "", "stages: {", "schema: '2.0'\n", "stages: [a]\n", "[]", None]
)
def test_an_unknown_file_has_no_entry(tmp_path: Path, text: str | None) -> None:
    lock = tmp_path / "dvc.lock"
    if text is not None:
        lock.write_text(text)
    assert DvcLock.read(lock).entry(Path("artifacts/models/other.zarr.zip")) is None


def test_lock_files_in_several_folders_are_read_as_one(tmp_path: Path) -> None:
    whole = yaml.safe_load(LOCK)["stages"]
    for place, names in (
        (".", ["nothing"]),
        ("dag/labels", ["labels@2012-01-15"]),
        ("dag/train", ["train@sci"]),
    ):
        (tmp_path / place).mkdir(parents=True, exist_ok=True)
        (tmp_path / place / "dvc.lock").write_text(
            yaml.safe_dump({"stages": {name: whole[name] for name in names}})
        )
    (tmp_path / "dag/views").mkdir()
    (tmp_path / "dag/views/dvc.lock").write_text("stages:\n  views: {cmd: [")  # half written
    one = tmp_path / "one.lock"
    one.write_text(LOCK)
    in_parts = DvcLock.read(tmp_path / "dvc.lock")
    assert in_parts.stages.keys() == DvcLock.read(one).stages.keys() == whole.keys()
    assert in_parts.entry(Path("artifacts/models/sci.zarr.zip")) is not None


def test_a_lock_file_that_has_changed_is_read_again(tmp_path: Path) -> None:
    lock = tmp_path / "dvc.lock"
    lock.write_text(LOCK)
    assert DvcLock.read(lock).stages
    lock.write_text("stages: {}\n")
    assert not DvcLock.read(lock).stages


def test_stages_are_those_of_all_files(tmp_path: Path) -> None:
    (tmp_path / "dag/train").mkdir(parents=True)
    (tmp_path / "dvc.yaml").write_text("stages:\n  report: {cmd: a}\n")
    (tmp_path / "dag/train/dvc.yaml").write_text("stages:\n  train: {cmd: b, wdir: ../..}\n")
    assert definition(tmp_path) == {
        "stages": {"report": {"cmd": "a"}, "train": {"cmd": "b", "wdir": "../.."}}
    }
    assert files(tmp_path / "dvc.lock") == []
