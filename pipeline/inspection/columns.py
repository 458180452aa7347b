"""Describes one array of an artifact for `yearloc inspect`: the array in; a row of a table out.

The row has the array's type, dimensions and range of numbers. Arrays are read block by block, to
bound the memory.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.store import Array
from pipeline.inspection.inspection import duration, moment, typographic

BLOCK_ELEMENTS = 2**22
"""Elements of an array that are in memory at a time, about."""


@dataclass(frozen=True)
class Extent:
    """Shape, type and range of an array."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    lowest: float
    highest: float
    """The smallest and the largest number; NaN for an array without a number."""
    nan_count: int
    """How many elements are NaN."""
    inf_count: int
    """How many elements are infinite."""

    def text(self) -> str:
        """The range, lowest … highest, and the share of NaN."""
        count = int(np.prod(self.shape))
        if not count:
            return "no rows"
        if self.dtype.kind == "b":
            return f"{str(bool(self.lowest)).lower()} … {str(bool(self.highest)).lower()}"
        if np.isnan(self.lowest):
            return "all NaN"
        if self.lowest == self.highest and not self.nan_count:
            return _number(self.lowest)
        nan_text = f", {100 * self.nan_count / count:.3g} % NaN" if self.nan_count else ""
        return f"{_number(self.lowest)} … {_number(self.highest)}{nan_text}"


def blocks(array: Any) -> Iterator[NDArray[Any]]:
    """The rows of a zarr or numpy array in blocks of about BLOCK_ELEMENTS, of whole chunks."""
    chunks = getattr(array, "chunks", None) or (1,)
    rows_per_chunk = max(1, int(chunks[0]))
    elements_per_row = max(1, int(np.prod(array.shape[1:])))
    chunks_per_block = max(1, BLOCK_ELEMENTS // elements_per_row // rows_per_chunk)
    rows_per_block = chunks_per_block * rows_per_chunk
    for start in range(0, array.shape[0], rows_per_block):
        yield np.asarray(array[start : start + rows_per_block])


def extent(array: Any) -> Extent:
    """The extent of a zarr or numpy array with at least one dimension."""
    lowest = np.inf
    highest = -np.inf
    nan_count = 0
    inf_count = 0
    for block in blocks(array):
        if block.dtype.kind == "f":
            nan_count += int(np.isnan(block).sum())
            inf_count += int(np.isinf(block).sum())
            block = block[~np.isnan(block)]
        if block.size:
            lowest = min(lowest, block.min().item())
            highest = max(highest, block.max().item())
    if lowest > highest:  # no block had a number
        lowest = highest = np.nan
    return Extent(
        shape=tuple(array.shape),
        dtype=np.dtype(array.dtype),
        lowest=lowest,
        highest=highest,
        nan_count=nan_count,
        inf_count=inf_count,
    )


def row(name: str, array_extent: Extent, column: Array | None = None) -> tuple[str, ...]:
    """The row of an array in the table: name, type, lengths of its dimensions, and range.

    If the data dictionary has the array as a `column`, its dimensions are named, and the row ends
    in its description.
    """
    shape = array_extent.shape
    dims: tuple[str, ...] = ("",) * len(shape)
    if column is not None and len(column.dims) == len(shape):
        dims = column.dims
    sides = [f"{length:,} {dim}".strip() for dim, length in zip(dims, shape, strict=True)]
    range_text = array_extent.text()
    if (
        name == "stamps_ns" and array_extent.lowest <= array_extent.highest
    ):  # both are NaN without rows
        start = moment(int(array_extent.lowest)).partition(" (")[0]  # without a remark on its clock
        range_text = f"{duration((array_extent.highest - array_extent.lowest) * 1e-9)} from {start}"
    cells = (name, str(array_extent.dtype), " × ".join(sides) or "one number", range_text)
    return cells if column is None else (*cells, column.says)


def _number(value: float) -> str:
    """A number for the terminal: a float with five digits, an integer with commas (12,345)."""
    if isinstance(value, float):
        text = f"{value:.5g}"
    elif abs(value) < 10**12:  # a count
        text = f"{value:,}"
    else:  # a stamp
        text = str(value)
    return text if "e" in text else typographic(text)
