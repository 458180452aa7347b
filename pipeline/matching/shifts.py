"""Scan Context's distance: the mean cosine of the columns that are engaged in both, at the best
column shift (IROS 2018, eq. 6; METHODS 1.3).

A column is engaged if it is not empty, and a shift of the columns is a turn of the robot. The sums
of cosines at all shifts are one circular correlation. So a database stores the spectra of its
columns, scaled to length 1, and a query costs one pass over them and an inverse transform.

Spectra are stored in float32, and their products are summed in float64: a shift at which a single
column is engaged may win, and its cosine must not drown in the rounding of all other columns. If
only the nearest of many rows are wanted, sums in float32 first find the rows that may be among
them.
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
"""Prefix of the spectra's arrays in a model."""
BLOCK = 256
"""How many rows are compared at once: few enough for their correlations to stay in a core's cache.
"""
SLACK = np.float32(1e-3)
"""Bound on the error of a similarity summed in float32, which is about 1e-6 · √(columns engaged in
either) / (columns engaged in both)."""


@dataclass(frozen=True)
class Spectra:
    """The n Scan Contexts of a database, ready to be compared at every shift."""

    columns: NDArray[np.float32]
    """(n, frequency, 2 rings) the spectra of the columns, scaled to length 1; the real and the
    imaginary part of each ring follow each other."""
    engaged: NDArray[np.float32]
    """(n, sector) 1 if a column is not empty, else 0."""
    least_engaged: float = 0.0
    """See `ShiftMethod.least_engaged`."""

    @classmethod
    def learned(cls, heights_m: NDArray[np.float32], least_engaged: float = 0.0) -> Self:
        """Make the spectra of Scan Contexts (n, ring, sector), heights in metres."""
        n, rings, sectors = heights_m.shape
        columns = np.empty((n, sectors // 2 + 1, 2 * rings), np.float32)
        for i in range(0, n, BLOCK):
            # as float64 the real and the imaginary parts alternate; they are rounded to float32
            columns[i : i + BLOCK] = _spectra(heights_m[i : i + BLOCK]).view(np.float64)
        return cls(columns, _engaged(heights_m), least_engaged)

    @classmethod
    def of(cls, model: Model, least_engaged: float = 0.0) -> Self:
        """Read the spectra that a model holds."""
        return cls(model[f"{PREFIX}columns"], model[f"{PREFIX}engaged"], least_engaged)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The arrays of the spectra, as they are stored in a model."""
        return {f"{PREFIX}columns": self.columns, f"{PREFIX}engaged": self.engaged}

    def compare(
        self, heights_m: NDArray[np.float32], rows: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Compare one Scan Context (ring, sector) with some rows (m,).

        Returns the distances (m,) in [0, 2], and the yaw (m,) of the query against each row, in
        degrees counter-clockwise in [0, 360). The yaw is the best shift: after a turn to the left
        everything is seen further to the right, in columns of lower number. If no shift shares an
        engaged column, the distance is 1 and the yaw NaN.
        """
        query = _spectra(heights_m[None])[0]
        shifted_masks = _shifted_masks(heights_m)
        similarities = np.empty(len(rows))
        best_shifts = np.empty(len(rows), np.int64)
        for part, sums in self._correlations(query, rows):
            kernels.best_shifts(
                sums,
                self._masks[rows[part]],
                shifted_masks,
                self.least_engaged,
                out_similarities=similarities[part],
                out_shifts=best_shifts[part],
            )
        distances = (1 - similarities).clip(0)
        column_deg = 360 / self.engaged.shape[1]
        # The shift is −1 where no shift engages a column.
        yaw_deg = np.where(best_shifts < 0, np.nan, best_shifts * column_deg)
        return distances, yaw_deg

    def likely(
        self,
        heights_m: NDArray[np.float32],
        rows: NDArray[np.int64],
        k: int,
        groups: NDArray[np.int64] | None = None,
    ) -> NDArray[np.int64]:
        """Return the rows of `rows` (m,) that may be among the k nearest to a query (ring, sector).

        They stay in their order. If the rows belong to `groups` (m,), such as places, the result is
        the rows that may be the nearest of their group, for the k nearest groups.
        """
        if len(rows) <= BLOCK:
            return rows
        query = _spectra(heights_m[None])[0].astype(np.complex64)
        shifted_masks = _shifted_masks(heights_m)
        similarities = np.empty(len(rows), np.float32)
        for part, sums in self._correlations(query, rows):
            kernels.highest_similarities(
                sums,
                self._masks[rows[part]],
                shifted_masks,
                self.least_engaged,
                out_similarities=similarities[part],
            )
        competitors = similarities
        if groups is not None:
            # Keep the best similarity of each of the k nearest groups; −1 stands for no group.
            order = np.argsort(-similarities, kind="stable")
            (firsts,) = first_of_each(groups[order][None], k)
            competitors = similarities[order[firsts[firsts >= 0]]]
        if len(competitors) < k:
            return rows
        kth_highest = np.partition(competitors, -k)[-k]
        # Both a row's similarity and the k-th highest may be off by SLACK.
        return np.asarray(rows[similarities >= kth_highest - 2 * SLACK])

    @cached_property
    def _masks(self) -> NDArray[np.uint64]:
        """Bit sets (n, words) of the engaged columns of each row."""
        return kernels.pack_masks(self.engaged > 0)

    def _correlations(
        self, query: NDArray[np.complexfloating], rows: NDArray[np.int64]
    ) -> Iterator[tuple[slice, NDArray[np.floating]]]:
        """Yield slices of `rows` (m,), each with its sums of cosines (row, shift) with a query."""
        # For a column a and the query b, a · conj(b) has the parts
        #   Re = re a re b + im a im b = (re a, im a) · (re b, im b)
        #   Im = im a re b − re a im b = (re a, im a) · (re ib, im ib)
        # so a's numbers are multiplied with those of b, and with those of i b.
        factors = np.stack([query, 1j * query], axis=1).astype(query.dtype)
        factors_of_parts = factors.view(query.real.dtype)
        # In float64 numpy's transform, so that rankings keep their bits; in float32 scipy's, which
        # is twice as fast.
        fft = scipy.fft if query.dtype == np.complex64 else np.fft
        spectra = np.empty((min(BLOCK, len(rows)), len(query)), query.dtype)
        for i in range(0, len(rows), BLOCK):
            part = slice(i, min(i + BLOCK, len(rows)))
            out = spectra[: part.stop - i]
            kernels.multiply_spectra(self.columns, factors_of_parts, rows[part], out_spectra=out)
            yield part, fft.irfft(out, self.engaged.shape[1])

    def read_heights(self, views: Rows) -> NDArray[np.float32]:
        """Read the views (q, ring, sector); raises InputError for another shape than training's."""
        heights_m = np.asarray(views.images[:])
        rings = self.columns.shape[2] // 2
        sectors = self.engaged.shape[1]
        if heights_m.shape[1:] != (rings, sectors):
            raise InputError(
                f"views of {heights_m.shape[1:]}: the model learned {rings} rings × "
                f"{sectors} sectors"
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
        """Rank k answers to queries (q, ring, sector), each among its own candidate rows (q, m)."""
        rankings = []
        for start in range(0, max(len(rows), 1), QUERIES):
            # 1. Find the candidates that may be among the k nearest, in float32.
            views = heights_m[start : start + QUERIES]
            likely_rows = []
            for view, view_rows in zip(views, rows[start : start + QUERIES], strict=True):
                groups = database.places[view_rows] if distinct_places else None
                likely_rows.append(self.likely(view, view_rows, k, groups))

            # 2. Compare these in float64.
            candidates, distances, yaw_deg = self._compare_likely(views, likely_rows)

            # 3. Answer with the nearest.
            order = np.argsort(distances, axis=1, kind="stable")
            ranking = database.answer(
                np.take_along_axis(distances, order, axis=1).astype(np.float32),
                np.take_along_axis(candidates, order, axis=1),
                k,
                distinct_places,
                np.take_along_axis(yaw_deg, order, axis=1),
            )
            rankings.append(ranking)
        return joined(rankings)

    def _compare_likely(
        self, views: NDArray[np.float32], likely_rows: list[NDArray[np.int64]]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Compare each view (ring, sector) with its likely rows.

        Returns the rows (q, m), their distances and the yaws of the views against them (q, m).
        Views with fewer rows are filled up with row 0 at an infinite distance, whose yaw is never
        read.
        """
        m = max(map(len, likely_rows), default=0)
        candidates = np.zeros((len(likely_rows), m), np.int64)
        distances = np.full(candidates.shape, np.inf)
        yaw_deg = np.full(candidates.shape, np.nan)
        for query, query_rows in enumerate(likely_rows):
            n = len(query_rows)
            candidates[query, :n] = query_rows
            distances[query, :n], yaw_deg[query, :n] = self.compare(views[query], query_rows)
        return candidates, distances, yaw_deg


def _shifted_masks(heights_m: NDArray[np.float32]) -> NDArray[np.uint64]:
    """Bit sets (shift, words) of the engaged columns of a Scan Context at every shift."""
    return kernels.pack_masks(circulant(_engaged(heights_m[None])[0] > 0).T)


def _engaged(heights_m: NDArray[np.float32]) -> NDArray[np.float32]:
    """1 if a column (n, sector) of Scan Contexts (n, ring, sector) is not empty, else 0."""
    return np.asarray((heights_m != 0).any(axis=1).astype(np.float32))


def _spectra(heights_m: NDArray[np.float32]) -> NDArray[np.complex128]:
    """Spectra (n, frequency, ring) of Scan Contexts (n, ring, sector), columns of length 1."""
    columns = heights_m.astype(np.float64)
    lengths = np.sqrt(np.einsum("nrs,nrs->ns", columns, columns))
    columns /= np.where(lengths > 0, lengths, 1)[:, None]
    return np.ascontiguousarray(np.fft.rfft(columns, axis=2).transpose(0, 2, 1))
