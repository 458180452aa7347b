"""Reads and writes the occupancy maps of ROS's navigation, Nav2: a yaml beside an image.

They are as nav2_map_server reads and map_saver writes them. The shade of a pixel, 0 for black and 1
for white, becomes the occupied share 1 − shade, or the shade itself if `negate` is set. The mode
turns it into the occupancy of a cell:

    trinary    occupied, free or unknown, by the two thresholds
    scale      a percentage between the thresholds; unknown where the pixel is transparent
    raw        the pixel's value from 0 to 255 is the percentage; unknown over 100
"""

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.replacing import replace, write_text
from pipeline.core.settings import filled, plain

Mode = Literal["trinary", "scale", "raw"]
UNKNOWN = -1
FREE = 0
OCCUPIED = 100
"""Occupancies of cells in percent, as in nav_msgs/OccupancyGrid."""
OCCUPIED_THRESH = 0.65
FREE_THRESH = 0.196
"""Thresholds of the occupied share, as map_saver writes them."""
LARGEST_PIXELS = 50_000_000
"""Limit for an image."""
LARGEST_BYTES = 2**16
"""Limit for a yaml."""
OCCUPIED_PIXEL = 0
UNKNOWN_PIXEL = 205
FREE_PIXEL = 254
"""Values of pixels, as map_saver writes them."""


@dataclass(frozen=True, kw_only=True)
class Keys:
    """The keys of a map's yaml, as Nav2 names them."""

    image: str
    """The name of the image, a .pgm or .png beside the yaml."""
    mode: Mode = "trinary"
    resolution: float
    """Metres of a pixel."""
    origin: tuple[float, float, float]
    """x, y in metres and yaw in radians of the outer corner of the lower left pixel."""
    negate: Literal[0, 1] = 0
    """Whether white is occupied."""
    occupied_thresh: float = OCCUPIED_THRESH
    free_thresh: float = FREE_THRESH


@dataclass(frozen=True)
class GridMap:
    """An occupancy grid with the layout of ROS."""

    occupancy: NDArray[np.int8]
    """(row, col) in percent, UNKNOWN where nothing is known; row 0 is the lowest of the image."""
    resolution_m: float
    origin: tuple[float, float, float]
    """x, y in metres and yaw in radians of the outer corner of the lower left pixel."""


def read(path: Path) -> GridMap:
    """Read the map whose yaml is at `path`.

    Raises ArtifactError for a file that is missing or no map, naming the key that is wrong.
    """
    # 1. the yaml
    try:
        keys = filled(Keys, _yaml(path))
    except ConfigError as error:
        raise ArtifactError(f"{path}: {error}") from None
    free_thresh = keys.free_thresh
    occupied_thresh = keys.occupied_thresh
    if not 0 <= free_thresh < occupied_thresh <= 1:
        raise ArtifactError(
            f"{path}: free_thresh={free_thresh:g} and occupied_thresh={occupied_thresh:g}: "
            "expected 0 <= free < occupied <= 1"
        )
    # 2. from pixels to cells
    shade, is_opaque = _image(path.parent / keys.image)
    if keys.mode == "raw":
        percent = np.round(255 * shade)
        cells = np.where(percent <= OCCUPIED, percent, UNKNOWN)
    else:
        share = shade if keys.negate else 1 - shade
        cells = np.full(share.shape, float(UNKNOWN))
        if keys.mode == "scale":
            cells = np.rint((share - free_thresh) / (occupied_thresh - free_thresh) * 100)
        cells[share < free_thresh] = FREE
        cells[share > occupied_thresh] = OCCUPIED
        if keys.mode == "scale":
            cells[~is_opaque] = UNKNOWN
    # 3. the image begins with its highest row, the grid with its lowest
    occupancy = np.ascontiguousarray(cells[::-1].astype(np.int8))
    x_m, y_m, yaw_rad = map(float, keys.origin)
    return GridMap(occupancy, float(keys.resolution), (x_m, y_m, yaw_rad))


def write(path: Path, grid: GridMap, comment: str = "") -> None:
    """Write a map of mode `trinary`: FILE.yaml at `path`, and its image beside it as FILE.pgm.

    A `comment` of one line heads the yaml.
    """
    cells = grid.occupancy[::-1].astype(np.int64)
    pixels = np.full(cells.shape, UNKNOWN_PIXEL, np.uint8)
    pixels[(cells >= 0) & (cells <= 100 * FREE_THRESH)] = FREE_PIXEL
    pixels[cells >= 100 * OCCUPIED_THRESH] = OCCUPIED_PIXEL
    image = path.with_suffix(".pgm")
    rows, cols = cells.shape
    with replace(image) as scratch:
        scratch.write_bytes(f"P5\n{cols} {rows}\n255\n".encode() + pixels.tobytes())
    keys = Keys(image=image.name, resolution=grid.resolution_m, origin=grid.origin)
    comment_line = f"# {comment}\n" if comment else ""
    write_text(path, comment_line + yaml.safe_dump(plain(keys, whole=True), sort_keys=False))


def _yaml(path: Path) -> dict[str, Any]:
    """The keys of a yaml; raises ArtifactError for a file that is missing, too large or no map."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except (FileNotFoundError, IsADirectoryError):
        raise ArtifactError(f"{path}: no such map; expected the .yaml of a Nav2 map") from None
    try:
        keys = yaml.safe_load(data) if len(data) <= LARGEST_BYTES else None
    except (yaml.YAMLError, ValueError, RecursionError):
        keys = None
    if not isinstance(keys, dict):
        raise ArtifactError(f"{path}: no map; expected the .yaml beside the image of a Nav2 map")
    return keys


def _image(path: Path) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Shades (row, col) from 0 to 1 of an image, and whether each pixel is opaque (row, col)."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path) as image:
            if image.width * image.height > LARGEST_PIXELS:
                raise ArtifactError(
                    f"{path}: {image.width} x {image.height} pixels: expected at most "
                    f"{LARGEST_PIXELS:,}"
                )
            colours = np.asarray(image.convert("RGB"), np.float64)
            is_opaque = np.ones(colours.shape[:2], bool)
            if "A" in image.getbands():
                is_opaque = np.asarray(image.getchannel("A")) == 255
    except FileNotFoundError:
        raise ArtifactError(f"{path}: no such image, though the map's yaml names it") from None
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, ValueError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:80]
        raise ArtifactError(f"{path}: no readable image ({reason}); save the map again") from None
    return colours.mean(axis=2) / 255, is_opaque
