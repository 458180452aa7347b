"""Images as SeqSLAM compares them: normalised patches and sums of differences (METHODS 6)."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.errors import InputError

GREY = 127
"""What a patch's mean becomes; one standard deviation is 1 more."""
TILE = 64
"""Queries at a time: few enough to stay in the L2 cache while every reference passes."""


def resized(images: NDArray[np.uint8], side_px: int) -> NDArray[np.uint8]:
    """Images (n, side, side) at another side; a pixel is the mean of the area that it covers."""
    side = images.shape[-1]
    if side == side_px:
        return np.ascontiguousarray(images)
    edges = np.linspace(0, side, side_px + 1)[:, None]
    pixel = np.arange(side)
    share = (np.clip(edges[1:] - pixel, 0, 1) - np.clip(edges[:-1] - pixel, 0, 1)) * (
        side_px / side
    )
    out = np.empty((len(images), side_px, side_px), np.uint8)
    for image, pixels in zip(images, out, strict=True):
        pixels[:] = np.rint(share @ image @ share.T)
    return out


def normalised(images: NDArray[np.uint8], patch_px: int = 8) -> NDArray[np.uint8]:
    """Images (n, height, width) with each square patch at mean 127 and standard deviation 1.

    n − 1 in the denominator. Rounded, a half away from the mean; a patch of one grey is 127
    throughout. Raises InputError unless patches fill an image.
    """
    if images.ndim != 3 or images.shape[1] % patch_px or images.shape[2] % patch_px:
        raise InputError(
            f"images of shape {images.shape}: expected (n, height, width) in whole patches of "
            f"{patch_px} pixels"
        )
    out = np.empty(images.shape, np.uint8)
    _normalised(np.ascontiguousarray(images, np.uint8), patch_px, out)
    return out


def differences(references: NDArray[np.uint8], queries: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Sums of absolute differences (n, m) of queries (m, …) from references (n, …), over n.

    The divisor is SeqSLAM's; it scales all alike. Raises InputError for images of different shapes.
    """
    if references.shape[1:] != queries.shape[1:]:
        raise InputError(
            f"queries of shape {queries.shape[1:]}: expected {references.shape[1:]} like the "
            "references"
        )
    pixels = math.prod(references.shape[1:])
    reference_pixels, query_pixels = (
        np.ascontiguousarray(images, np.uint8).reshape(len(images), pixels)
        for images in (references, queries)
    )
    sums = np.empty((len(reference_pixels), len(query_pixels)), np.int32)
    _sums(reference_pixels, query_pixels, sums)
    scaled: NDArray[np.float32] = sums.astype(np.float32)
    scaled /= max(len(reference_pixels), 1)
    return scaled


@njit(cache=True, nogil=True, boundscheck=False, error_model="numpy")
def _normalised(images, side, out):  # type: ignore[no-untyped-def]
    number = side * side
    for n in range(images.shape[0]):
        for top in range(0, images.shape[1], side):
            for left in range(0, images.shape[2], side):
                total = np.int64(0)
                squares = np.int64(0)
                for row in range(top, top + side):
                    for column in range(left, left + side):
                        value = np.int64(images[n, row, column])
                        total += value
                        squares += value * value
                spread = (
                    number * squares - total * total
                )  # whole numbers: number² times the mean square deviation
                scale = math.sqrt((number - 1) / (number * max(spread, 1)))
                for row in range(top, top + side):
                    for column in range(left, left + side):
                        above = (number * np.int64(images[n, row, column]) - total) * scale
                        rounded = math.floor(abs(above) + 0.5)
                        out[n, row, column] = min(
                            max(GREY + (rounded if above > 0 else -rounded), 0), 255
                        )


@njit(cache=True, nogil=True, boundscheck=False, error_model="numpy")
def _sums(references, queries, sums):  # type: ignore[no-untyped-def]
    for start in range(0, len(queries), TILE):
        for i in range(len(references)):
            for j in range(start, min(start + TILE, len(queries))):
                sums[i, j] = _difference(references[i], queries[j])


@njit(cache=True, nogil=True, boundscheck=False, error_model="numpy")
def _difference(left, right):  # type: ignore[no-untyped-def]
    """Sum of absolute differences of two images.

    In int32 throughout: only so does the compiler find the processor's own instruction.
    """
    total = np.int32(0)
    for p in range(len(left)):
        total = np.int32(total + np.int32(abs(np.int32(np.int32(left[p]) - np.int32(right[p])))))
    return total
