"""The streets of a world, and the routes of its sequences on them.

The training route is random or follows a trajectory file, and test routes are planned relative to
it (`layout.plan`). For a robot that drives loops, each log has streets and a route of its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

import numpy as np

from pipeline.core.errors import ConfigError
from worlds import Floats
from worlds.layout.plan import (
    Plan,
    follow,
    half_edges_through,
    plan_loops,
    plan_test,
    plan_training,
)
from worlds.layout.streets import Streets, add_route, build_streets
from worlds.seeds import Stream, generator

MIN_ROUTE_M = 30.0
"""Least length of a route from a file."""
TUM_COLUMNS = 8
"""Columns of a row of a TUM trajectory: stamp x y z qx qy qz qw."""


@dataclass(frozen=True)
class Routes:
    """The streets, and the plan of the training sequence on them, or of one log with loops."""

    seed: int
    streets: Streets
    training: Plan
    route_m: float
    """Length of every sequence."""

    def test(self, when: date, shares: Mapping[str, float]) -> Plan:
        """Plan a test sequence on a date, with the wanted shares `unseen` and `reversed`."""
        rng = generator(self.seed, Stream.TEST_PLAN, when)
        return plan_test(
            rng, self.streets, self.training, self.route_m, shares["unseen"], shares["reversed"]
        )


def training_routes(
    seed: int, blocks: int, route_m: float, route_file: str | None, streets_only: bool
) -> Routes:
    """Plan a random training route of `route_m` metres, or one along a trajectory file.

    The latter is at most as long as `route_m`. With `streets_only` there are no footpaths. Raises
    ConfigError for a file that cannot be read or driven.
    """
    streets = build_streets(generator(seed, Stream.STREETS), blocks)
    if route_file is None:
        training = plan_training(generator(seed, Stream.TRAINING_PLAN), streets, route_m)
        return Routes(seed, _paved(streets, streets_only), training, route_m)
    route = read_route(Path(route_file))
    spans_m = np.ptp(route, axis=0)
    world_m = np.ptp(streets.nodes_m, axis=0)
    if (spans_m > world_m).any():
        raise ConfigError(
            f"route_file={route_file}: spans {spans_m[0]:.0f} × {spans_m[1]:.0f} m, the world of "
            f"blocks={blocks} only {world_m[0]:.0f} × {world_m[1]:.0f} m"
        )
    streets, corners = add_route(streets, route)
    training = follow(streets, half_edges_through(streets, corners))
    length_m = float(np.hypot(*np.diff(training.line_m, axis=0).T).sum())
    if length_m < MIN_ROUTE_M:
        raise ConfigError(
            f"route_file={route_file}: only {length_m:.0f} m long, needs at least "
            f"{MIN_ROUTE_M:.0f} m"
        )
    return Routes(seed, _paved(streets, streets_only), training, min(route_m, length_m))


def loop_routes(
    seed: int, blocks: int, route_m: float, streets_only: bool, shares: Mapping[str, float]
) -> Routes:
    """Plan a route of `route_m` metres whose second half meets its first half again.

    The second half has the wanted `shares`, `unseen` and `reversed`, relative to the first.
    """
    streets = build_streets(generator(seed, Stream.STREETS), blocks)
    plan = plan_loops(
        generator(seed, Stream.LOOPS), streets, route_m, shares["unseen"], shares["reversed"]
    )
    return Routes(seed, _paved(streets, streets_only), plan, route_m)


def _paved(streets: Streets, streets_only: bool) -> Streets:
    """The streets, without footpaths if `streets_only`: they become roads."""
    return replace(streets, is_path=np.zeros_like(streets.is_path)) if streets_only else streets


def read_route(path: Path) -> Floats:
    """Read a route (n, 2) in metres, and centre its bounding box on the origin.

    The file has rows of x, y, or TUM rows (stamp x y z qx qy qz qw), separated by commas or blanks.
    Comments start with #, and a first line of names is skipped. Raises ConfigError for any other
    file.
    """
    try:
        lines = [
            line.split("#")[0].replace(",", " ").split()
            for line in path.read_text(encoding="utf-8").splitlines()
        ]
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"route_file={path}: cannot be read as text: {error}") from None
    rows = [line for line in lines if line]
    if rows and not _are_numbers(rows[0]):
        rows = rows[1:]
    is_table = rows and all(len(row) == len(rows[0]) and _are_numbers(row) for row in rows)
    if not is_table or len(rows[0]) not in (2, TUM_COLUMNS):
        raise ConfigError(
            f"route_file={path}: expected rows of x, y or of TUM's stamp x y z qx qy qz qw"
        )
    xy_columns = [1, 2] if len(rows[0]) == TUM_COLUMNS else [0, 1]
    route_m = np.array(rows, float)[:, xy_columns]
    has_moved = np.hypot(*np.diff(route_m, axis=0).T) > 0
    if not np.isfinite(route_m).all() or not has_moved.any():
        raise ConfigError(f"route_file={path}: needs at least two different points, and no NaN")
    route_m = route_m[np.concatenate([[True], has_moved])]
    return np.asarray(route_m - (route_m.min(0) + route_m.max(0)) / 2)


def _are_numbers(row: list[str]) -> bool:
    """Whether all words of a row can be read as numbers."""
    try:
        [float(word) for word in row]
    except ValueError:
        return False
    return True
