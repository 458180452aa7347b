"""Tests that the data dictionary is what xarray and docs/artifacts.md show of an artifact."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.inspection.dictionary import KINDS, page
from tests.inspection.test_artifacts import START_NS, write

DOCS = Path(__file__).parents[2] / "docs/artifacts.md"


@pytest.mark.parametrize("kind", KINDS)
def test_xarray_shows_the_dimensions_and_units_of_every_array(tmp_path: Path, kind: str) -> None:
    xarray = pytest.importorskip("xarray", reason="pip install '.[dev]'")
    path = write(tmp_path / "a.zarr", kind)
    with xarray.open_zarr(path, consolidated=False, decode_times=False) as dataset:
        assert set(dataset.variables) == set(KINDS[kind].columns)
        for name, array in KINDS[kind].columns.items():
            assert dataset[name].dims == array.dims
            assert dataset[name].dtype == array.dtype
            assert dataset[name].attrs.get("units", "") == array.unit


def test_xarray_reads_stamps_as_dates(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray", reason="pip install '.[dev]'")
    with xarray.open_zarr(write(tmp_path / "a.zarr", "submaps"), consolidated=False) as dataset:
        assert dataset["stamps_ns"].values[0] == np.datetime64(START_NS, "ns")
        assert dataset["stamps_ns"].values[0] == np.datetime64("2012-01-15T18:39:55")


@pytest.mark.parametrize(
    ("suffix", "unit"), [("_m", "m"), ("_deg", "degree"), ("_ns", "nanoseconds since 1970-01-01")]
)
def test_an_array_has_the_unit_that_its_name_says(suffix: str, unit: str) -> None:
    named = [
        array
        for kind in KINDS.values()
        for name, array in kind.columns.items()
        if name.endswith(suffix)
    ]
    assert named
    assert {array.unit for array in named} == {unit}


def test_the_page_has_every_array_of_today() -> None:
    text = DOCS.read_text(encoding="utf-8")
    assert page(text) == text, "python -m pipeline.inspection.dictionary rewrites it"
    for kind in KINDS.values():
        for name, array in kind.columns.items():
            assert f"| `{name}` | {array.dtype} |" in text
