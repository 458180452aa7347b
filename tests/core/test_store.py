"""Artifacts are written whole or not at all, and their bytes follow from what was put in."""

import errno
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import GenericAlias, MappingProxyType
from typing import Annotated, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.errors import ArtifactError
from pipeline.core.store import Array, Artifact
from pipeline.inspection.dictionary import KINDS


@dataclass(frozen=True, eq=False)
class Things(Artifact, kind="things", version=3):
    """Ragged points and a height each."""

    points: Annotated[
        NDArray[np.int16], Array(("point", "xyz"), "ragged", unit="grain_m", chunk=4, shard=8)
    ]
    offsets: Annotated[
        NDArray[np.int64], Array(("thing+1",), "thing i is points[offsets[i]:offsets[i + 1]]")
    ]
    heights: Annotated[
        NDArray[np.float32], Array(("thing",), "its top", unit="m", chunk=2, shard=4)
    ]
    grain_m: Annotated[float, "metres per unit"]


POINTS = np.arange(60, dtype=np.int16).reshape(20, 3)
OFFSETS = np.array([0, 7, 20])
HEIGHTS = np.array([1.5, -2.5], np.float32)
COLUMNS = {"points": POINTS, "offsets": OFFSETS, "heights": HEIGHTS}


def put(
    path: Path,
    attrs: Mapping[str, object] = MappingProxyType({"grain_m": 0.005}),
    **changed: np.ndarray | None,
) -> None:
    """Write the columns, some of them changed or (None) left out."""
    with store.draft(path, Things, **attrs) as draft:
        for name, rows in (COLUMNS | changed).items():
            if rows is not None:
                draft.put(name, rows)


def interrupted(path: Path) -> None:
    """A writer that is stopped halfway."""
    with store.replace(path) as scratch:
        scratch.mkdir()
        (scratch / "half").write_text("written")
        raise KeyboardInterrupt


def contents(path: Path) -> dict[str, bytes]:
    return {
        file.relative_to(path).as_posix(): file.read_bytes()
        for file in path.rglob("*")
        if file.is_file()
    }


def test_a_dtype_is_read_of_both_forms_of_an_array_type() -> None:
    """NDArray[float32] had the arguments shape and dtype[float32]; since numpy 2.5 it has one."""
    meaning = Array(("thing",), "its top")

    @dataclass(frozen=True)
    class Before:
        heights: Annotated[np.ndarray[tuple[int], np.dtype[np.float32]], meaning]

    @dataclass(frozen=True)
    class Since:
        heights: Annotated[GenericAlias(np.ndarray, (np.float32,)), meaning]  # type: ignore[valid-type]

    assert store.define(Before).arrays["heights"].dtype == "float32"
    assert store.define(Since).arrays["heights"].dtype == "float32"


def test_an_array_is_one_folder_of_files(tmp_path: Path) -> None:
    """DVC visits every folder of an artifact each time, and zarr would make c/0/0."""
    put(tmp_path / "a.zarr")
    assert {path.name for path in (tmp_path / "a.zarr").rglob("*") if path.is_dir()} == set(COLUMNS)
    assert {path.name for path in (tmp_path / "a.zarr/points").iterdir()} == {
        "zarr.json",
        "c.0.0",
        "c.1.0",
        "c.2.0",
    }


def test_what_was_written_is_read(tmp_path: Path) -> None:
    put(tmp_path / "new" / "a.zarr")
    found = store.read(tmp_path / "new" / "a.zarr", Things)
    for name, rows in COLUMNS.items():
        np.testing.assert_array_equal(found.load(name), rows)
        assert found[name].dtype == np.dtype(Things.columns[name].dtype)
    assert found.attrs == {"kind": "things", "version": 3, "grain_m": 0.005}
    np.testing.assert_array_equal(found["points"][7:9], POINTS[7:9])
    assert found["points"].metadata.dimension_names == ("point", "xyz")
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.zarr"]


