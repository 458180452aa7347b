"""Scan Context's distance: the mean cosine of engaged columns at the best column shift.

IROS 2018, eq. 6; METHODS 1.3.

The sums of cosines at all shifts are one circular correlation, so a database keeps the spectra of
its columns, brought to length 1, and a query costs one pass over them and an inverse transform.
They are stored in float32 and summed in float64: a shift at which a single column is engaged may
win, and its cosine must not drown in the rounding of all the others. Where only the nearest of many
rows are wanted, sums in float32 first find which rows they may be.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.linalg import circulant

from pipeline.core.errors import InputError
from pipeline.matching import shift_kernels as kernels
from pipeline.matching.database import QUERIES, Database
from pipeline.matching.nearest import first_of_each
from pipeline.matching.ranking import Model, Ranking, Rows, joined

PREFIX = "spectra/"
BLOCK = 256
"""Rows compared at once: their correlations stay in the core's own cache."""
SLACK = np.float32(1e-3)
"""A similarity summed in float32 is not so far off: rounding of 1e-6 of √(columns engaged in
either), over what both engage."""


@dataclass(frozen=True)
class Spectra:
    """The n Scan Contexts of a database, ready to be compared at every shift."""

    columns: NDArray[
        np.float32
    ]  # (n, frequency, 2 rings) of the unit columns: a real and an imaginary part of each ring
    engaged: NDArray[np.float32]
    """(n, sector) 1 where a column holds anything."""
    least_engaged: float = 0.0
    """`ShiftMethod.least_engaged`."""

    @classmethod
    def learned(cls, heights_m: NDArray[np.float32], least_engaged: float = 0.0) -> Self:
        """The spectra of Scan Contexts (n, ring, sector)."""
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

    def compare(
        self, heights_m: NDArray[np.float32], rows: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Distances (m,) in [0, 2] of one Scan Context (ring, sector) to rows (m,), and its yaw.

        The yaw (m,) against each is in degrees, counter-clockwise in [0, 360). It is the best
        shift: after a turn to the left all is seen further to the right, in columns of lower
        number. Where no shift engages a column the distance is 1 and the yaw NaN.
        """
        query = _spectra(heights_m[None])[0]
        turned = _turned(heights_m)
        similarities = np.empty(len(rows))
        best_shifts = np.empty(len(rows), np.int64)
        for part, sums in self._correlations(query, rows):
            kernels.best(
                sums,
                self._masks[rows[part]],
                turned,
                self.least_engaged,
                similarities[part],
                best_shifts[part],
            )
        return (1 - similarities).clip(0), np.where(
            best_shifts < 0, np.nan, best_shifts * (360 / self.engaged.shape[1])
        )

    def likely(
        self,
        heights_m: NDArray[np.float32],
        rows: NDArray[np.int64],
        k: int,
        groups: NDArray[np.int64] | None = None,
    ) -> NDArray[np.int64]:
        """Those of rows (m,) that may be among the k nearest of a Scan Context (ring, sector).

        In their order. With groups (m,) of the rows: that may be the nearest of one of the k
        nearest groups.
        """
        if len(rows) <= BLOCK:
            return rows
        query = _spectra(heights_m[None])[0].astype(np.complex64)
        turned = _turned(heights_m)
        similarities = np.empty(len(rows), np.float32)
        for part, sums in self._correlations(query, rows):
            kernels.highest(
                sums, self._masks[rows[part]], turned, self.least_engaged, similarities[part]
            )
        nearest = similarities
        if groups is not None:
            order = np.argsort(-similarities, kind="stable")
            columns = first_of_each(groups[order][None], k)[0]
            nearest = similarities[order[columns[columns >= 0]]]
        if len(nearest) < k:
            return rows
        likely_rows: NDArray[np.int64] = rows[
            similarities >= np.partition(nearest, -k)[-k] - 2 * SLACK
        ]
        return likely_rows

    @cached_property
    def _masks(self) -> NDArray[np.uint64]:
        return kernels.packed(self.engaged > 0)

    def _correlations(
        self, query: NDArray[np.complexfloating], rows: NDArray[np.int64]
    ) -> Iterator[tuple[slice, NDArray[np.floating]]]:
        """Slices of the rows (m,), with sums of cosines (part, shift) with a query.

        `query` is a spectrum (frequency, ring), and sums have its precision.
        """
        real_and_imaginary = (
            np.stack([query, 1j * query], axis=1).astype(query.dtype).view(query.real.dtype)
        )
        spectra = np.empty((min(BLOCK, len(rows)), len(query)), query.dtype)
        for i in range(0, len(rows), BLOCK):
            part = slice(i, min(i + BLOCK, len(rows)))
            out = spectra[: part.stop - i]
            kernels.products(self.columns, real_and_imaginary, rows[part], out)
            # numpy where it is exact, so that rankings keep their bits; scipy's transform is twice
            # as fast
            yield (
                part,
                (scipy.fft if out.dtype == np.complex64 else np.fft).irfft(
                    out, self.engaged.shape[1]
                ),
            )

    def images(self, views: Rows) -> NDArray[np.float32]:
        """The views (q, ring, sector); raises InputError unless shaped as those learned."""
        heights_m = np.asarray(views.images[:])
        learned = (self.columns.shape[2] // 2, self.engaged.shape[1])
        if heights_m.shape[1:] != learned:
            raise InputError(
                f"views of {heights_m.shape[1:]}: the model learned {learned[0]} rings × "
                f"{learned[1]} sectors"
            )
        return heights_m

    def rank(
        self,
        database: Database,
        heights_m: NDArray[np.float32],
        rows: NDArray[np.int64],
        k: int,
        distinct_places: bool,
    ) -> Ranking:
        """Rank queries (q, ring, sector), each among its own candidate rows (q, m)."""
        parts = []
        for i in range(0, max(len(rows), 1), QUERIES):
            likely = [
                self.likely(
                    view, view_rows, k, database.places[view_rows] if distinct_places else None
                )
                for view, view_rows in zip(
                    heights_m[i : i + QUERIES], rows[i : i + QUERIES], strict=True
                )
            ]
            candidates = np.zeros((len(likely), max(map(len, likely), default=0)), np.int64)
            compared = np.full((2, *candidates.shape), np.inf)
            for j, likely_rows in enumerate(likely):
                candidates[j, : len(likely_rows)] = likely_rows
                compared[:, j, : len(likely_rows)] = self.compare(heights_m[i + j], likely_rows)
            order = np.argsort(compared[0], axis=1, kind="stable")
            distances, turned_deg = np.take_along_axis(compared, order[None], axis=2)
            ordered = np.take_along_axis(candidates, order, axis=1)
            parts.append(
                database.answer(
                    distances.astype(np.float32), ordered, k, distinct_places, turned_deg
                )
            )
        return joined(parts)


def _turned(heights_m: NDArray[np.float32]) -> NDArray[np.uint64]:
    """Bit sets (shift, words) of a Scan Context's engaged columns at every shift."""
    return kernels.packed(circulant(_engaged(heights_m[None])[0] > 0).T)


def _engaged(heights_m: NDArray[np.float32]) -> NDArray[np.float32]:
    engaged: NDArray[np.float32] = (heights_m != 0).any(axis=1).astype(np.float32)
    return engaged


def _spectra(heights_m: NDArray[np.float32]) -> NDArray[np.complex128]:
    """Spectra (n, frequency, ring) of Scan Contexts (n, ring, sector).

    Columns are brought to length 1; empty ones stay 0.
    """
    columns = heights_m.astype(np.float64)
    lengths = np.sqrt(np.einsum("nrs,nrs->ns", columns, columns))
    columns /= np.where(lengths > 0, lengths, 1)[:, None]
    return np.ascontiguousarray(np.fft.rfft(columns, axis=2).transpose(0, 2, 1))
