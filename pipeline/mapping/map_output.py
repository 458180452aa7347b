"""Writes a 3-D map as a point cloud that `yearloc pack --map` and other programs read.

The form is told by the path: FILE.pcd, FILE.ply, or a folder of Autoware's tiles. Coordinates are
32-bit floats, which every program reads. Where these would round by more than ROUNDED_M, files hold
64-bit floats, and tiles, of which Autoware reads 32-bit floats alone, are refused.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Self

import numpy as np

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.replacing import replace
from pipeline.formats import autoware, pcd, ply
from pipeline.mapping.tiled_map import GRAIN_M, TiledMap

ROUNDED_M = GRAIN_M
"""Coordinates may be rounded by this, which points are rounded by anyway."""
SIDE_M = 20
"""Side of Autoware's tiles, as its pointcloud_divider makes them."""
HEADERS: dict[str, Callable[[int, str, Literal[4, 8]], bytes]] = {
    ".pcd": pcd.encode_header,
    ".ply": ply.encode_header,
}
"""What makes a file's header, by its suffix."""


@dataclass(frozen=True)
class MapOutput:
    """Where a map is written, and in which form."""

    path: Path
    is_folder: bool
    """Whether it is a folder of tiles."""

    @classmethod
    def of(cls, text: str) -> Self:
        """The output that a user names: FILE.pcd, FILE.ply or a folder.

        A folder ends in a slash, is there already, or has no suffix. Raises ConfigError for another
        ending, and for a folder that holds anything else than a map.
        """
        path = Path(text)
        is_folder = text.endswith("/") or path.is_dir() or not path.suffix
        if is_folder:
            autoware.refuse_other_content(path)
        elif path.suffix not in HEADERS:
            raise ConfigError(
                f"{path}: expected a map FILE.pcd, FILE.ply or a folder of tiles, FOLDER/"
            )
        return cls(path, is_folder)

    def write(self, tiled: TiledMap, comment: str = "") -> list[str]:
        """Write a map, whole or not at all; returns lines on what was written.

        A `comment` of one line of ASCII heads each file. Raises InputError for a map without
        points, ConfigError for tiles of a map too far from its origin.
        """
        count = len(tiled.points)
        if not count:
            raise InputError(f"{self.path}: a map without points, nothing was written")
        farthest_m = max(float(np.abs(tile_m).max(initial=0)) for tile_m in tiled.tiles_m())
        rounded_m = float(np.spacing(np.float32(farthest_m))) / 2
        is_rounded = rounded_m > ROUNDED_M
        reach = f"coordinates reach {farthest_m / 1e3:,.0f} km, where 32-bit floats round by "
        reach += f"{rounded_m:.2g} m"
        if self.is_folder and is_rounded:
            raise ConfigError(
                f"{self.path}: {reach}, and Autoware's tiles hold no others: write FILE.ply, or "
                "pack the map with --origin"
            )
        if self.is_folder:
            tiles = autoware.write_tiles(self.path, tiled.tiles_m(), SIDE_M, comment)
            return [f"{self.path}: {count:,} points in {len(tiles.corners_m)} tiles of {SIDE_M} m"]
        size: Literal[4, 8] = 8 if is_rounded else 4
        with replace(self.path) as scratch, scratch.open("wb") as file:
            file.write(HEADERS[self.path.suffix](count, comment, size))
            for tile_m in tiled.tiles_m():
                file.write(np.ascontiguousarray(tile_m, f"<f{size}").tobytes())
        lines = [f"{self.path}: {count:,} points, {self.path.stat().st_size / 1e6:.1f} MB"]
        if is_rounded:
            lines.append(f"{self.path}: {reach}: it holds 64-bit floats")
        return lines
