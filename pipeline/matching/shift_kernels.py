"""The hot loops of Scan Context's distance: spectra, shared columns and the best shift."""

import math

import numpy as np
from numba import njit, types
from numba.extending import intrinsic
from numpy.typing import NDArray

WORD = 64
NOWHERE = np.float32(-4)
"""Below every mean of cosines."""


def packed(engaged: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Bit sets (n, words) of which columns (n, sector) are engaged."""
    words = -(-engaged.shape[1] // WORD)
    bits = np.zeros((len(engaged), words * WORD), bool)
    bits[:, : engaged.shape[1]] = engaged
    return np.packbits(bits, axis=1, bitorder="little").view(np.uint64)


@intrinsic
def _bit_count(context, word):  # type: ignore[no-untyped-def]
    """The number of set bits of a uint64: one instruction."""

    def build(context, builder, signature, words):  # type: ignore[no-untyped-def]
        return builder.ctpop(words[0])

    return types.uint64(types.uint64), build


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def products(columns, query, rows, spectra):  # type: ignore[no-untyped-def]
    """Write spectra (m, frequency) of the correlations of rows with a query.

    The query is (frequency, real and imaginary part, 2 rings). Sums are of the query's type. Four
    rows at a time, for one reading of the query serves them all; the last ones may be computed more
    than once.
    """
    frequencies, _, numbers = query.shape
    last_row = len(rows) - 1
    zero = query.dtype.type(0)
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
                re = query[f, 0, number]
                im = query[f, 1, number]
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


@njit(inline="always")
def _count(mask, turned, counts):  # type: ignore[no-untyped-def]
    """Write how many columns a row shares with the query at every shift; returns the most.

    A bit set (words,) of the row, and (shift, words) of the query.
    """
    most = np.float32(0)
    for shift in range(turned.shape[0]):
        shared = np.uint64(0)
        for word in range(turned.shape[1]):
            shared += _bit_count(mask[word] & turned[shift, word])
        counts[shift] = np.float32(np.int32(shared))
        most = max(most, counts[shift])
    return most


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")
def best(sums, masks, turned, least, similarities, shifts):  # type: ignore[no-untyped-def]
    """Write the highest mean (m,) of sums (m, shift), and its shift.

    0 at shift −1 where nothing is engaged. Shifts that engage fewer columns than a share of the
    most are passed over.
    """
    counts = np.empty(sums.shape[1], np.float32)
    for i in range(len(sums)):
        highest = -np.inf
        best_shift = -1
        enough = least * _count(masks[i], turned, counts)
        for shift in range(sums.shape[1]):
            if (
                counts[shift] > 0
                and counts[shift] >= enough
                and sums[i, shift] / counts[shift] > highest
            ):
                highest = sums[i, shift] / counts[shift]
                best_shift = shift
        similarities[i] = highest if best_shift >= 0 else 0.0
        shifts[i] = best_shift


@njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def highest(sums, masks, turned, least, similarities):  # type: ignore[no-untyped-def]
    """As `best` in float32 without the shift, which the compiler can vectorise."""
    counts = np.empty(sums.shape[1], np.float32)
    for i in range(len(sums)):
        enough = np.float32(max(math.ceil(least * _count(masks[i], turned, counts)), 1))
        best_mean = NOWHERE
        for shift in range(sums.shape[1]):
            mean = sums[i, shift] / max(counts[shift], np.float32(1))
            best_mean = max(best_mean, mean if counts[shift] >= enough else NOWHERE)
        similarities[i] = best_mean if best_mean > NOWHERE else np.float32(0)
