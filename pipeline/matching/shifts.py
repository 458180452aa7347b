"""Scan Context's distance: the mean cosine of engaged columns at the best of all column shifts (IROS 2018, eq. 6; METHODS 1.3).

The sums of cosines at all shifts are one circular correlation, so a database keeps the spectra of its columns, brought to
length 1, and a query costs one pass over them and an inverse transform. They are stored in float32 and summed in float64:
a shift at which a single column is engaged may win, and its cosine must not drown in the rounding of all the others.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import circulant

from pipeline.errors import InputError
from pipeline.matching.database import QUERIES, Database
from pipeline.matching.ranking import Model, Ranking, Rows, joined

PREFIX = "spectra/"
BLOCK = 256  # rows compared at once: their correlations stay in the core's own cache


@dataclass(frozen=True)
class Spectra:
    """The n Scan Contexts of a database, ready to be compared at every shift."""

    columns: NDArray[np.float32]  # (n, frequency, 2 rings) of the unit columns: a real and an imaginary part of each ring
    engaged: NDArray[np.float32]  # (n, sector) 1 where a column holds anything
    least_engaged: float = 0.0  # `ShiftMethod.least_engaged`

    @classmethod
    def learned(cls, heights_m: NDArray[np.float32], least_engaged: float = 0.0) -> Self:
        """Of Scan Contexts (n, ring, sector)."""
        n, rings, sectors = heights_m.shape
        columns = np.empty((n, sectors // 2 + 1, 2 * rings), np.float32)
        for i in range(0, n, BLOCK):
            columns[i : i + BLOCK] = _spectra(heights_m[i : i + BLOCK]).view(np.float64)
        return cls(columns, _engaged(heights_m), least_engaged)

    @classmethod
    def of(cls, model: Model, least_engaged: float = 0.0) -> Self:
        """The spectra in a model."""
        return cls(model[f"{PREFIX}columns"], model[f"{PREFIX}engaged"], least_engaged)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Its arrays, as they are stored in a model."""
        return {f"{PREFIX}columns": self.columns, f"{PREFIX}engaged": self.engaged}

    def compare(self, heights_m: NDArray[np.float32], rows: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distances (m,) in [0, 2] of one Scan Context (ring, sector) to these rows (m,), and its yaw (m,) in degrees against
        each, counter-clockwise in [0, 360).

        The yaw is the best shift: after a turn to the left all is seen further to the right, in columns of lower number.
        Where no shift engages a column the distance is 1 and the yaw NaN.
        """
        sectors = self.engaged.shape[1]
        query = _spectra(heights_m[None])[0]
        real_and_imaginary = np.stack([query, 1j * query], axis=1).view(np.float64)
        turned = circulant(_engaged(heights_m[None])[0])  # column s: which columns it engages, turned by s
        similarities, best = np.empty(len(rows)), np.empty(len(rows), np.int64)
        for i in range(0, len(rows), BLOCK):
            part = slice(i, i + BLOCK)
            sums = np.fft.irfft(_products(self.columns, real_and_imaginary, rows[part]), sectors)
            _best(sums, self.engaged[rows[part]] @ turned, self.least_engaged, similarities[part], best[part])
        return (1 - similarities).clip(0), np.where(best < 0, np.nan, best * (360 / sectors))

    def images(self, views: Rows) -> NDArray[np.float32]:
        """The views (q, ring, sector); raises InputError unless they are as many rings and sectors as learned."""
        heights_m = np.asarray(views.images[:])
        learned = (self.columns.shape[2] // 2, self.engaged.shape[1])
        if heights_m.shape[1:] != learned:
            raise InputError(f"views of {heights_m.shape[1:]}: the model learned {learned[0]} rings × {learned[1]} sectors")
        return heights_m

    def rank(
        self, database: Database, heights_m: NDArray[np.float32], rows: NDArray[np.int64], k: int, distinct_places: bool
    ) -> Ranking:
        """The ranking of queries (q, ring, sector), each held against its own candidates among the rows (q, m)."""
        parts = []
        for i in range(0, max(len(rows), 1), QUERIES):
            candidates = rows[i : i + QUERIES]
            compared = np.empty((2, *candidates.shape))
            for j, its in enumerate(candidates):
                compared[:, j] = self.compare(heights_m[i + j], its)
            order = np.argsort(compared[0], axis=1, kind="stable")
            distances, turned_deg = np.take_along_axis(compared, order[None], axis=2)
            ordered = np.take_along_axis(candidates, order, axis=1)
            parts.append(database.answer(distances.astype(np.float32), ordered, k, distinct_places, turned_deg))
        return joined(parts)


def _engaged(heights_m: NDArray[np.float32]) -> NDArray[np.float32]:
    engaged: NDArray[np.float32] = (heights_m != 0).any(axis=1).astype(np.float32)
    return engaged


def _spectra(heights_m: NDArray[np.float32]) -> NDArray[np.complex128]:
    """(n, frequency, ring) of Scan Contexts (n, ring, sector), their columns brought to length 1; empty ones stay 0."""
    columns = heights_m.astype(np.float64)
    lengths = np.sqrt(np.einsum("nrs,nrs->ns", columns, columns))
    columns /= np.where(lengths > 0, lengths, 1)[:, None]
    return np.ascontiguousarray(np.fft.rfft(columns, axis=2).transpose(0, 2, 1))


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def _products(columns, query, rows):  # type: ignore[no-untyped-def]
    """Spectra (m, frequency) of the correlations of these rows with the query (frequency, real and imaginary part, 2 rings).

    Four rows at a time, for one reading of the query serves them all; the last ones may be computed more than once.
    """
    frequencies, _, numbers = query.shape
    last = len(rows) - 1
    spectra = np.empty((len(rows), frequencies), np.complex128)
    for i in range(0, len(rows), 4):
        j, k, m = min(i + 1, last), min(i + 2, last), min(i + 3, last)
        a, b, c, d = columns[rows[i]], columns[rows[j]], columns[rows[k]], columns[rows[m]]
        for f in range(frequencies):
            a_re = a_im = b_re = b_im = c_re = c_im = d_re = d_im = 0.0
            for number in range(numbers):
                re, im = query[f, 0, number], query[f, 1, number]
                a_re += a[f, number] * re
                a_im += a[f, number] * im
                b_re += b[f, number] * re
                b_im += b[f, number] * im
                c_re += c[f, number] * re
                c_im += c[f, number] * im
                d_re += d[f, number] * re
                d_im += d[f, number] * im
            spectra[i, f] = complex(a_re, a_im)
            spectra[j, f] = complex(b_re, b_im)
            spectra[k, f] = complex(c_re, c_im)
            spectra[m, f] = complex(d_re, d_im)
    return spectra


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")
def _best(sums, counts, least, similarities, shifts):  # type: ignore[no-untyped-def]
    """Write the highest mean (m,) of sums and counts (m, shift), and its shift; 0 at shift −1 where nothing is counted.

    Shifts of fewer counts than a share of the most are passed over.
    """
    for i in range(len(sums)):
        best, where, enough = -np.inf, -1, least * counts[i].max()
        for shift in range(sums.shape[1]):
            if counts[i, shift] > 0 and counts[i, shift] >= enough and sums[i, shift] / counts[i, shift] > best:
                best, where = sums[i, shift] / counts[i, shift], shift
        similarities[i], shifts[i] = best if where >= 0 else 0.0, where
