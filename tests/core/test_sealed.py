"""Damage in an artifact or a model is noticed: what is read is what was written, or an error."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

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


def read(path: Path) -> Any:
    """What an artifact or a model holds."""
    if path.suffix == ".zip":
        model = store.read_model(path)
        arrays = {name: (array.dtype, array.tobytes()) for name, array in model.items()}
        return store.read_recipe(path), arrays
    artifact = store.read(path, Things)
    return artifact.attrs, {name: artifact.load(name).tobytes() for name in COLUMNS}


@pytest.mark.parametrize("name", ["a.zarr", "a.zarr.zip"])
def test_with_a_turned_bit_it_is_refused_or_the_same(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    if name == "a.zarr":
        put(path)
    else:
        store.write_model(path, MODEL, {"epochs": 3})
    right = read(path)
    files = sorted(file for file in path.rglob("*") if file.is_file()) or [path]
    rng = np.random.default_rng(0)
    refused = 0
    for i in range(TRIES):
        file = files[i % len(files)]
        before = file.read_bytes()
        damaged = bytearray(before)
        damaged[rng.integers(len(damaged))] ^= 1 << int(rng.integers(8))
        file.write_bytes(damaged)
        try:
            assert read(path) == right
        except ArtifactError:
            refused += 1
        file.write_bytes(before)
    assert refused > 0.8 * TRIES  # a zip has fields that nobody reads, such as dates


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
    # by somebody who knows how
    zarr.open_group(path, mode="r+").attrs[sealed.SEAL] = sealed.metadata_checksum(path)
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
