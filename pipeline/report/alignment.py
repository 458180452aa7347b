"""By how many columns to roll one Scan Context so that it looks most like another."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter


def spectra(heights_m: NDArray[np.float32]) -> NDArray[np.complex64]:
    """Fourier spectra (view, ring, frequency) along the sectors, of slightly blurred heights.

    Takes heights in metres (view, ring, sector).
    """
    clipped = np.clip(heights_m, 0.0, 15.0).astype(np.float64)  # as in the colour images
    blurred = uniform_filter(clipped, (0, 3, 3), mode=("nearest", "nearest", "wrap"))
    spectrum: NDArray[np.complex64] = np.fft.rfft(
        blurred - blurred.mean(axis=(1, 2), keepdims=True), axis=2
    ).astype(np.complex64)
    return spectrum


def best_shifts(
    queries: NDArray[np.complex64], views: NDArray[np.complex64], sectors: int
) -> NDArray[np.int64]:
    """Columns (view,) to roll each view by so that it correlates best with its query.

    Queries and views are given by their spectra.
    """
    correlation = np.fft.irfft((queries * views.conj()).sum(axis=1), sectors, axis=1)
    best: NDArray[np.int64] = correlation.round(6).argmax(axis=1)
    return best


def best_shift(query: NDArray[np.float32], view: NDArray[np.float32]) -> int:
    """Columns to roll one view by; query and view are heights (ring, sector)."""
    return int(best_shifts(spectra(query[None]), spectra(view[None]), view.shape[1])[0])
