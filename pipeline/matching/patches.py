"""Compares images as SeqSLAM does (METHODS 6): queries and references in, differences out.

Each image is made smaller (`resized`), each of its patches is brought to the same mean and
contrast (`normalised`), and two images are compared by the sum of absolute differences of their
pixels (`differences`).
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.core.errors import InputError

MEAN_GREY = 127
"""The mean of a normalised patch, in which one standard deviation is one grey level."""
TILE = 64
"""How many queries are compared at a time: few enough to stay in the L2 cache while all references
pass."""


def resized(images: NDArray[np.uint8], side_px: int) -> NDArray[np.uint8]:
    """Images (n, side, side) resized to `side_px` on each side; a pixel is the mean of its area."""
    side = images.shape[-1]
    if side == side_px:
        return np.ascontiguousarray(images)
    # share (new pixel, old pixel): how much of a new pixel each old one covers, along one axis
    edges = np.linspace(0, side, side_px + 1)[:, None]
    pixel = np.arange(side)
    covered = np.clip(edges[1:] - pixel, 0, 1) - np.clip(edges[:-1] - pixel, 0, 1)
    share = covered * (side_px / side)
    resized_images = np.empty((len(images), side_px, side_px), np.uint8)
    for image, resized_image in zip(images, resized_images, strict=True):
        resized_image[:] = np.rint(share @ image @ share.T)
    return resized_images


def normalised(images: NDArray[np.uint8], patch_px: int = 8) -> NDArray[np.uint8]:
    """Images (n, height, width) with each square patch brought to mean 127 and deviation 1.

    The deviation is the sample deviation, with one less than the number of pixels in the
    denominator. Results are rounded to whole numbers, halves away from the mean; a patch of a
    single grey becomes 127.
    Raises InputError unless whole patches fill an image.
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
    """Sums of absolute differences (n, m) between references (n, …) and queries (m, …), over n.

    SeqSLAM divides by n too, which scales all differences by the same factor. Raises InputError for
    images of different shapes.
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
    _sums(reference_pixels, query_pixels, out_sums=sums)
    sums_over_n: NDArray[np.float32] = sums.astype(np.float32)
    sums_over_n /= max(len(reference_pixels), 1)
    return sums_over_n


@njit(cache=True, nogil=True, boundscheck=False, error_model="numpy")
def _normalised(images, side, out):  # type: ignore[no-untyped-def]
    """Write images (n, height, width) with patches of `side` pixels normalised to `out`."""
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
                # The sample variance is spread / (number (number − 1)), and a pixel lies above the
                # mean by (number value − total) / number: that is (number value − total) · scale
                # deviations. Spread is exact, since all are whole numbers; that of a single
                # grey is 0, and counts as 1.
                spread = number * squares - total * total
                scale = math.sqrt((number - 1) / (number * max(spread, 1)))
                for row in range(top, top + side):
                    for column in range(left, left + side):
                        deviations = (number * np.int64(images[n, row, column]) - total) * scale
                        rounded = math.floor(abs(deviations) + 0.5)
                        out[n, row, column] = min(
                            max(MEAN_GREY + (rounded if deviations > 0 else -rounded), 0), 255
                        )


@njit(cache=True, nogil=True, boundscheck=False, error_model="numpy")
def _sums(references, queries, out_sums):  # type: ignore[no-untyped-def]
    """Write the difference of each reference (n, pixels) and query (m, pixels) to `out_sums`."""
    for start in range(0, len(queries), TILE):
        for i in range(len(references)):
            for j in range(start, min(start + TILE, len(queries))):
                out_sums[i, j] = _difference(references[i], queries[j])


@njit(cache=True, nogil=True, boundscheck=False, error_model="numpy")
def _difference(left, right):  # type: ignore[no-untyped-def]
    """Sum of absolute differences of two images (pixels,).

    All numbers are int32, since only then the compiler uses the processor's own instruction.
    """
    total = np.int32(0)
    for p in range(len(left)):
        total = np.int32(total + np.int32(abs(np.int32(np.int32(left[p]) - np.int32(right[p])))))
    return total
