"""Route plans: random walks on the street graph, relative to that of the training sequence."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.world import Floats
from pipeline.world.layout.streets import Streets, driven_m, points_along

TRAINING_CANDIDATES = 200
TEST_CANDIDATES = 1000
UNSEEN_WEIGHTS_LOG10 = (-2.2, -0.2)
REVERSED_WEIGHTS_LOG10 = (-2.0, 1.0)
ERROR_WEIGHT = 8.0
"""Weight of an error in the wanted shares, relative to the coverage of the training route."""
U_TURN_WEIGHT = 0.02
STRAIGHT_WEIGHT = 1.4
REVISIT_WEIGHT = 6.0

SPARE_SHARE = 0.1
SPARE_M = 30.0
"""A plan is longer than the wanted route by this share and length, since the drive cuts corners."""
SAMPLE_M = 5.0
SEEN_WITHIN_M = 10.0
"""A place counts as seen within this distance of the training plan: between the 5 m and 15 m of the
distance protocol."""
NEIGHBOURS = 8


@dataclass(frozen=True)
class Plan:
    """A walk on the street graph."""

    line_m: Floats
    """(n, 2) its start and the corners that it passes; it is a little longer than wanted."""
    half_edges: tuple[int, ...]
    unseen: float
    """The share of its length further than SEEN_WITHIN_M from the training plan."""
    reversed: float
    """The share of its other length that no part of the training plan nearby drives in about the
    same direction."""
    coverage: float
    """The share of the training plan within SEEN_WITHIN_M of it."""


class Graph:
    """The half-edges of the streets, which lead from `tails` to `heads` (h,).

    2e is street e from start to end, 2e + 1 back.
    """

    def __init__(self, streets: Streets) -> None:
        self.tails = streets.edges.ravel()
        self.heads = streets.edges[:, ::-1].ravel()
        self.headings = np.repeat(streets.directions()[0], 2, axis=0)
        self.lengths_m = np.repeat(streets.lengths_m, 2)
        self.headings[1::2] *= -1
        self.leaving = [np.flatnonzero(self.tails == node) for node in range(len(streets.nodes_m))]

    def wander(
        self, rng: np.random.Generator, weights: Floats, start: int, length_m: float
    ) -> list[int]:
        """A random walk of at least `length_m` from corner `start`.

        It prefers new streets, straight on, and large weights.
        """
        walk: list[int] = []
        visits = np.zeros(len(weights) // 2)
        node = start
        walked_m = 0.0
        while walked_m < length_m:
            options = self.leaving[node]
            appeal = weights[options] / (1 + REVISIT_WEIGHT * visits[options // 2]) ** 2
            if walk:
                straightness = self.headings[options] @ self.headings[walk[-1]]
                appeal = appeal * np.where(
                    options == walk[-1] ^ 1, U_TURN_WEIGHT, STRAIGHT_WEIGHT + straightness
                )
            up_to = np.cumsum(appeal + 1e-9)
            step = int(
                options[min(np.searchsorted(up_to, rng.random() * up_to[-1]), len(options) - 1)]
            )
            walk.append(step)
            visits[step // 2] += 1
            walked_m += self.lengths_m[step]
            node = int(self.heads[step])
        return walk

    def anywhere(self, rng: np.random.Generator, length_m: float) -> list[int]:
        """A random walk from a random corner, to which all streets are alike."""
        return self.wander(
            rng, np.ones(len(self.tails)), int(rng.integers(len(self.leaving))), length_m
        )

    def known(
        self, steps: list[int] | NDArray[np.int64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Masks of the half-edges in `steps`, and of those of the same streets in either
        direction."""
        driven = np.zeros(len(self.tails), bool)
        driven[steps] = True
        return driven, driven | driven[np.arange(len(driven)) ^ 1]


class _Samples:
    """Points every SAMPLE_M along a plan."""

    def __init__(self, line_m: Floats, end_m: float, start_m: float = 0.0) -> None:
        passed_m = driven_m(line_m)
        stations_m = np.arange(start_m, min(end_m, passed_m[-1]), SAMPLE_M)
        legs_m = np.diff(line_m, axis=0)
        leg = np.searchsorted(passed_m, stations_m, side="right") - 1
        self.places_m = points_along(line_m, stations_m)
        self.headings = (legs_m / np.hypot(*legs_m.T)[:, None])[leg]
        self.tree = KDTree(self.places_m)

    def against(self, training: "_Samples") -> tuple[float, float, float]:
        """The shares unseen, reversed and coverage of these samples relative to those of the
        training plan."""
        near = np.asarray(
            training.tree.query(self.places_m, k=NEIGHBOURS, distance_upper_bound=SEEN_WITHIN_M)[1]
        )
        headings = np.concatenate([training.headings, [[0.0, 0.0]]])[
            near.clip(max=len(training.headings))
        ]
        same_way = ((headings * self.headings[:, None]).sum(2) > 0).any(1)
        seen = near[:, 0] < len(training.headings)
        back = np.isfinite(
            self.tree.query(training.places_m, distance_upper_bound=SEEN_WITHIN_M)[0]
        )
        return (
            float(1 - seen.mean()),
            float((seen & ~same_way).sum() / max(seen.sum(), 1)),
            float(back.mean()),
        )


