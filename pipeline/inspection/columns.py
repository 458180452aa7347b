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
    low: float
    high: float
    """The lowest and the highest number; NaN for an array without a number."""
    nans: int
    """How many elements are NaN."""
    infinite: int
    """How many elements are infinite."""

    def text(self) -> str:
        """The range, lowest … highest, and the share of NaN."""
        count = int(np.prod(self.shape))
        if not count:
            return "no rows"
        if self.dtype.kind == "b":
            return f"{str(bool(self.low)).lower()} … {str(bool(self.high)).lower()}"
        if np.isnan(self.low):
            return "all NaN"
        if self.low == self.high and not self.nans:
            return _number(self.low)
        nan_text = f", {100 * self.nans / count:.3g} % NaN" if self.nans else ""
        return f"{_number(self.low)} … {_number(self.high)}{nan_text}"


def blocks(array: Any) -> Iterator[NDArray[Any]]:
    """The rows of a zarr or numpy array in blocks of about BLOCK_ELEMENTS, of whole chunks."""
    chunks = getattr(array, "chunks", None) or (1,)
    rows_per_chunk = max(1, int(chunks[0]))
    elements_per_row = max(1, int(np.prod(array.shape[1:])))
    chunks_per_block = max(1, BLOCK_ELEMENTS // elements_per_row // rows_per_chunk)
    step = chunks_per_block * rows_per_chunk
    for start in range(0, array.shape[0], step):
        yield np.asarray(array[start : start + step])


def extent(array: Any) -> Extent:
    """The extent of a zarr or numpy array with at least one dimension."""
    low = np.inf
    high = -np.inf
    nans = 0
    infinite = 0
    for block in blocks(array):
        if block.dtype.kind == "f":
            nans += int(np.isnan(block).sum())
            infinite += int(np.isinf(block).sum())
            block = block[~np.isnan(block)]
        if block.size:
            low = min(low, block.min().item())
            high = max(high, block.max().item())
    if low > high:
        low = high = np.nan
    return Extent(tuple(array.shape), np.dtype(array.dtype), low, high, nans, infinite)


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
    span = array_extent.text()
    if name == "stamps_ns" and array_extent.low <= array_extent.high:
        start = moment(int(array_extent.low)).partition(" (")[0]
        span = f"{duration((array_extent.high - array_extent.low) * 1e-9)} from {start}"
    cells = (name, str(array_extent.dtype), " × ".join(sides) or "one number", span)
    return cells if column is None else (*cells, column.says)


def _number(value: float) -> str:
    """A number for the terminal: a float with five digits, an integer with its thousands apart."""
    if isinstance(value, float):
        text = f"{value:.5g}"
    elif abs(value) < 10**12:
        text = f"{value:,}"
    else:  # a stamp
        text = str(value)
    return text if "e" in text else typographic(text)
