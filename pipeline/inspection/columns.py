"""The ranges of the arrays of an artifact, read block by block to bound the memory."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.inspection import duration, moment, typographic
from pipeline.schemas import Column

BLOCK = 1 << 22
"""Elements read at once."""


@dataclass(frozen=True)
class Extent:
    """Shape, type and range of an array."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    low: float
    high: float
    nans: int
    infinite: int

    def text(self) -> str:
        """The range, lowest … highest, and the share of NaN."""
        count = int(np.prod(self.shape))
        if not count:
            return "no rows"
        if self.dtype.kind == "b":
            return f"{'false' if not self.low else 'true'} … {'true' if self.high else 'false'}"
        if self.low == self.high and not self.nans:
            return _number(self.low)
        span = "all NaN" if np.isnan(self.low) else f"{_number(self.low)} … {_number(self.high)}"
        return span + (f", {100 * self.nans / count:.3g} % NaN" if self.nans and span != "all NaN" else "")


def extent(array: Any) -> Extent:
    """Lowest and highest of a zarr or numpy array with at least one dimension."""
    low, high, nans, infinite = np.inf, -np.inf, 0, 0
    row = max(1, int(np.prod(array.shape[1:])))
    chunk = max(1, int((getattr(array, "chunks", None) or (1,))[0]))
    step = max(1, BLOCK // row // chunk) * chunk
    for start in range(0, array.shape[0], step):
        block: NDArray[Any] = np.asarray(array[start : start + step])
        if block.dtype.kind == "f":
            nan = np.isnan(block)
            nans += int(nan.sum())
            infinite += int(np.isinf(block).sum())
            block = block[~nan]
        if block.size:
            low, high = min(low, block.min().item()), max(high, block.max().item())
    if low > high:
        low = high = float("nan")
    return Extent(tuple(array.shape), np.dtype(array.dtype), low, high, nans, infinite)


def row(name: str, found: Extent, column: Column | None = None) -> tuple[str, ...]:
    """Name, type, dimensions with their lengths, range, and the description in the data dictionary."""
    dims = column.dims if column is not None and len(column.dims) == len(found.shape) else ("",) * len(found.shape)
    sides = " × ".join(f"{length:,} {dim}".strip() for dim, length in zip(dims, found.shape, strict=True))
    span = _clock(found) if name == "stamps_ns" and found.low <= found.high else found.text()
    return (name, str(found.dtype), sides or "one number", span, *((column.doc,) if column is not None else ()))


def _clock(found: Extent) -> str:
    """A range of stamps in ns as duration and start."""
    first = moment(int(found.low)).partition(" (")[0]
    return f"{duration((found.high - found.low) * 1e-9)} from {first}"


def _number(value: float) -> str:
    if isinstance(value, bool | np.bool_):
        return str(value).lower()
    text = f"{value:.5g}" if isinstance(value, float) else f"{value:,}" if abs(value) < 10**12 else str(value)
    return typographic(text) if "e" not in text else text
