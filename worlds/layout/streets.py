"""The street graph of a world: corners on a jittered grid, and straight streets between them.

Some streets of the grid are missing, some are footpaths, and some footpaths run diagonally. A route
from a file can be added as a further footpath.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from worlds import Floats

PITCH_M = 95.0
"""Mean distance between corners, before PITCH_FACTOR_BOUNDS."""
PITCH_FACTOR_BOUNDS = (0.75, 1.3)
"""Bounds of the random factor of each distance."""
JITTER_SD_M = 10.0
"""Standard deviation of the jitter of corners, on each axis."""
JITTER_CLIP_M = 18.0
REMOVED_SHARE = 0.15
"""Share of the grid's streets that are removed, if their corners have enough others."""
DIAGONAL_SHARE = 0.08
"""Share of the blocks with a diagonal footpath."""
PATH_SHARE = 0.35
"""Share of the grid's streets that are footpaths."""
PATH_HALF_WIDTH_M = 2.0
ROAD_HALF_WIDTH_M = 4.0

ROUTE_STEP_M = 10.0
"""Distance between the corners of an added route."""
ROUTE_MERGE_M = 5.0
"""An added route shares a corner with itself where it comes nearer to it than this."""
ROUTE_LINK_EVERY = 10
"""One in so many corners of an added route is linked to the grid."""


@dataclass(frozen=True)
class Streets:
    """v corners, and e straight streets between them."""

    nodes_m: Floats
    """(v, 2) the corners; the first (blocks + 1)² are those of the grid, row by row in x."""
    edges: NDArray[np.int64]
    """(e, 2) the corners at which each street starts and ends."""
    is_path: NDArray[np.bool_]
    """(e,) whether each street is a footpath; the others are roads."""

    @property
    def starts_m(self) -> Floats:
        """(e, 2) the starts of the streets."""
        return self.nodes_m[self.edges[:, 0]]

    @property
    def ends_m(self) -> Floats:
        """(e, 2) the ends of the streets."""
        return self.nodes_m[self.edges[:, 1]]

    @property
    def lengths_m(self) -> Floats:
        """(e,) the lengths of the streets."""
        return np.asarray(np.hypot(*(self.ends_m - self.starts_m).T))

    @property
    def half_widths_m(self) -> Floats:
        """(e,) half the widths of the streets."""
        return np.where(self.is_path, PATH_HALF_WIDTH_M, ROAD_HALF_WIDTH_M)

    def directions(self) -> tuple[Floats, Floats]:
        """Unit vectors (e, 2) along each street, and (e, 2) to its left."""
        along = (self.ends_m - self.starts_m) / self.lengths_m[:, None]
        return along, np.stack([-along[:, 1], along[:, 0]], 1)

    def beside(self, street: int, stations_m: Floats, left_m: Floats | float) -> Floats:
        """World points (n, 2) along a street.

        They are `stations_m` (n,) from its start, and `left_m` to the left of its middle, (n,) or
        the same for all.
        """
        along, left = self.directions()
        return np.asarray(
            self.starts_m[street]
            + stations_m[:, None] * along[street]
            + np.reshape(left_m, (-1, 1)) * left[street]
        )

    def clearance_m(self, points_m: Floats) -> Floats:
        """Distance (n,) from points (n, 2) to the border of the nearest street; negative on one."""
        gaps_m = distance_to_segments_m(points_m, self.starts_m, self.ends_m) - self.half_widths_m
        return np.asarray(gaps_m.min(1))


def distance_to_segments_m(points_m: Floats, starts_m: Floats, ends_m: Floats) -> Floats:
    """Distances (n, e) from points (n, 2) to segments from `starts_m` (e, 2) to `ends_m` (e, 2)."""
    span_x, span_y = (ends_m - starts_m).T
    off_x = points_m[:, :1] - starts_m[:, 0]
    off_y = points_m[:, 1:] - starts_m[:, 1]
    share = ((off_x * span_x + off_y * span_y) / (span_x**2 + span_y**2)).clip(0, 1)
    return np.asarray(np.hypot(off_x - share * span_x, off_y - share * span_y))


