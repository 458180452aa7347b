"""Nav2's maps: a yaml beside an image, as nav2_map_server reads and map_saver writes them.

A pixel's occupied share is 1 − shade, or its shade where `negate` is set. Mode `trinary` makes
three kinds of cell by the thresholds, `scale` a percentage between them, `raw` takes the pixel.
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
OCCUPIED_THRESH = 0.65
FREE_THRESH = 0.196
LARGEST_PIXELS = 50_000_000
LARGEST_BYTES = 2**16
"""Of a map's yaml."""
UNKNOWN_PIXEL = 205
FREE_PIXEL = 254


@dataclass(frozen=True)
class GridMap:
    """An occupancy grid as ROS has it."""

    occupancy: NDArray[np.int8]
    """(row, col) in percent, UNKNOWN where nothing is known; row 0 is the image's lowest."""
    resolution_m: float
    origin: tuple[float, float, float]
    """x, y in metres and yaw in radians of the lower left pixel's outer corner."""


def read(path: Path) -> GridMap:
    """Read a map by its yaml.

    Raises ArtifactError for a file that is missing or no map, naming the key that is wrong.
    """
    about = _yaml(path)
    resolution_m = _number(path, about, "resolution")
    origin = about.get("origin")
    if not isinstance(origin, list) or len(origin) != 3 or not all(map(_is_number, origin)):
        raise ArtifactError(f"{path}: origin={origin!s:.60}: expected [x, y, yaw]")
    mode = about.get("mode", "trinary")
    if mode not in get_args(Mode):
        raise ArtifactError(f"{path}: mode={mode!s:.60}: expected trinary, scale or raw")
    if not isinstance(about.get("image"), str):
        raise ArtifactError(f"{path}: no image; expected the name of a .pgm beside it")
    negate = about.get("negate", 0)
    if negate not in (0, 1):
        raise ArtifactError(f"{path}: negate={negate!s:.60}: expected 0 or 1")
    occupied = _number(path, about, "occupied_thresh", OCCUPIED_THRESH)
    free = _number(path, about, "free_thresh", FREE_THRESH)
    if not 0 <= free < occupied <= 1:
        raise ArtifactError(
            f"{path}: free_thresh={free:g} and occupied_thresh={occupied:g}: expected 0 <= free < "
            "occupied <= 1"
        )
    shade, opaque = _image(path.parent / about["image"])
    share = shade if negate else 1 - shade
    if mode == "raw":
        percent = np.round(255 * shade)
        cells = np.where(percent <= OCCUPIED, percent, UNKNOWN)
    else:
        between = np.rint((share - free) / (occupied - free) * 100) if mode == "scale" else UNKNOWN
        cells = np.where(share > occupied, OCCUPIED, np.where(share < free, FREE, between))
        if mode == "scale":
            cells = np.where(opaque, cells, UNKNOWN)
    return GridMap(
        np.ascontiguousarray(cells[::-1].astype(np.int8)),
        resolution_m,
        (float(origin[0]), float(origin[1]), float(origin[2])),
    )


def write(path: Path, grid: GridMap, mode: Mode = "trinary") -> None:
    """Write a map: the yaml, and an image of its name with .pgm beside it.

    Raises ConfigError for `scale` where cells are unknown: a .pgm cannot say so in this mode.
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
        between = FREE_THRESH + cells / 100 * (OCCUPIED_THRESH - FREE_THRESH)
        share = np.where(cells == FREE, 0.0, np.where(cells == OCCUPIED, 1.0, between))
        pixels = np.rint(255 * (1 - share)).astype(np.int64)
    else:
        pixels = np.where(
            cells >= 100 * OCCUPIED_THRESH,
            0,
            np.where(is_known & (cells <= 100 * FREE_THRESH), FREE_PIXEL, UNKNOWN_PIXEL),
        )
    image = path.with_suffix(".pgm")
    rows, cols = cells.shape
    with replace(image) as scratch:
        scratch.write_bytes(
            f"P5\n{cols} {rows}\n255\n".encode() + pixels.astype(np.uint8).tobytes()
        )
    about = {
        "image": image.name,
        "mode": mode,
        "resolution": grid.resolution_m,
        "origin": list(grid.origin),
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESH,
        "free_thresh": FREE_THRESH,
    }
    with replace(path) as scratch:
        scratch.write_text(yaml.safe_dump(about, sort_keys=False), encoding="utf-8")


def _yaml(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except (FileNotFoundError, IsADirectoryError):
        raise ArtifactError(f"{path}: no such map; expected the .yaml of a Nav2 map") from None
    try:
        about = yaml.safe_load(data) if len(data) <= LARGEST_BYTES else None
    except (yaml.YAMLError, ValueError, RecursionError):
        about = None
    if not isinstance(about, dict):
        raise ArtifactError(f"{path}: no map; expected the .yaml beside the image of a Nav2 map")
    return about


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _number(path: Path, about: dict[str, Any], key: str, missing: float = math.nan) -> float:
    value = about.get(key, missing)
    if not _is_number(value):
        shown = f"{value!s:.60}" if key in about else "missing"
        raise ArtifactError(f"{path}: {key}={shown}: expected a number")
    return float(value)


def _image(path: Path) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Shades (row, col) from 0 to 1 of an image, and which pixels are opaque."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings(action="ignore"), Image.open(path) as image:
            if image.width * image.height > LARGEST_PIXELS:
                raise ArtifactError(
                    f"{path}: {image.width} x {image.height} pixels: expected at most "
                    f"{LARGEST_PIXELS:,}"
                )
            has_alpha = "A" in image.getbands()
            opaque = np.asarray(image.getchannel("A")) == 255 if has_alpha else None
            colours = np.asarray(image.convert("RGB"), np.float64)
    except FileNotFoundError:
        raise ArtifactError(f"{path}: no such image, though the map's yaml names it") from None
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, ValueError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0][:80]
        raise ArtifactError(f"{path}: no readable image ({reason}); save the map anew") from None
    shade = colours.mean(axis=2) / 255
    return shade, np.ones(shade.shape, bool) if opaque is None else opaque
