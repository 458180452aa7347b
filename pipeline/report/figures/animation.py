"""Writes moving pictures: few colours, unchanged pixels left out, the same bytes each time.

In: frames as pixels, and a palette. Out: a file as .gif, .webp or animated .png.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.font_manager import findfont
from numpy.typing import NDArray
from PIL import Image, ImageFont
from PIL.ImageColor import getrgb
from scipy.spatial import KDTree

from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.core.store import replace

ENDINGS = {".gif": "GIF", ".webp": "WEBP", ".png": "PNG"}
FRAME_MS = 80  # how long a frame is shown
END_MS = 2500  # how long the last frame is shown
BLENDS = 9  # shades from white to an ink, as letters and lines have at their edges


def check_ending(path: Path) -> None:
    """Raise ConfigError for a file name that is not of a moving picture."""
    if path.suffix not in ENDINGS:
        raise ConfigError(f"{path}: expected a name that ends in {', '.join(ENDINGS)}")


def spread(count: int, most_frames: int) -> NDArray[np.int64]:
    """At most `most_frames` (frame,) of the queries 0 to count − 1, evenly spread, the last too."""
    return np.linspace(0, count - 1, min(count, most_frames)).round().astype(np.int64)


def palette(inks: Sequence[str], plain: Sequence[str]) -> NDArray[np.uint8]:
    """The colours (colour, 3) of inks with their shades down to white, and of plain ones.

    A file has room for 256 of them.
    """
    strength = np.linspace(0, 1, BLENDS)[:, None, None]
    shades = 1 - strength * (1 - np.array([getrgb(ink) for ink in inks]) / 255)
    shaded = np.rint(255 * shades.reshape(-1, 3)).astype(np.uint8)
    return np.unique(np.concatenate([rgb(plain), shaded]), axis=0)


def rgb(inks: Sequence[str]) -> NDArray[np.uint8]:
    """Inks such as `#1878C7` or `white` as pixels (ink, 3)."""
    return np.array([getrgb(ink) for ink in inks], np.uint8)


def save(
    frames: Iterable[NDArray[np.uint8]], path: Path, table: NDArray[np.uint8]
) -> tuple[int, int]:
    """Write frames (height, width, 3) that repeat for ever, as a moving picture.

    Pixels take the nearest colours of the palette `table`. Returns the number of frames and the
    file's bytes. Raises ConfigError where `check_ending` does.
    """
    check_ending(path)
    tree = KDTree(table)
    first, *later_frames = (_indexed(frame, table, tree) for frame in frames)
    durations_ms = [FRAME_MS] * len(later_frames) + [END_MS]
    with replace(path) as scratch:
        first.save(
            scratch,
            ENDINGS[path.suffix],
            save_all=True,
            append_images=later_frames,
            duration=durations_ms,
            loop=0,
            lossless=True,
            optimize=True,
        )
    return len(durations_ms), path.stat().st_size


def write(
    path: Path,
    count: int,
    most_frames: int,
    frame: Callable[[int], NDArray[np.uint8]],
    inks: Sequence[str],
    plain: Sequence[str],
    progress: Progress,
) -> tuple[int, int]:
    """Draw and save at most `most_frames` of `count` moments, evenly spread; see `save`."""
    shown = spread(count, most_frames).tolist()
    frames = progress.track(map(frame, shown), len(shown), "frames")
    return save(frames, path, palette(inks, plain))


def _indexed(frame: NDArray[np.uint8], table: NDArray[np.uint8], tree: KDTree) -> Image.Image:
    """A frame as indices into the palette, each pixel in its nearest colour."""
    # one number per colour: the nearest of the palette is looked up once for each
    packed = frame.astype(np.uint32) @ np.array([65536, 256, 1], np.uint32)  # (height, width)
    colours, colour_of_pixel = np.unique(packed, return_inverse=True)
    unpacked = np.stack([colours >> 16, colours >> 8 & 255, colours & 255], axis=1)
    _, nearest = tree.query(unpacked)
    image = Image.fromarray(np.asarray(nearest, np.uint8)[colour_of_pixel].reshape(frame.shape[:2]))
    image.putpalette(table.tobytes())
    return image


@cache
def font(size_px: int, bold: bool = False) -> Any:
    """A font that comes with matplotlib."""
    return ImageFont.truetype(findfont(f"DejaVu Sans:{'bold' if bold else 'regular'}"), size_px)
