"""Aligns Scan Contexts: by how many columns to roll one so that it looks most like another.

A Scan Context is an image of heights (ring, sector) around the robot, so rolling its columns turns
the robot. The best roll is the peak of the circular correlation, found by Fourier transforms.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter


def spectra(heights_m: NDArray[np.float32]) -> NDArray[np.complex64]:
    """Fourier spectra (view, ring, frequency) along the sectors of heights (view, ring, sector).

    Heights in metres are blurred slightly first, so that neighbouring sectors count too.
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
    """Columns (view,) to roll each view by so that it correlates best with the query beside it.

    Queries and views are given by their spectra; `sectors` is the number of columns.
    """
    correlation = np.fft.irfft((queries * views.conj()).sum(axis=1), sectors, axis=1)
    best: NDArray[np.int64] = correlation.round(6).argmax(axis=1)
    return best


def best_shift(query: NDArray[np.float32], view: NDArray[np.float32]) -> int:
    """Columns to roll one view by towards a query; both are heights (ring, sector) in metres."""
    return int(best_shifts(spectra(query[None]), spectra(view[None]), view.shape[1])[0])
