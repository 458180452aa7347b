"""Reads and writes the occupancy maps of ROS's navigation, Nav2: a yaml beside an image.

They are as nav2_map_server reads and map_saver writes them. The shade of a pixel, 0 for black and 1
for white, becomes the occupied share 1 − shade, or the shade itself if `negate` is set. The mode
turns it into the occupancy of a cell:

    trinary    occupied, free or unknown, by the two thresholds
    scale      a percentage between the thresholds; unknown where the pixel is transparent
    raw        the pixel's value from 0 to 255 is the percentage; unknown over 100
"""

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.core.replacing import replace

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


@dataclass(frozen=True)
class GridMap:
    """An occupancy grid, laid out as in ROS."""

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
    keys = _yaml(path)
    resolution_m = _number(path, keys, "resolution")
    origin = keys.get("origin")
    if not isinstance(origin, list) or len(origin) != 3 or not all(map(_is_number, origin)):
        raise ArtifactError(f"{path}: origin={origin!s:.60}: expected [x, y, yaw]")
    mode = keys.get("mode", "trinary")
    if mode not in get_args(Mode):
        raise ArtifactError(f"{path}: mode={mode!s:.60}: expected trinary, scale or raw")
    if not isinstance(keys.get("image"), str):
        raise ArtifactError(f"{path}: no image; expected the name of a .pgm beside it")
    negate = keys.get("negate", 0)
    if negate not in (0, 1):
        raise ArtifactError(f"{path}: negate={negate!s:.60}: expected 0 or 1")
    occupied_thresh = _number(path, keys, "occupied_thresh", OCCUPIED_THRESH)
    free_thresh = _number(path, keys, "free_thresh", FREE_THRESH)
    if not 0 <= free_thresh < occupied_thresh <= 1:
        raise ArtifactError(
            f"{path}: free_thresh={free_thresh:g} and occupied_thresh={occupied_thresh:g}: "
            "expected 0 <= free < occupied <= 1"
        )
    # 2. from pixels to cells
    shade, is_opaque = _image(path.parent / keys["image"])
    if mode == "raw":
        percent = np.round(255 * shade)
        cells = np.where(percent <= OCCUPIED, percent, UNKNOWN)
    else:
        share = shade if negate else 1 - shade
        cells = np.full(share.shape, float(UNKNOWN))
        if mode == "scale":
            cells = np.rint((share - free_thresh) / (occupied_thresh - free_thresh) * 100)
        cells[share < free_thresh] = FREE
        cells[share > occupied_thresh] = OCCUPIED
        if mode == "scale":
            cells[~is_opaque] = UNKNOWN
    # 3. the image begins with its highest row, the grid with its lowest
    occupancy = np.ascontiguousarray(cells[::-1].astype(np.int8))
    x_m, y_m, yaw_rad = map(float, origin)
    return GridMap(occupancy, resolution_m, (x_m, y_m, yaw_rad))


def write(path: Path, grid: GridMap, mode: Mode = "trinary") -> None:
    """Write a map: the yaml at `path`, and its image beside it, with the suffix .pgm.

    Raises ConfigError for mode `scale` if a cell is unknown, which a .pgm cannot hold in that mode.
    """
    if path.suffix != ".yaml":
        raise ConfigError(f"{path}: expected FILE.yaml; its image is written beside it as FILE.pgm")
    cells = grid.occupancy[::-1].astype(np.int64)
    is_known = cells >= 0
    if mode == "scale" and not is_known.all():
        raise ConfigError(
            f"{path}: mode scale cannot hold the {(~is_known).sum():,} unknown cells in a .pgm; "
            "choose trinary or raw"
        )
    if mode == "raw":
        pixels = np.where(is_known, cells, 255)
    elif mode == "scale":
        share = FREE_THRESH + cells / 100 * (OCCUPIED_THRESH - FREE_THRESH)
        share[cells == FREE] = 0.0
        share[cells == OCCUPIED] = 1.0
        pixels = np.rint(255 * (1 - share)).astype(np.int64)
    else:
        pixels = np.full(cells.shape, UNKNOWN_PIXEL)
        pixels[is_known & (cells <= 100 * FREE_THRESH)] = FREE_PIXEL
        pixels[cells >= 100 * OCCUPIED_THRESH] = OCCUPIED_PIXEL
    image = path.with_suffix(".pgm")
    rows, cols = cells.shape
    with replace(image) as scratch:
        scratch.write_bytes(
            f"P5\n{cols} {rows}\n255\n".encode() + pixels.astype(np.uint8).tobytes()
        )
    keys = {
        "image": image.name,
        "mode": mode,
        "resolution": grid.resolution_m,
        "origin": list(grid.origin),
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESH,
        "free_thresh": FREE_THRESH,
    }
    with replace(path) as scratch:
        scratch.write_text(yaml.safe_dump(keys, sort_keys=False), encoding="utf-8")


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


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(path: Path, keys: dict[str, Any], key: str, default: float = math.nan) -> float:
    """The value of a key; raises ArtifactError if it is no number, or missing without a default."""
    value = keys.get(key, default)
    if not _is_number(value):
        value_text = f"{value!s:.60}" if key in keys else "missing"
        raise ArtifactError(f"{path}: {key}={value_text}: expected a number")
    return float(value)


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
        raise ArtifactError(f"{path}: no readable image ({reason}); save the map anew") from None
    return colours.mean(axis=2) / 255, is_opaque