@pytest.mark.parametrize("block", [1, 3, 8, 11, 20])
def test_rows_appended_in_blocks_give_the_bytes_of_rows_put_at_once(
    tmp_path: Path, block: int
) -> None:
    # 20 points in shards of 8: blocks end within, on and beyond a shard's end.
    put(tmp_path / "whole.zarr")
    with store.draft(tmp_path / "streamed.zarr", Things, grain_m=lambda: 0.005) as draft:
        for start in range(0, len(POINTS), block):
            draft.append("points", POINTS[start : start + block])
            draft.append("heights", HEIGHTS[start : start + block])
        draft.put("offsets", OFFSETS)
    assert contents(tmp_path / "streamed.zarr") == contents(tmp_path / "whole.zarr")


def test_an_artifact_may_have_no_rows(tmp_path: Path) -> None:
    put(
        tmp_path / "a.zarr",
        points=np.empty((0, 3), np.int16),
        offsets=np.array([0]),
        heights=np.empty(0, np.float32),
    )
    assert store.read(tmp_path / "a.zarr", Things).load("points").shape == (0, 3)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"points": POINTS.astype(float)}, "points"),
        ({"points": POINTS[:, 0]}, "points"),
        ({"offsets": np.array([0.0, 7, 20])}, "offsets"),
        ({"offsets": np.array([0, 20])}, "thing"),
        ({"heights": np.zeros(3, np.float32)}, "thing"),
        ({"colours": HEIGHTS}, "colours"),
        ({"heights": None}, "heights"),
        ({"points": np.full((20, 3), 40_000)}, "points"),  # beyond the 16-bit range
        ({"offsets": np.array([0, 7, 2**63], np.uint64)}, "offsets"),
    ],
)
def test_columns_that_do_not_fit_the_schema_are_refused(
    tmp_path: Path, changed: dict[str, Any], says: str
) -> None:
    with pytest.raises(ArtifactError, match=says):
        put(tmp_path / "a.zarr", **changed)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("attrs", [{}, {"grain_m": 1, "colour": 2}, {"grain": 1}])
def test_attributes_that_do_not_fit_the_schema_are_refused(
    tmp_path: Path, attrs: dict[str, object]
) -> None:
    with pytest.raises(ArtifactError, match="grain_m"):
        put(tmp_path / "a.zarr", attrs)
    assert list(tmp_path.iterdir()) == []


def test_a_block_that_fails_leaves_the_old_artifact(tmp_path: Path) -> None:
    put(tmp_path / "a.zarr")
    before = contents(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        interrupted(tmp_path / "a.zarr")
    assert contents(tmp_path) == before


def test_an_interruption_is_reported_where_a_thread_still_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path) -> None:
        raise OSError(errno.ENOTEMPTY, "Directory not empty", str(path))

    monkeypatch.setattr("shutil.rmtree", full)
    with pytest.raises(KeyboardInterrupt):
        interrupted(tmp_path / "a.zarr")


def test_a_new_artifact_takes_the_place_of_the_old(tmp_path: Path) -> None:
    put(tmp_path / "a.zarr")
    put(tmp_path / "a.zarr", heights=HEIGHTS + 1)
    np.testing.assert_array_equal(
        store.read(tmp_path / "a.zarr", Things).load("heights"), [2.5, -1.5]
    )


