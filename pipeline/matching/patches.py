"""Images as SeqSLAM compares them: patches of one brightness and contrast, and sums of absolute
differences (METHODS 6)."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pipeline.errors import InputError

GREY = 127  # what a patch's mean becomes; one standard deviation is 1 more
TILE = 64  # queries at a time: few enough to stay in the L2 cache while every reference passes


def resized(images: NDArray[np.uint8], side_px: int) -> NDArray[np.uint8]:
    """Images (n, side, side) at another side, each new pixel the mean of the area that it
    covers."""
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
    """Images (n, height, width) in standard deviations (n − 1 in the denominator) from each square
    patch's mean, plus 127.

    Rounded, a half away from the mean; a patch of one grey is 127 throughout. Raises InputError
    unless patches fill an image.
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
    """Sums of absolute differences (n, m) of queries (m, …) from references (n, …) of the same
    shape, divided by n.

    The divisor is SeqSLAM's; it scales all alike. Raises InputError for images of different shapes.
    """
    if references.shape[1:] != queries.shape[1:]:
        raise InputError(
            f"queries of shape {queries.shape[1:]}: expected {references.shape[1:]} like the "
            "references"
        )
    pixels = math.prod(references.shape[1:])
    left, right = (
        np.ascontiguousarray(images, np.uint8).reshape(len(images), pixels)
        for images in (references, queries)
    )
    sums = np.empty((len(left), len(right)), np.int32)
    _sums(left, right, sums)
    scaled: NDArray[np.float32] = sums.astype(np.float32)
    scaled /= max(len(left), 1)
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
    for first in range(0, len(queries), TILE):
        for i in range(len(references)):
            for j in range(first, min(first + TILE, len(queries))):
                sums[i, j] = _difference(references[i], queries[j])


@njit(cache=True, nogil=True, boundscheck=False, error_model="numpy")
def _difference(left, right):  # type: ignore[no-untyped-def]
    """In int32 throughout: only so does the compiler find the processor's own sum of absolute
    differences."""
    total = np.int32(0)
    for p in range(len(left)):
        total = np.int32(total + np.int32(abs(np.int32(np.int32(left[p]) - np.int32(right[p])))))
    return total
