"""Reads and writes Autoware's point-cloud maps: a folder of PCD tiles and a yaml of their corners.

The yaml, pointcloud_map_metadata.yaml, is as autoware_map_loader reads it:

    x_resolution: 20.0
    y_resolution: 20.0
    1200_2500.pcd: [1200, 2500]    # 1200 <= x < 1220, 2500 <= y < 2520

Resolutions are metres; the loader reads corners as whole numbers.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.core.errors import ConfigError, InputError, LogError
from pipeline.core.replacing import replace
from pipeline.formats import pcd

METADATA = "pointcloud_map_metadata.yaml"
"""The name of the yaml, which lies beside the tiles or beside their folder."""
SIDES = ("x_resolution", "y_resolution")
METADATA_BYTES = 2**25
"""Limit for the yaml; a tile takes some 40 bytes."""


@dataclass(frozen=True)
class Metadata:
    """The tiles of a map."""

    side_m: tuple[float, float]
    """The size of a tile along x and y."""
    corners_m: dict[str, tuple[float, float]]
    """The least x and y of each tile, by the name of its file."""


def read_metadata(path: Path) -> Metadata | None:
    """The tiles that the yaml at `path` names; None for a yaml of anything else.

    Raises LogError naming the key that is wrong.
    """
    with path.open("rb") as file:
        data = file.read(METADATA_BYTES + 1)
    if SIDES[0].encode() not in data or SIDES[1].encode() not in data:
        return None
    try:
        keys = yaml.safe_load(data) if len(data) <= METADATA_BYTES else None
    except (yaml.YAMLError, ValueError, RecursionError):
        keys = None
    if not isinstance(keys, dict):
        raise LogError(f"{path}: no readable metadata of a point-cloud map; write it again")
    if not all(side in keys for side in SIDES):
        return None
    side_x_m, side_y_m = (_number(path, side, keys.pop(side)) for side in SIDES)
    corners_m = {}
    for name, corner in keys.items():
        if not isinstance(corner, list) or len(corner) != 2:
            raise LogError(f"{path}: {name}: {corner}; expected the tile's least x and y: [X, Y]")
        corners_m[str(name)] = (
            _number(path, str(name), corner[0]),
            _number(path, str(name), corner[1]),
        )
    return Metadata((side_x_m, side_y_m), corners_m)


def write_tiles(
    folder: Path, blocks: Iterable[NDArray[np.float64]], side_m: int, comment: str = ""
) -> Metadata:
    """Write blocks (n, 3) of points in metres as square tiles X_Y.pcd and their metadata.

    A tile is named after its corner, has sides of `side_m` metres, and stores 32-bit floats, as
    Autoware reads them. A `comment` of one line of ASCII heads the tiles and the yaml. The folder
    is written whole or not at all. Raises InputError for points that are not finite and for no
    points, ConfigError for a folder that holds anything else than tiles.
    """
    if side_m < 1:
        raise InputError(f"tiles of {side_m} m: expected at least 1 m")
    refuse_other_content(folder)
    counts: dict[tuple[int, int], int] = {}
    with replace(folder) as scratch:
        scratch.mkdir()
        for block in blocks:
            _append(scratch, counts, block, side_m)
        if not counts:
            raise InputError("no points to write as tiles")
        for corner, count in counts.items():
            tile = scratch / _name(corner)
            tile.write_bytes(pcd.encode_header(count, comment) + tile.read_bytes())
        corners = {_name(corner): list(corner) for corner in sorted(counts)}
        sides = dict.fromkeys(SIDES, float(side_m))
        text = yaml.safe_dump(sides | corners, sort_keys=False, default_flow_style=None)
        comment_line = f"# {comment}\n" if comment else ""
        (scratch / METADATA).write_text(comment_line + text, encoding="utf-8")
    return Metadata(
        (float(side_m), float(side_m)),
        {_name(corner): (float(corner[0]), float(corner[1])) for corner in sorted(counts)},
    )


def refuse_other_content(folder: Path) -> None:
    """Raise ConfigError if the folder is there, which is replaced, and holds more than a map."""
    if not folder.exists():
        return
    names = sorted(path.name for path in folder.iterdir()) if folder.is_dir() else [folder.name]
    others = [name for name in names if not name.endswith(".pcd") and name != METADATA]
    if others or not folder.is_dir():
        raise ConfigError(f"{folder}: holds {(others or names)[0]} beside tiles; name a new folder")


def _number(path: Path, key: str, value: Any) -> float:
    """A value of the yaml as a number of metres."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise LogError(f"{path}: {key}: {value}; expected metres")
    return float(value)


def _name(corner: tuple[int, int]) -> str:
    """The name of the tile with this corner."""
    return f"{corner[0]}_{corner[1]}.pcd"


def _append(
    folder: Path,
    counts: dict[tuple[int, int], int],
    block: NDArray[np.float64],
    side_m: int,
) -> None:
    """Append the points of a block to the files of their tiles, which get their headers later."""
    # A point lies in its tile as it is stored, so it is rounded first.
    stored = np.ascontiguousarray(block, "<f4")
    if not np.isfinite(stored).all():
        raise InputError("points to write as tiles: expected finite coordinates")
    tiles = np.floor(stored[:, :2].astype(np.float64) / side_m).astype(np.int64)
    order = np.lexsort((tiles[:, 1], tiles[:, 0]))
    ordered = tiles[order]
    starts = np.flatnonzero(np.any(np.diff(ordered, axis=0) != 0, axis=1)) + 1
    for rows in np.split(order, starts):
        if not len(rows):
            continue
        column, row = (int(index) for index in tiles[rows[0]])
        corner = (column * side_m, row * side_m)
        counts[corner] = counts.get(corner, 0) + len(rows)
        with (folder / _name(corner)).open("ab") as file:
            file.write(stored[rows].tobytes())