KILLED = """
import os, signal, sys
from pipeline.core import store
with store.replace(sys.argv[1]) as scratch:
    scratch.mkdir()
    (scratch / "half").write_text("written")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_writer_left_is_swept_and_a_living_one_is_not_disturbed(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.zarr"
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, str(path)], cwd=Path(__file__).parents[2], check=False
    )
    assert killed.returncode == -9
    (left,) = tmp_path.iterdir()
    assert left.name.startswith(".a.zarr.")
    # the parent of this process runs for as long as this does
    living = tmp_path / f".a.zarr.{os.getppid()}.scratch"
    other = tmp_path / left.name.replace("a.zarr", "b.zarr")
    living.mkdir()
    other.mkdir()
    put(path)
    assert {found.name for found in tmp_path.iterdir()} == {"a.zarr", living.name, other.name}


def make_other(path: Path, name: str, number: int) -> None:
    @dataclass(frozen=True)
    class Other(Artifact, kind=name, version=number):
        """An artifact without arrays."""

    store.write(path, Other())


def make_broken(path: Path) -> None:
    put(path)
    (path / "zarr.json").write_text('{"zarr_format": 3, "node_')


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda path: None, "no such artifact"),
        (Path.mkdir, "no such artifact"),
        (
            lambda path: make_other(path, "others", 3),
            "expected things version 3, found others version 3; `dvc repro`",
        ),
        (
            lambda path: make_other(path, "things", 2),
            "expected things version 3, found things version 2; `dvc repro`",
        ),
        (make_broken, r"a\.zarr"),
    ],
)
def test_reading_what_is_no_such_artifact_is_one_clear_line(
    tmp_path: Path, make: Callable[[Path], None], says: str
) -> None:
    path = tmp_path / "a.zarr"
    make(path)
    with pytest.raises(ArtifactError, match=says) as error:
        store.read(path, Things)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_every_schema_writes_whole_shards_and_shares_its_dimensions() -> None:
    for schema in KINDS.values():
        for column in schema.columns.values():
            assert column.shard % column.chunk == 0
            assert np.dtype(column.dtype).isnative


MODEL = {
    "net/weight": np.arange(6, dtype=np.float32).reshape(2, 3).T,
    "threshold": np.array(0.25),
    "best_epoch": np.array(7),
}
RECIPE = {
    "epochs": 200,
    "seed": 0,
    "view": "scan_context",
    "validation_every_m": 40.0,
    "dropout": 0.7,
}


def test_a_model_comes_back_with_its_recipe(tmp_path: Path) -> None:
    store.write_model(tmp_path / "sci.zarr.zip", MODEL, RECIPE)
    found = store.read_model(tmp_path / "sci.zarr.zip")
    assert set(found) == set(MODEL)
    for name, array in MODEL.items():
        np.testing.assert_array_equal(found[name], array)
        assert (found[name].shape, found[name].dtype) == (array.shape, array.dtype)
    assert store.read_recipe(tmp_path / "sci.zarr.zip") == {
        name: str(value) for name, value in RECIPE.items()
    }


def test_a_model_has_the_same_bytes_each_time(tmp_path: Path) -> None:
    for number in range(8):
        store.write_model(tmp_path / str(number), MODEL, RECIPE)
    assert len({path.read_bytes() for path in tmp_path.iterdir()}) == 1


@pytest.mark.parametrize("data", [None, b"", b"no model", b"\xff" * 64])
def test_a_missing_or_damaged_model_is_one_clear_line(tmp_path: Path, data: bytes | None) -> None:
    path = tmp_path / "sci.zarr.zip"
    if data is not None:
        path.write_bytes(data)
    for read in (store.read_model, store.read_recipe):
        with pytest.raises(ArtifactError) as error:
            read(path)
        assert str(path) in str(error.value)
        assert "\n" not in str(error.value)


def test_a_failed_file_leaves_the_old_one(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(KeyboardInterrupt):
        interrupted(tmp_path / "a.txt")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.txt", "old")]


def test_a_folder_may_take_the_place_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    with store.replace(tmp_path / "a") as scratch:
        scratch.mkdir()
        (scratch / "b").write_text("new")
    assert (tmp_path / "a" / "b").read_text() == "new"


def test_a_column_with_a_row_a_case_is_not_padded_to_thousands() -> None:
    """Chunks are whole in memory: 65,536 rows of 25 × 200 counts took 15 s and 2.9 GB to write
    two."""
    judged = [
        column
        for schema in KINDS.values()
        for column in schema.columns.values()
        if column.dims[0] == "case"
    ]
    assert judged
    assert all(column.chunk == 1 and column.shard <= 64 for column in judged)
