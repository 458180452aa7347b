"""Reads a route from a trajectory file of the user, to simulate a site before it is recorded."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError

TUM_COLUMNS = 8


def read_route(path: Path) -> NDArray[np.float64]:
    """Route (n, 2) in metres, moved so that its bounding box is centred on the origin.

    The file has columns x, y, or TUM rows (stamp x y z qx qy qz qw), separated by commas or blanks; comments start with #, and a
    first line of names is skipped. Raises ConfigError for any other file.
    """
    try:
        lines = [line.split("#")[0].replace(",", " ").split() for line in path.read_text().splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"route_file={path}: cannot be read as text: {error}") from None
    rows = [line for line in lines if line]
    if rows and not _numbers(rows[0]):
        rows = rows[1:]
    if any(len(row) != len(rows[0]) or not _numbers(row) for row in rows) or not rows or len(rows[0]) not in (2, TUM_COLUMNS):
        raise ConfigError(f"route_file={path}: expected rows of x, y or of TUM's stamp x y z qx qy qz qw")
    first = 1 if len(rows[0]) == TUM_COLUMNS else 0
    route_m = np.array(rows, float)[:, first : first + 2]
    moved = np.hypot(*np.diff(route_m, axis=0).T) > 0
    if not np.isfinite(route_m).all() or not moved.any():
        raise ConfigError(f"route_file={path}: needs at least two different points, and no NaN")
    route_m = route_m[np.concatenate([[True], moved])]
    return np.asarray(route_m - (route_m.min(0) + route_m.max(0)) / 2)


def _numbers(row: list[str]) -> bool:
    try:
        [float(word) for word in row]
    except ValueError:
        return False
    return True
