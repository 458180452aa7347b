"""The views of a sequence in one picture: a PNG of palette indices that a browser colours, and how far to turn one to another."""

import struct
import zlib
from base64 import b64encode
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from pipeline.views.scan_context import colours, quantize

COLUMNS = 16
"""Views beside each other."""


@dataclass(frozen=True)
class Atlas:
    """Scan Contexts (view, ring, sector) packed row by row, ring 0 of each on top."""

    png: bytes
    views: int
    rings: int
    sectors: int

    @classmethod
    def of(cls, heights_m: NDArray[np.float32]) -> Self:
        """Of heights (view, ring, sector) in metres."""
        views, rings, sectors = heights_m.shape
        cells = np.pad(quantize(heights_m), ((0, -views % COLUMNS), (0, 0), (0, 0)))
        packed = cells.reshape(-1, COLUMNS, rings, sectors).swapaxes(1, 2).reshape(-1, COLUMNS * sectors)
        return cls(png(packed, colours("jet")), views, rings, sectors)

    def told(self) -> dict[str, Any]:
        """As the page's data."""
        own = {"columns": COLUMNS, "views": self.views, "rings": self.rings, "sectors": self.sectors}
        return {"png": b64encode(self.png).decode(), **own}


def png(indices: NDArray[np.uint8], palette: NDArray[np.uint8]) -> bytes:
    """An 8-bit PNG of indices (height, width) into a palette (256, 3)."""
    height, width = indices.shape
    lines = np.pad(indices, ((0, 0), (1, 0))).tobytes()  # each line begins with its filter: none
    header = struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)
    chunks = {b"IHDR": header, b"PLTE": palette.tobytes(), b"IDAT": zlib.compress(lines, 6), b"IEND": b""}
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(name, content) for name, content in chunks.items())


def _chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def spectra(heights_m: NDArray[np.float32]) -> NDArray[np.complex64]:
    """Along the sectors (view, ring, frequency), of views (view, ring, sector) a little blurred."""
    clipped = np.clip(heights_m, 0.0, 15.0).astype(np.float64)
    blurred = uniform_filter(clipped, (0, 3, 3), mode=("nearest", "nearest", "wrap"))
    found: NDArray[np.complex64] = np.fft.rfft(blurred - blurred.mean(axis=(1, 2), keepdims=True), axis=2).astype(np.complex64)
    return found


def shifts(asked: NDArray[np.complex64], found: NDArray[np.complex64], sectors: int) -> NDArray[np.int64]:
    """By how many columns (view,) to roll each view `found` so that it looks most like the one `asked` (reports.matches)."""
    likeness = np.fft.irfft((asked * found.conj()).sum(axis=1), sectors, axis=1)
    best: NDArray[np.int64] = likeness.round(6).argmax(axis=1)
    return best
