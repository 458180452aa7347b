"""The campaign of faults tells damage that is found from damage that is not."""

import random
import shutil
from pathlib import Path

import numpy as np
import pytest

from benchmarks import fault_commands, fault_words
from benchmarks.faults import ENDINGS, mutated, mutations
from pipeline.core import store
from tests.clone import ROOT
from tests.inspection.test_artifacts import write


def test_every_mutation_of_an_artifact_is_refused_or_harmless(tmp_path: Path) -> None:
    write(tmp_path / "artifacts/labels/a.zarr", "labels")
    store.write_model(tmp_path / "artifacts/train/a.zarr.zip", {"a": np.arange(9.0)}, {"k": 1})
    found = list(mutations(tmp_path, tries=60, seed=0, done=0))
    assert [one["case"] for one in found] == [*range(60)]
    assert {one["ending"] for one in found} <= {"same", "refused"}
    later = list(mutations(tmp_path, tries=60, seed=0, done=42))  # it goes on where it was cut off
    assert [(one["file"], one["ending"]) for one in later] == [
        (one["file"], one["ending"]) for one in found[42:]
    ]


def test_a_log_is_read_as_what_it_now_says(tmp_path: Path) -> None:
    (log := tmp_path / "artifacts/logs/campus/odometry.csv").parent.mkdir(parents=True)
    log.write_text("".join(f"{i}000000,{i}.0,0,0,0,0,0\n" for i in range(50)))
    assert {one["ending"] for one in mutations(tmp_path, tries=40, seed=0, done=0)} <= set(
        ENDINGS[:3]
    )


def test_a_mutation_changes_the_bytes_nearly_always() -> None:
    rng = random.Random(0)
    data = bytes(range(200))
    assert sum(mutated(data, rng) != data for _ in range(200)) > 190
    assert mutated(b"", rng) == b"\0"


def test_words_that_nobody_should_say_are_refused_or_harmless() -> None:
    """And the copy of the settings is what changes, not the project's own."""
    before = {path: path.read_bytes() for path in sorted((ROOT / "conf").rglob("*.yaml"))}
    found = list(fault_words.cases(ROOT, number=24, seed=1, done=0))
    assert [one for one in found if one["ending"] not in ENDINGS[:3]] == []
    assert len({one["file"].split()[0] for one in found}) > 8
    assert before == {path: path.read_bytes() for path in sorted((ROOT / "conf").rglob("*.yaml"))}


def test_a_fetch_that_is_stopped_ends_as_an_undisturbed_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(ROOT / "conf", tmp_path / "conf")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setattr(fault_commands, "COMMANDS", {"fetch": fault_commands.COMMANDS["fetch"]})
    found = list(fault_commands.cases(tmp_path, number=3, seed=0, done=0))
    assert [(one["case"], one["ending"]) for one in found] == [
        (0, "same"),
        (1, "same"),
        (2, "same"),
    ]
    assert len(list((tmp_path / "fetched/made/made").iterdir())) == 200
    assert not (tmp_path / "conf/fetch/made.yaml").exists()
