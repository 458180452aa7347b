"""The street graph: a jittered grid with missing edges and diagonal footpaths."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.world import Floats

PITCH_M = 95.0
PITCH_FACTORS = (0.75, 1.3)
JITTER_SD_M = 10.0
JITTER_CLIP_M = 18.0
REMOVED_SHARE = 0.15
DIAGONAL_SHARE = 0.08
PATH_SHARE = 0.35
PATH_HALF_WIDTH_M = 2.0
ROAD_HALF_WIDTH_M = 4.0

ROUTE_STEP_M = 10.0
ROUTE_MERGE_M = 5.0
ROUTE_LINK_EVERY = 10

Floats = Floats


@dataclass(frozen=True)
class Streets:
    """Corners and straight streets between them.

    Half-edge 2e is street e from start to end, 2e + 1 is the reverse.
    """

    nodes_m: Floats
    """(v, 2) corners; the first (blocks + 1)² are the grid's, row by row in x."""
    edges: NDArray[np.int64]
    """(e, 2) start and end corner of each street."""
    is_path: NDArray[np.bool_]
    """(e,) footpaths; the rest are roads."""

    @property
    def starts_m(self) -> Floats:
        return self.nodes_m[self.edges[:, 0]]

    @property
    def ends_m(self) -> Floats:
        return self.nodes_m[self.edges[:, 1]]

    @property
    def lengths_m(self) -> Floats:
        return np.asarray(np.hypot(*(self.ends_m - self.starts_m).T))

    @property
    def half_widths_m(self) -> Floats:
        return np.where(self.is_path, PATH_HALF_WIDTH_M, ROAD_HALF_WIDTH_M)

    def directions(self) -> tuple[Floats, Floats]:
        """Unit vectors (e, 2) along each street and to its left."""
        along = (self.ends_m - self.starts_m) / self.lengths_m[:, None]
        return along, np.stack([-along[:, 1], along[:, 0]], 1)

    def beside(self, street: int, stations_m: Floats, left_m: Floats | float) -> Floats:
        """World points (n, 2), `stations_m` (n,) along a street and `left_m` (n,) or all so far to
        the left of its middle."""
        along, left = self.directions()
        return np.asarray(
            self.starts_m[street]
            + stations_m[:, None] * along[street]
            + np.reshape(left_m, (-1, 1)) * left[street]
        )

    def clearance_m(self, points_m: Floats) -> Floats:
        """Distance (n,) from `points_m` (n, 2) to the border of the nearest street, negative on a
        street."""
        gaps_m = distance_to_segments_m(points_m, self.starts_m, self.ends_m) - self.half_widths_m
        return np.asarray(gaps_m.min(1))


def distance_to_segments_m(points_m: Floats, starts_m: Floats, ends_m: Floats) -> Floats:
    """Distances (n, e) from `points_m` (n, 2) to the segments from `starts_m` to `ends_m` (e,
    2)."""
    span_x, span_y = (ends_m - starts_m).T
    off_x = points_m[:, :1] - starts_m[:, 0]
    off_y = points_m[:, 1:] - starts_m[:, 1]
    share = ((off_x * span_x + off_y * span_y) / (span_x**2 + span_y**2)).clip(0, 1)
    return np.asarray(np.hypot(off_x - share * span_x, off_y - share * span_y))


def driven_m(line_m: Floats) -> Floats:
    """Metres (n,) from the start of a polyline (n, 2) to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line_m, axis=0).T))])


def points_along(line_m: Floats, stations_m: Floats) -> Floats:
    """Points (m, 2) so many metres along a polyline (n, 2)."""
    return np.stack([np.interp(stations_m, driven_m(line_m), axis) for axis in line_m.T], 1)


def build_streets(rng: np.random.Generator, blocks: int) -> Streets:
    """The streets of blocks × blocks blocks around the origin.

    Every corner has at least two streets.
    """
    side = blocks + 1
    axes = [np.cumsum([0.0, *(rng.uniform(*PITCH_FACTORS, blocks) * PITCH_M)]) for _ in "xy"]
    grid_m = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 2)
    nodes_m = grid_m + rng.normal(0, JITTER_SD_M, grid_m.shape).clip(-JITTER_CLIP_M, JITTER_CLIP_M)
    nodes_m -= (nodes_m.min(0) + nodes_m.max(0)) / 2
    corner = np.arange(side * side).reshape(side, side)
    along_x = np.stack([corner[:-1].ravel(), corner[1:].ravel()], 1)
    along_y = np.stack([corner[:, :-1].ravel(), corner[:, 1:].ravel()], 1)
    kept = _thin_out(rng.permutation(np.concatenate([along_x, along_y])), side * side)
    diagonals = np.stack([corner[:-1, :-1].ravel(), corner[1:, 1:].ravel()], 1)
    diagonals = diagonals[rng.random(len(diagonals)) < DIAGONAL_SHARE]
    is_path = np.concatenate([rng.random(len(kept)) < PATH_SHARE, np.ones(len(diagonals), bool)])
    return Streets(nodes_m, np.concatenate([kept, diagonals]), is_path)


def _thin_out(edges: NDArray[np.int64], nodes: int) -> NDArray[np.int64]:
    """The shuffled edges without a share REMOVED_SHARE of them; every corner keeps at least two."""
    streets_at = np.bincount(edges.ravel(), minlength=nodes)
    kept = []
    to_remove = int(REMOVED_SHARE * len(edges))
    for start, end in edges:
        if to_remove and streets_at[start] > 2 and streets_at[end] > 2:
            streets_at[[start, end]] -= 1
            to_remove -= 1
        else:
            kept.append((start, end))
    return np.array(kept)


def add_route(streets: Streets, route_m: Floats) -> tuple[Streets, list[int]]:
    """The streets with a route (n, 2) added as a footpath, and the corners that it visits in order.

    Where the route meets itself it shares corners. Links connect it to the grid, for the other
    sequences.
    """
    length_m = driven_m(route_m)[-1]
    grid_corners = len(streets.nodes_m)
    first, *stops = points_along(
        route_m, np.linspace(0, length_m, max(2, round(length_m / ROUTE_STEP_M) + 1))
    )
    nodes = [*streets.nodes_m, first]
    visited = [grid_corners]
    for stop in stops:
        gaps_m = np.hypot(*(np.array(nodes[grid_corners:]) - stop).T)
        gaps_m[visited[-1] - grid_corners] = np.inf
        if gaps_m.min() < ROUTE_MERGE_M:
            visited.append(grid_corners + int(gaps_m.argmin()))
        else:
            visited.append(len(nodes))
            nodes.append(stop)
    steps = {(min(pair), max(pair)) for pair in pairwise(visited)}
    linked = range(grid_corners, len(nodes), ROUTE_LINK_EVERY)
    links = {(int(np.hypot(*(streets.nodes_m - nodes[node]).T).argmin()), node) for node in linked}
    links = {link for link in links if np.hypot(*(nodes[link[0]] - nodes[link[1]])) > 0}
    added = np.array(sorted(steps | links))
    edges = np.concatenate([streets.edges, added])
    is_path = np.concatenate([streets.is_path, np.ones(len(added), bool)])
    return replace(streets, nodes_m=np.array(nodes), edges=edges, is_path=is_path), visited
