"""Route plans: the streets and directions that a sequence drives, relative to those of the training sequence."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.world.layout.streets import Streets
from pipeline.world.layout.walks import Graph

TRAINING_CANDIDATES, TEST_CANDIDATES = 200, 1000
UNSEEN_WEIGHTS_LOG10, REVERSED_WEIGHTS_LOG10 = (-2.2, -0.2), (-2.0, 1.0)
ERROR_WEIGHT = 8.0
"""Weight of an error in the wanted shares, relative to the coverage of the training route."""

SPARE_SHARE, SPARE_M = 0.1, 30.0
"""A plan is longer than the wanted route by this share and length, since the drive cuts corners."""
SAMPLE_M = 5.0
SEEN_WITHIN_M = 10.0
"""A place counts as seen within this distance of the training plan: between the 5 m and 15 m of the distance protocol."""
NEIGHBOURS = 8


@dataclass(frozen=True)
class Plan:
    """A walk on the street graph."""

    line_m: NDArray[np.float64]
    """(n, 2) its start and the corners that it passes; it is a little longer than wanted."""
    half_edges: tuple[int, ...]
    unseen: float
    """The share of its length further than SEEN_WITHIN_M from the training plan."""
    reversed: float
    """The share of its other length that no part of the training plan nearby drives in about the same direction."""
    coverage: float
    """The share of the training plan within SEEN_WITHIN_M of it."""


@dataclass(frozen=True)
class _Samples:
    """Points every SAMPLE_M along a plan."""

    places_m: NDArray[np.float64]
    headings: NDArray[np.float64]
    tree: KDTree

    @staticmethod
    def of(line_m: NDArray[np.float64], end_m: float, start_m: float = 0.0) -> "_Samples":
        legs_m = np.hypot(*np.diff(line_m, axis=0).T)
        driven_m = np.concatenate([[0.0], np.cumsum(legs_m)])
        stations_m = np.arange(start_m, min(end_m, driven_m[-1]), SAMPLE_M)
        places_m = np.stack([np.interp(stations_m, driven_m, line_m[:, axis]) for axis in (0, 1)], 1)
        leg = np.searchsorted(driven_m, stations_m, side="right") - 1
        headings = (np.diff(line_m, axis=0) / legs_m[:, None])[leg]
        return _Samples(places_m, headings, KDTree(places_m))

    def against(self, training: "_Samples") -> tuple[float, float, float]:
        """The shares unseen, reversed and coverage of these samples relative to those of the training plan."""
        near = np.asarray(training.tree.query(self.places_m, k=NEIGHBOURS, distance_upper_bound=SEEN_WITHIN_M)[1])
        headings = np.concatenate([training.headings, [[0.0, 0.0]]])[near.clip(max=len(training.headings))]
        same_way = ((headings * self.headings[:, None]).sum(2) > 0).any(1)
        seen = near[:, 0] < len(training.headings)
        back = np.isfinite(self.tree.query(training.places_m, distance_upper_bound=SEEN_WITHIN_M)[0])
        return float(1 - seen.mean()), float((seen & ~same_way).sum() / max(seen.sum(), 1)), float(back.mean())


def plan_training(rng: np.random.Generator, streets: Streets, route_m: float) -> Plan:
    """The one of TRAINING_CANDIDATES random walks that repeats the fewest streets."""
    graph = Graph.of(streets)
    best: list[int] = []
    best_share = -1.0
    for _ in range(TRAINING_CANDIDATES):
        walk = graph.wander(rng, np.ones(len(graph.tails)), int(rng.integers(len(streets.nodes_m))), _spare_m(route_m))
        share = len({step // 2 for step in walk}) / len(walk)
        if share > best_share:
            best, best_share = walk, share
    return follow(streets, best)


def follow(streets: Streets, half_edges: list[int]) -> Plan:
    """The training plan along connected `half_edges`."""
    graph = Graph.of(streets)
    corners = [int(graph.tails[half_edges[0]]), *(int(graph.heads[step]) for step in half_edges)]
    return Plan(streets.nodes_m[corners], tuple(half_edges), 0.0, 0.0, 1.0)


def half_edges_through(streets: Streets, corners: list[int]) -> list[int]:
    """The half-edges that lead through `corners`, of which neighbours are joined by a street."""
    graph = Graph.of(streets)
    number = {ends: row for row, ends in enumerate(zip(graph.tails.tolist(), graph.heads.tolist(), strict=True))}
    return [number[ends] for ends in pairwise(corners)]


def plan_test(
    rng: np.random.Generator, streets: Streets, training: Plan, route_m: float, unseen: float, reversed_: float
) -> Plan:
    """The random walk with the best score: near the wanted shares, and with a large coverage of the training plan."""
    graph, reference = Graph.of(streets), _Samples.of(training.line_m, route_m)
    steps = np.array(training.half_edges)
    middles_m = np.cumsum(graph.lengths_m[steps]) - graph.lengths_m[steps] / 2
    driven, known = _known(graph, steps[: max(1, int((middles_m < route_m).sum()))])
    starts = np.flatnonzero(known)
    best, best_score = training, -np.inf
    for _ in range(TEST_CANDIDATES):
        weights = _weights(rng, driven, known)
        node = int(graph.tails[rng.choice(starts)])
        walk = graph.wander(rng, weights, node, _spare_m(route_m) + streets.lengths_m.max())
        skipped_m = rng.uniform(0, 0.8) * graph.lengths_m[walk[0]]
        start_m = streets.nodes_m[node] + skipped_m * graph.headings[walk[0]]
        line_m = np.concatenate([start_m[None], streets.nodes_m[graph.heads[walk]]])
        plan = Plan(line_m, tuple(walk), *_Samples.of(line_m, route_m).against(reference))
        score = _score(plan, unseen, reversed_)
        if score > best_score:
            best, best_score = plan, score
    return best


def plan_loops(rng: np.random.Generator, streets: Streets, route_m: float, unseen: float, reversed_: float) -> Plan:
    """The random walk whose second half relates to its first half as a plan of `plan_test` to the training plan.

    Its shares are those of the second half relative to the first.
    """
    graph, half_m = Graph.of(streets), route_m / 2
    plans = []
    for _ in range(TEST_CANDIDATES):
        first = graph.wander(rng, np.ones(len(graph.tails)), int(rng.integers(len(streets.nodes_m))), half_m)
        weights = _weights(rng, *_known(graph, np.array(first)))
        walk = first + graph.wander(rng, weights, int(graph.heads[first[-1]]), _spare_m(half_m))
        line_m = streets.nodes_m[[graph.tails[walk[0]], *graph.heads[walk]]]
        again = _Samples.of(line_m, route_m, half_m)
        plans.append(Plan(line_m, tuple(walk), *again.against(_Samples.of(line_m, half_m))))
    return max(plans, key=lambda plan: _score(plan, unseen, reversed_))


def _known(graph: Graph, steps: NDArray[np.int64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Masks of the half-edges in `steps`, and of those of the same streets in either direction."""
    driven = np.zeros(len(graph.tails), bool)
    driven[steps] = True
    return driven, driven | driven[np.arange(len(driven)) ^ 1]


def _weights(rng: np.random.Generator, driven: NDArray[np.bool_], known: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Random weights of the half-edges for a walk: 1 for driven ones, others for reversed and for unseen ones."""
    off_weight, back_weight = 10 ** rng.uniform(*UNSEEN_WEIGHTS_LOG10), 10 ** rng.uniform(*REVERSED_WEIGHTS_LOG10)
    return np.where(driven, 1.0, np.where(known, back_weight, off_weight))


def _score(plan: Plan, unseen: float, reversed_: float) -> float:
    return plan.coverage - ERROR_WEIGHT * (abs(plan.unseen - unseen) + abs(plan.reversed - reversed_))


def _spare_m(route_m: float) -> float:
    return (1 + SPARE_SHARE) * route_m + SPARE_M
