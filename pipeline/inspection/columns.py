"""Ranges of arrays, for `yearloc inspect`: an array of an artifact in; a row of its table out.

Arrays are read block by block, to bound the memory.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.store import Array
from pipeline.inspection.inspection import duration, moment, typographic


@dataclass(frozen=True)
class Extent:
    """Shape, type and range of an array."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    low: float
    """Lowest number, NaN without any."""
    high: float
    nans: int
    """How many numbers are NaN."""
    infinite: int
    """How many are infinite."""

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
    """The rows of a zarr or numpy array, in blocks of whole chunks of about 4 million elements."""
    chunk = max(1, int((getattr(array, "chunks", None) or (1,))[0]))
    step = max(1, 2**22 // max(1, int(np.prod(array.shape[1:]))) // chunk) * chunk
    for start in range(0, array.shape[0], step):
        yield np.asarray(array[start : start + step])


def extent(array: Any) -> Extent:
    """The extent of a zarr or numpy array with at least one dimension.

    Its ends are NaN for an array without a number.
    """
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
    low, high = (low, high) if low <= high else (np.nan, np.nan)
    return Extent(tuple(array.shape), np.dtype(array.dtype), low, high, nans, infinite)


def row(name: str, array_extent: Extent, column: Array | None = None) -> tuple[str, ...]:
    """The cells of an array's row in the table.

    Name, type, dimensions with their lengths, range, and the description in the data dictionary.
    """
    dims = (
        column.dims
        if column is not None and len(column.dims) == len(array_extent.shape)
        else ("",) * len(array_extent.shape)
    )
    sides = " × ".join(
        f"{length:,} {dim}".strip() for dim, length in zip(dims, array_extent.shape, strict=True)
    )
    span = array_extent.text()
    if name == "stamps_ns" and array_extent.low <= array_extent.high:
        span = (
            f"{duration((array_extent.high - array_extent.low) * 1e-9)} from "
            f"{moment(int(array_extent.low)).partition(' (')[0]}"
        )
    return (
        name,
        str(array_extent.dtype),
        sides or "one number",
        span,
        *((column.says,) if column is not None else ()),
    )


def _number(value: float) -> str:
    """A number as people read it: five digits of a float, thousands of an integer apart."""
    if isinstance(value, float):
        text = f"{value:.5g}"
    elif abs(value) < 10**12:
        text = f"{value:,}"
    else:  # a stamp
        text = str(value)
    return text if "e" in text else typographic(text)
