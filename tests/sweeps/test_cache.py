"""The cache of sweeps: the first job builds an entry, every other waits for it and reads it."""

import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.sweeps.cache import ArtifactCache

BUILDER = """
import sys, time
from pathlib import Path
from pipeline.sweeps.cache import ArtifactCache

def fill(folder):
    with (folder / "builders").open("a") as trace:
        trace.write("x")
    for name in ("a", "b"):
        time.sleep(0.02)
        (folder / name).write_text(folder.name * 1000)

for key in ("key0", "key1", "key2", "key3"):
    folder, _ = ArtifactCache(Path(sys.argv[1])).get("train", key, ("a", "b"), fill)
    assert all((folder / name).read_text() == key * 1000 for name in ("a", "b"))
"""
"""Builds four entries slowly, of two files each, with a mark for each builder; then reads them."""


def fill(folder: Path) -> None:
    """Build an entry whole."""
    for name in ("a", "b"):
        (folder / name).write_text(folder.name)


def killed(folder: Path) -> None:
    """Build half of an entry."""
    (folder / "a").write_text("k")
    raise KeyboardInterrupt


def test_half_an_entry_is_built_again_and_a_whole_one_is_not(tmp_path: Path) -> None:
    cache = ArtifactCache(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        cache.get("views", "k", ("a", "b"), killed)
    assert cache.get("views", "k", ("a", "b"), fill) == (tmp_path / "views/k", True)
    assert cache.get("views", "k", ("a", "b"), killed) == (tmp_path / "views/k", False)


def test_many_at_once_build_each_entry_once(tmp_path: Path) -> None:
    processes = [subprocess.Popen([sys.executable, "-c", BUILDER, str(tmp_path)]) for _ in range(4)]
    assert [process.wait() for process in processes] == [0] * 4
    assert [(tmp_path / f"train/key{key}/builders").read_text() for key in range(4)] == ["x"] * 4
