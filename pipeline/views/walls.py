"""Walls from above as a view: points in, a chart of walls and of seen-through space out."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.settings import NotNegative, Positive, checked
from pipeline.mapping.wall_chart import SEEN_THROUGH, WALL, wall_chart, wall_points


@dataclass(frozen=True)
@checked("view")
class Walls:
    """How a scan's walls are drawn from above (METHODS 15)."""

    schema: ClassVar[type[schemas.Views]] = schemas.WallViews
    low_m: float = 1.0
    """Points between `low_m` and `high_m` above the ground are walls."""
    high_m: float = 8.0
    cell_m: Positive = 1.0
    """Side of a cell."""
    range_m: Positive = 60.0
    """Walls farther from the robot than this are left out."""
    margin_m: NotNegative = 2.0
    """A cell is seen through if it is nearer than the first wall in its direction by this."""

    def __post_init__(self) -> None:
        if not self.high_m > self.low_m:
            raise ConfigError(
                f"view.high_m={self.high_m}: expected more than view.low_m={self.low_m}"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """The shape of an image: cells along x, cells along y."""
        side = 2 * int(np.ceil(self.range_m / self.cell_m))
        return (side, side)

    def __call__(self, points_m: NDArray[np.floating]) -> NDArray[np.int8]:
        """The walls (x, y) of points (n, 3), z up from the ground, the robot in the middle.

        A cell is WALL, SEEN_THROUGH, or 0 (mapping/wall_chart.py). Raises InputError for points of
        another shape or not finite.
        """
        points = np.ascontiguousarray(points_m, np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError(f"points of shape {points.shape}: expected (n, 3)")
        if not np.isfinite(points).all():
            raise InputError("a point is NaN or infinite: drop such points first")
        walls_m = wall_points(points, self.low_m, self.high_m, self.range_m)
        cells = wall_chart(walls_m, self.cell_m, self.shape[0] // 2, self.margin_m)[0]
        return np.where((cells == WALL) | (cells == SEEN_THROUGH), cells, 0).astype(np.int8)
