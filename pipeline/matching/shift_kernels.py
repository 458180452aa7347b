"""The hot loops of Scan Context's distance (`matching.shifts`): correlations, and the best shift.

A column of a Scan Context is engaged if it holds anything. At a shift, the similarity of two Scan
Contexts is the mean cosine of the columns that are engaged in both: a sum of cosines, from a
circular correlation, over a count of columns, from bit sets.

1. `multiply_spectra` multiplies the spectra of database rows with that of a query, which gives the
   spectra of the sums of cosines at all shifts.
2. `pack_masks` makes the bit sets of engaged columns, whose common bits count the shared columns.
3. `best_shifts` and `highest_similarities` divide the sums by the counts, and find the best shift
   of each row.
"""

import math

import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

WORD = 64
"""The number of bits in a word of a bit set."""
NO_SHIFT = np.float32(-4)
"""Stands for the mean cosine of a shift that does not count; below every real mean cosine."""


def pack_masks(engaged: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Pack a mask of engaged columns (n, sector) into bit sets (n, words)."""
    words = -(-engaged.shape[1] // WORD)
    bits = np.zeros((len(engaged), words * WORD), bool)
    bits[:, : engaged.shape[1]] = engaged
    return np.packbits(bits, axis=1, bitorder="little").view(np.uint64)


@intrinsic
def _bit_count(context, word):  # type: ignore[no-untyped-def]
    """The number of set bits of a uint64, which is one instruction of the processor."""

    def build(context, builder, signature, words):  # type: ignore[no-untyped-def]
        return builder.ctpop(words[0])

    return types.uint64(types.uint64), build


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def multiply_spectra(columns, factors, rows, out_spectra):  # type: ignore[no-untyped-def]
    """Write to `out_spectra` (m, frequency) the correlations' spectra of m `rows` with a query.

    `columns` (n, frequency, 2·rings) are the database's spectra: the real parts of all rings, then
    the imaginary parts. They are multiplied by the query's `factors` (frequency, 2, 2·rings):
    factors[f, 0] gives the real part of the product, factors[f, 1] the imaginary part. Sums have
    the type of the factors. Four rows are processed together, so that the factors are read once for
    all four; the last group is filled up with the last row.
    """
    # a, b, c and d are the spectra of the rows numbered i, j, k and m in `rows`.
    frequencies, _, numbers = factors.shape
    last_row = len(rows) - 1
    zero = factors.dtype.type(0)
    for i in range(0, len(rows), 4):
        j = min(i + 1, last_row)
        k = min(i + 2, last_row)
        m = min(i + 3, last_row)
        a = columns[rows[i]]
        b = columns[rows[j]]
        c = columns[rows[k]]
        d = columns[rows[m]]
        for f in range(frequencies):
            a_re = a_im = b_re = b_im = c_re = c_im = d_re = d_im = zero
            for number in range(numbers):
                re = factors[f, 0, number]
                im = factors[f, 1, number]
                a_re += a[f, number] * re
                a_im += a[f, number] * im
                b_re += b[f, number] * re
                b_im += b[f, number] * im
                c_re += c[f, number] * re
                c_im += c[f, number] * im
                d_re += d[f, number] * re
                d_im += d[f, number] * im
            out_spectra[i, f] = complex(a_re, a_im)
            out_spectra[j, f] = complex(b_re, b_im)
            out_spectra[k, f] = complex(c_re, c_im)
            out_spectra[m, f] = complex(d_re, d_im)


@njit(inline="always")
def _count(mask, shifted_masks, out_counts):  # type: ignore[no-untyped-def]
    """Write to `out_counts` (shift,) how many engaged columns row and query share.

    `mask` (words,) is the row's bit set, `shifted_masks` (shift, words) the query's at every shift.
    Returns the largest count.
    """
    largest_count = np.float32(0)
    for shift in range(shifted_masks.shape[0]):
        shared_columns = np.uint64(0)
        for word in range(shifted_masks.shape[1]):
            shared_columns += _bit_count(mask[word] & shifted_masks[shift, word])
        out_counts[shift] = np.float32(np.int32(shared_columns))
        largest_count = max(largest_count, out_counts[shift])
    return largest_count


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")
def best_shifts(  # type: ignore[no-untyped-def]
    sums, masks, shifted_masks, least_engaged, out_similarities, out_shifts
):
    """Write each row's highest mean cosine to `out_similarities` (m,), its shift to `out_shifts`.

    A shift is a number of columns.

    `sums` (m, shift) are sums of cosines, `masks` (m, words) and `shifted_masks` (shift, words) the
    bit sets of the rows and the query. A shift is valid if its count of shared columns is at least
    the fraction `least_engaged` of the largest count over all shifts. If no shift shares a column,
    the similarity is 0 and the shift −1.
    """
    counts = np.empty(sums.shape[1], np.float32)
    for i in range(len(sums)):
        highest_mean = -np.inf
        best_shift = -1
        enough_columns = least_engaged * _count(masks[i], shifted_masks, counts)
        for shift in range(sums.shape[1]):
            if (
                counts[shift] > 0
                and counts[shift] >= enough_columns
                and sums[i, shift] / counts[shift] > highest_mean
            ):
                highest_mean = sums[i, shift] / counts[shift]
                best_shift = shift
        out_similarities[i] = highest_mean if best_shift >= 0 else 0.0
        out_shifts[i] = best_shift


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def highest_similarities(  # type: ignore[no-untyped-def]
    sums, masks, shifted_masks, least_engaged, out_similarities
):
    """Like `best_shifts`, but in float32 and without the shift, so that it can be vectorised."""
    counts = np.empty(sums.shape[1], np.float32)
    for i in range(len(sums)):
        largest_count = _count(masks[i], shifted_masks, counts)
        enough_columns = np.float32(max(math.ceil(least_engaged * largest_count), 1))
        best_mean = NO_SHIFT
        for shift in range(sums.shape[1]):
            mean = sums[i, shift] / max(counts[shift], np.float32(1))
            best_mean = max(best_mean, mean if counts[shift] >= enough_columns else NO_SHIFT)
        out_similarities[i] = best_mean if best_mean > NO_SHIFT else np.float32(0)
