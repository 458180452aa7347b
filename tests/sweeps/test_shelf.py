"""The shelf: whoever comes first builds, everybody else waits and reads."""

import multiprocessing
import time
from pathlib import Path

import pytest

from pipeline.sweeps.shelf import Shelf

KEYS = 4


def fill(folder: Path) -> None:
    """Slow, in two files, and leaving a trace of who was here."""
    with (folder / "builders").open("a") as trace:
        trace.write("x")
    for name in ("a", "b"):
        time.sleep(0.02)
        (folder / name).write_text(folder.name * 1000)


def visit(root: str) -> None:
    for key in range(KEYS):
        folder, _ = Shelf(Path(root)).get("train", f"key{key}", ("a", "b"), fill)
        assert all((folder / name).read_text() == f"key{key}" * 1000 for name in ("a", "b"))


def test_what_is_there_is_not_built_again(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    folder, built = shelf.get("views", "k", ("a", "b"), fill)
    assert built
    assert folder == tmp_path / "views/k"
    assert shelf.get("views", "k", ("a", "b"), fill) == (folder, False)
    assert (folder / "builders").read_text() == "x"


def test_half_an_entry_is_built_again(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)

    def killed(folder: Path) -> None:
        (folder / "a").write_text("k")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shelf.get("evaluate", "k", ("a", "b"), killed)
    _, built = shelf.get("evaluate", "k", ("a", "b"), fill)
    assert built


def test_many_at_once_build_each_entry_once(tmp_path: Path) -> None:
    processes = [multiprocessing.get_context("spawn").Process(target=visit, args=(str(tmp_path),)) for _ in range(4)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0] * 4
    assert [(tmp_path / f"train/key{key}/builders").read_text() for key in range(KEYS)] == ["x"] * KEYS
