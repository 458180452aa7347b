"""Damage in an artifact or a model is noticed: what is read is what was written, or an error."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import zarr

from pipeline.core import sealed, store
from pipeline.core.errors import ArtifactError
from tests.core.test_store import COLUMNS, Things, contents, put

TRIES = 400
MODEL = {
    "weight": np.linspace(-1, 1, 50, dtype=np.float32),
    "none": np.empty((0, 3)),
    "k": np.array(7),
}


def turn_a_bit(path: Path, rng: np.random.Generator) -> bytes:
    """Turn one bit of a file; returns the file as it was."""
    before = path.read_bytes()
    damaged = bytearray(before)
    damaged[rng.integers(len(damaged))] ^= 1 << int(rng.integers(8))
    path.write_bytes(damaged)
    return before


def test_an_artifact_with_a_turned_bit_is_refused_or_the_same(tmp_path: Path) -> None:
    put(path := tmp_path / "a.zarr")
    files = sorted(file for file in path.rglob("*") if file.is_file())
    rng = np.random.default_rng(0)
    refused = 0
    for i in range(TRIES):
        file = files[i % len(files)]
        before = turn_a_bit(file, rng)
        try:
            artifact = store.read(path, Things)
            assert artifact.attrs == {"kind": "things", "version": 3, "grain_m": 0.005}
            for name, rows in COLUMNS.items():
                np.testing.assert_array_equal(artifact.load(name), rows)
        except ArtifactError:
            refused += 1
        file.write_bytes(before)
    assert refused > 0.8 * TRIES


def test_a_lost_file_is_an_error_and_no_zeros(tmp_path: Path) -> None:
    put(path := tmp_path / "a.zarr", heights=np.zeros(2, np.float32))
    np.testing.assert_array_equal(store.read(path, Things).load("heights"), [0, 0])
    (path / "points/c.1.0").unlink()
    with pytest.raises(
        ArtifactError, match=r"a\.zarr: 1 of 3 files of points are missing; remove it"
    ):
        store.read(path, Things).load("points")


def test_an_array_that_says_it_is_huge_is_not_read(tmp_path: Path) -> None:
    put(path := tmp_path / "a.zarr")
    form = path / "heights/zarr.json"
    form.write_text(json.dumps(json.loads(form.read_text()) | {"shape": [10**12]}))
    with pytest.raises(ArtifactError, match="not as they were written"):
        store.read(path, Things)
    zarr.open_group(path, mode="r+").attrs[sealed.SEAL] = sealed.metadata_checksum(
        path
    )  # by somebody who knows how
    with pytest.raises(
        ArtifactError, match="249999999999 of 250000000000 files of heights are missing"
    ):
        store.read(path, Things).load("heights")


def test_writers_in_threads_each_write_all_their_zeros(tmp_path: Path) -> None:
    zeros = {"points": np.zeros((20, 3), np.int16), "heights": np.zeros(2, np.float32)}
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda i: put(tmp_path / f"{i}.zarr", **zeros), range(40)))
    assert len({frozenset(contents(tmp_path / f"{i}.zarr").items()) for i in range(40)}) == 1
    assert (tmp_path / "0.zarr/heights/c.0").is_file()


def test_a_model_with_a_turned_bit_is_refused_or_the_same(tmp_path: Path) -> None:
    store.write_model(path := tmp_path / "a.zarr.zip", MODEL, {"epochs": 3})
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(TRIES):
        before = turn_a_bit(path, rng)
        try:
            model = store.read_model(path)
            assert store.read_recipe(path) == {"epochs": "3"}
            assert model.keys() == MODEL.keys()
            assert all(
                model[name].dtype == array.dtype and np.array_equal(model[name], array)
                for name, array in MODEL.items()
            )
        except ArtifactError:
            refused += 1
        path.write_bytes(before)
    assert refused > 0.8 * TRIES  # a zip has fields that nobody reads, such as dates