def plan_training(rng: np.random.Generator, streets: Streets, route_m: float) -> Plan:
    """The one of TRAINING_CANDIDATES random walks that repeats the fewest streets."""
    graph = Graph(streets)
    walks = [graph.anywhere(rng, _spare_m(route_m)) for _ in range(TRAINING_CANDIDATES)]
    return follow(
        streets, max(walks, key=lambda walk: len({step // 2 for step in walk}) / len(walk))
    )


def follow(streets: Streets, half_edges: list[int]) -> Plan:
    """The training plan along connected `half_edges`."""
    graph = Graph(streets)
    return Plan(
        streets.nodes_m[[graph.tails[half_edges[0]], *graph.heads[half_edges]]],
        tuple(half_edges),
        0.0,
        0.0,
        1.0,
    )


def half_edges_through(streets: Streets, corners: list[int]) -> list[int]:
    """The half-edges that lead through `corners`, of which neighbours are joined by a street."""
    graph = Graph(streets)
    number = {
        ends: row
        for row, ends in enumerate(zip(graph.tails.tolist(), graph.heads.tolist(), strict=True))
    }
    return [number[ends] for ends in pairwise(corners)]


def plan_test(
    rng: np.random.Generator,
    streets: Streets,
    training: Plan,
    route_m: float,
    unseen: float,
    reversed_: float,
) -> Plan:
    """The random walk with the best score.

    That is one near the wanted shares, and with a large coverage of the training plan.
    """
    graph = Graph(streets)
    reference = _Samples(training.line_m, route_m)
    steps = np.array(training.half_edges)
    middles_m = np.cumsum(graph.lengths_m[steps]) - graph.lengths_m[steps] / 2
    driven, known_edges = graph.known(steps[: max(1, int((middles_m < route_m).sum()))])
    starts = np.flatnonzero(known_edges)
    plans = []
    for _ in range(TEST_CANDIDATES):
        weights = _weights(rng, driven, known_edges)
        node = int(graph.tails[rng.choice(starts)])
        walk = graph.wander(rng, weights, node, _spare_m(route_m) + streets.lengths_m.max())
        skipped_m = rng.uniform(0, 0.8) * graph.lengths_m[walk[0]]
        start_m = streets.nodes_m[node] + skipped_m * graph.headings[walk[0]]
        line_m = np.concatenate([start_m[None], streets.nodes_m[graph.heads[walk]]])
        plans.append(Plan(line_m, tuple(walk), *_Samples(line_m, route_m).against(reference)))
    return _best(plans, unseen, reversed_)


def plan_loops(
    rng: np.random.Generator, streets: Streets, route_m: float, unseen: float, reversed_: float
) -> Plan:
    """The random walk for a log whose second half meets its first half again.

    The second half relates to the first as a plan of `plan_test` to the training plan. Its shares
    are those of the second half relative to the first.
    """
    graph = Graph(streets)
    half_m = route_m / 2
    plans = []
    for _ in range(TEST_CANDIDATES):
        first = graph.anywhere(rng, half_m)
        weights = _weights(rng, *graph.known(first))
        walk = first + graph.wander(rng, weights, int(graph.heads[first[-1]]), _spare_m(half_m))
        line_m = streets.nodes_m[[graph.tails[walk[0]], *graph.heads[walk]]]
        again = _Samples(line_m, route_m, half_m)
        plans.append(Plan(line_m, tuple(walk), *again.against(_Samples(line_m, half_m))))
    return _best(plans, unseen, reversed_)


def _weights(
    rng: np.random.Generator, driven: NDArray[np.bool_], known_edges: NDArray[np.bool_]
) -> Floats:
    """Random weights of the half-edges for a walk.

    They are 1 for driven ones, others for reversed and for unseen ones.
    """
    off_weight = 10 ** rng.uniform(*UNSEEN_WEIGHTS_LOG10)
    back_weight = 10 ** rng.uniform(*REVERSED_WEIGHTS_LOG10)
    return np.where(driven, 1.0, np.where(known_edges, back_weight, off_weight))


def _best(plans: list[Plan], unseen: float, reversed_: float) -> Plan:
    """The plan with the most coverage less the weighted errors in its shares."""
    return max(
        plans,
        key=lambda p: (
            p.coverage - ERROR_WEIGHT * (abs(p.unseen - unseen) + abs(p.reversed - reversed_))
        ),
    )


def _spare_m(route_m: float) -> float:
    return (1 + SPARE_SHARE) * route_m + SPARE_M