def driven_m(line_m: Floats) -> Floats:
    """Metres (n,) from the start of a polyline (n, 2) to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line_m, axis=0).T))])


def points_along(line_m: Floats, stations_m: Floats) -> Floats:
    """Points (m, 2) on a polyline (n, 2), `stations_m` (m,) from its start."""
    return np.stack([np.interp(stations_m, driven_m(line_m), axis) for axis in line_m.T], 1)


def build_streets(rng: np.random.Generator, blocks: int) -> Streets:
    """Build the random streets of blocks × blocks blocks around the origin.

    Every corner has at least two streets.
    """
    # 1. Place the corners.
    side = blocks + 1
    grid_x_m = np.cumsum([0.0, *(rng.uniform(*PITCH_FACTOR_BOUNDS, blocks) * PITCH_M)])
    grid_y_m = np.cumsum([0.0, *(rng.uniform(*PITCH_FACTOR_BOUNDS, blocks) * PITCH_M)])
    grid_m = np.stack(np.meshgrid(grid_x_m, grid_y_m, indexing="ij"), -1).reshape(-1, 2)
    nodes_m = grid_m + rng.normal(0, JITTER_SD_M, grid_m.shape).clip(-JITTER_CLIP_M, JITTER_CLIP_M)
    nodes_m -= (nodes_m.min(0) + nodes_m.max(0)) / 2

    # 2. Join neighbours along both axes, and remove some of these streets.
    corners = np.arange(side * side).reshape(side, side)  # their numbers, by column and row
    along_x = np.stack([corners[:-1].ravel(), corners[1:].ravel()], 1)
    along_y = np.stack([corners[:, :-1].ravel(), corners[:, 1:].ravel()], 1)
    grid_edges = _thinned_out(rng.permutation(np.concatenate([along_x, along_y])), side * side)

    # 3. Add diagonals, and make some streets footpaths.
    diagonals = np.stack([corners[:-1, :-1].ravel(), corners[1:, 1:].ravel()], 1)
    diagonals = diagonals[rng.random(len(diagonals)) < DIAGONAL_SHARE]
    is_grid_path = rng.random(len(grid_edges)) < PATH_SHARE
    is_path = np.concatenate([is_grid_path, np.ones(len(diagonals), bool)])
    return Streets(nodes_m, np.concatenate([grid_edges, diagonals]), is_path)


def _thinned_out(edges: NDArray[np.int64], nodes: int) -> NDArray[np.int64]:
    """The shuffled edges without the share REMOVED_SHARE of them, or fewer."""
    streets_at = np.bincount(edges.ravel(), minlength=nodes)
    remaining = []
    to_remove = int(REMOVED_SHARE * len(edges))
    for start, end in edges:
        if to_remove and streets_at[start] > 2 and streets_at[end] > 2:
            streets_at[[start, end]] -= 1
            to_remove -= 1
        else:
            remaining.append((start, end))
    return np.array(remaining)


def add_route(streets: Streets, route_m: Floats) -> tuple[Streets, list[int]]:
    """Add a route (n, 2) as a footpath; returns also the corners that it visits in order.

    Where the route meets itself it shares corners. Links connect it to the grid, so that other
    sequences can leave it.
    """
    # 1. Sample the route; it gets a new corner where none of its own is near.
    length_m = driven_m(route_m)[-1]
    n_stops = max(2, round(length_m / ROUTE_STEP_M) + 1)
    first, *stops = points_along(route_m, np.linspace(0, length_m, n_stops))
    grid_corners = len(streets.nodes_m)
    nodes = [*streets.nodes_m, first]
    visited_corners = [grid_corners]
    for stop in stops:
        gaps_m = np.hypot(*(np.array(nodes[grid_corners:]) - stop).T)
        gaps_m[visited_corners[-1] - grid_corners] = np.inf  # never the corner just visited
        if gaps_m.min() < ROUTE_MERGE_M:
            visited_corners.append(grid_corners + int(gaps_m.argmin()))
        else:
            visited_corners.append(len(nodes))
            nodes.append(stop)
    steps = {(min(pair), max(pair)) for pair in pairwise(visited_corners)}

    # 2. Link some of its corners to the nearest ones of the grid, unless they are the same.
    links = set()
    for node in range(grid_corners, len(nodes), ROUTE_LINK_EVERY):
        grid_distances_m = np.hypot(*(streets.nodes_m - nodes[node]).T)
        nearest = int(grid_distances_m.argmin())
        if grid_distances_m[nearest] > 0:
            links.add((nearest, node))

    new_edges = np.array(sorted(steps | links))
    edges = np.concatenate([streets.edges, new_edges])
    is_path = np.concatenate([streets.is_path, np.ones(len(new_edges), bool)])
    return replace(streets, nodes_m=np.array(nodes), edges=edges, is_path=is_path), visited_corners
