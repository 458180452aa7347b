"""Plans the routes of sequences: random walks on the graph of streets.

The training plan visits many streets. A test plan is the best of many random walks: it has the
wanted shares of unseen streets, and of streets driven in reverse, and otherwise covers as much of
the training plan as possible. `plan_loops` does the same within a single log.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from worlds import Floats
from worlds.layout.streets import Streets, driven_m, points_along

TRAINING_CANDIDATES = 200
"""Number of random walks of which the best becomes the training plan."""
TEST_CANDIDATES = 1000
"""Number of random walks of which the best becomes a test plan."""
UNSEEN_WEIGHT_LOG10_BOUNDS = (-2.2, -0.2)
"""Bounds of the random weight of unseen streets in a walk; a street driven in training has 1."""
REVERSED_WEIGHT_LOG10_BOUNDS = (-2.0, 1.0)
"""Bounds of the random weight of streets driven in training the other way."""
ERROR_WEIGHT = 8.0
"""Weight of an error in the wanted shares, relative to the coverage of the training plan."""
U_TURN_WEIGHT = 0.02
"""Weight of a turn back into the same street."""
STRAIGHT_WEIGHT = 1.4
"""Added to the cosine of a turn, it is the turn's weight."""
REVISIT_WEIGHT = 6.0
"""How fast the weight of a street falls with each visit."""

SPARE_SHARE = 0.1
SPARE_M = 30.0
"""A plan is longer than the wanted route by this share and this length, since the drive cuts
corners."""
SAMPLE_M = 5.0
"""Distance between the points at which plans are compared."""
SEEN_WITHIN_M = 10.0
"""A place counts as seen within this distance of the training plan: between the 5 m and 15 m of the
distance protocol."""
NEIGHBOURS = 8
"""Number of nearby points of the training plan whose headings are compared."""


@dataclass(frozen=True)
class Plan:
    """A walk on the street graph."""

    line_m: Floats
    """(n, 2) its start and the corners that it passes. It is a little longer than wanted."""
    half_edges: tuple[int, ...]
    """The streets that it takes, each with its direction (see `Graph`)."""
    unseen: float
    """Share of its length that is further than SEEN_WITHIN_M from the training plan."""
    reversed: float
    """Share of the rest of its length where the training plan nearby never drives in about the same
    direction."""
    coverage: float
    """Share of the training plan that is within SEEN_WITHIN_M of it."""


class Graph:
    """The graph of streets, as h half-edges.

    A half-edge is a street in one direction: number 2e is street e from its start to its end,
    number 2e + 1 the way back.
    """

    def __init__(self, streets: Streets) -> None:
        # (h,) the corners at which half-edges begin and end
        self.tails = streets.edges.ravel()
        self.heads = streets.edges[:, ::-1].ravel()
        # (h, 2) unit vectors
        along, _ = streets.directions()
        self.headings = np.repeat(along, 2, axis=0)
        self.headings[1::2] *= -1
        self.lengths_m = np.repeat(streets.lengths_m, 2)
        # for each corner the half-edges that begin there
        self.leaving = [np.flatnonzero(self.tails == node) for node in range(len(streets.nodes_m))]

    def wander(
        self, rng: np.random.Generator, weights: Floats, start: int, length_m: float
    ) -> list[int]:
        """A random walk of at least `length_m` from corner `start`, as half-edges.

        It prefers new streets, going straight on, and half-edges with large `weights` (h,).
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
                is_u_turn = options == walk[-1] ^ 1  # the same street the other way
                appeal = appeal * np.where(is_u_turn, U_TURN_WEIGHT, STRAIGHT_WEIGHT + straightness)
            # Draw one of the options, with probabilities in proportion to their appeal.
            cumulated = np.cumsum(appeal + 1e-9)
            choice = np.searchsorted(cumulated, rng.random() * cumulated[-1])
            step = int(options[min(choice, len(options) - 1)])
            walk.append(step)
            visits[step // 2] += 1
            walked_m += self.lengths_m[step]
            node = int(self.heads[step])
        return walk

    def anywhere(self, rng: np.random.Generator, length_m: float) -> list[int]:
        """A random walk from a random corner, with equal weights."""
        start = int(rng.integers(len(self.leaving)))
        return self.wander(rng, np.ones(len(self.tails)), start, length_m)

    def visited(
        self, walk: list[int] | NDArray[np.int64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """True (h,) for the half-edges of a walk, and for those of its streets both ways."""
        is_driven = np.zeros(len(self.tails), bool)
        is_driven[walk] = True
        return is_driven, is_driven | is_driven[np.arange(len(is_driven)) ^ 1]


class _Samples:
    """Points every SAMPLE_M along a plan, from `start_m` to `end_m` after its start."""

    def __init__(self, line_m: Floats, end_m: float, start_m: float = 0.0) -> None:
        passed_m = driven_m(line_m)
        stations_m = np.arange(start_m, min(end_m, passed_m[-1]), SAMPLE_M)
        legs_m = np.diff(line_m, axis=0)
        leg = np.searchsorted(passed_m, stations_m, side="right") - 1
        self.places_m = points_along(line_m, stations_m)
        self.headings = (legs_m / np.hypot(*legs_m.T)[:, None])[leg]
        self.tree = KDTree(self.places_m)

    def against(self, training: "_Samples") -> tuple[float, float, float]:
        """The shares `unseen`, `reversed` and `coverage` of a `Plan` with these samples."""
        # A sample without so many neighbours has the number after the last one in their places,
        # with a heading that is the same as no other.
        _, neighbours = training.tree.query(
            self.places_m, k=NEIGHBOURS, distance_upper_bound=SEEN_WITHIN_M
        )
        no_neighbour = len(training.headings)
        training_headings = np.concatenate([training.headings, [[0.0, 0.0]]])
        headings = training_headings[np.asarray(neighbours)]
        is_same_way = ((headings * self.headings[:, None]).sum(2) > 0).any(1)
        is_seen = np.asarray(neighbours)[:, 0] < no_neighbour
        distances_m, _ = self.tree.query(training.places_m, distance_upper_bound=SEEN_WITHIN_M)
        is_covered = np.isfinite(distances_m)
        unseen = 1 - is_seen.mean()
        reversed_ = (is_seen & ~is_same_way).sum() / max(is_seen.sum(), 1)
        return float(unseen), float(reversed_), float(is_covered.mean())


def plan_training(rng: np.random.Generator, streets: Streets, route_m: float) -> Plan:
    """Plan the training sequence: the random walk that repeats the fewest streets."""
    graph = Graph(streets)
    walks = [graph.anywhere(rng, _with_spare_m(route_m)) for _ in range(TRAINING_CANDIDATES)]
    return follow(streets, max(walks, key=_share_of_new_streets))


def _share_of_new_streets(walk: list[int]) -> float:
    """The number of different streets of a walk over that of its steps."""
    return len({step // 2 for step in walk}) / len(walk)


def follow(streets: Streets, half_edges: list[int]) -> Plan:
    """The training plan along `half_edges`, each of which begins where the one before ends."""
    graph = Graph(streets)
    line_m = streets.nodes_m[[graph.tails[half_edges[0]], *graph.heads[half_edges]]]
    return Plan(line_m, tuple(half_edges), unseen=0.0, reversed=0.0, coverage=1.0)


def half_edges_through(streets: Streets, corners: list[int]) -> list[int]:
    """The half-edges that lead from each of the `corners` to the next; streets must join them."""
    graph = Graph(streets)
    all_ends = zip(graph.tails.tolist(), graph.heads.tolist(), strict=True)
    number_of = {ends: number for number, ends in enumerate(all_ends)}
    return [number_of[ends] for ends in pairwise(corners)]


def plan_test(
    rng: np.random.Generator,
    streets: Streets,
    training: Plan,
    route_m: float,
    unseen: float,
    reversed_: float,
) -> Plan:
    """Plan a test sequence with about the wanted shares, and a large coverage of the training plan.

    `unseen` and `reversed_` are those of a `Plan`. The plan is the best of many random walks that
    begin somewhere in a street of the training plan.
    """
    graph = Graph(streets)
    reference = _Samples(training.line_m, route_m)
    # The end of a plan is spare: a street counts if its middle is driven within the route's length.
    steps = np.array(training.half_edges)
    middles_m = np.cumsum(graph.lengths_m[steps]) - graph.lengths_m[steps] / 2
    n_driven = max(1, int((middles_m < route_m).sum()))
    is_driven, is_visited = graph.visited(steps[:n_driven])
    starts = np.flatnonzero(is_visited)
    plans = []
    for _ in range(TEST_CANDIDATES):
        weights = _random_weights(rng, is_driven, is_visited)
        node = int(graph.tails[rng.choice(starts)])
        walk = graph.wander(rng, weights, node, _with_spare_m(route_m) + streets.lengths_m.max())
        skipped_m = rng.uniform(0, 0.8) * graph.lengths_m[walk[0]]
        start_m = streets.nodes_m[node] + skipped_m * graph.headings[walk[0]]
        line_m = np.concatenate([start_m[None], streets.nodes_m[graph.heads[walk]]])
        shares = _Samples(line_m, route_m).against(reference)
        plans.append(Plan(line_m, tuple(walk), *shares))
    return _best(plans, unseen, reversed_)


def plan_loops(
    rng: np.random.Generator, streets: Streets, route_m: float, unseen: float, reversed_: float
) -> Plan:
    """Plan a log whose second half meets its first half again.

    The second half relates to the first as a test plan to the training plan; the shares are those
    of the second half relative to the first.
    """
    graph = Graph(streets)
    half_m = route_m / 2
    plans = []
    for _ in range(TEST_CANDIDATES):
        walk = graph.anywhere(rng, half_m)
        is_driven, is_visited = graph.visited(walk)
        weights = _random_weights(rng, is_driven, is_visited)
        walk += graph.wander(rng, weights, int(graph.heads[walk[-1]]), _with_spare_m(half_m))
        line_m = streets.nodes_m[[graph.tails[walk[0]], *graph.heads[walk]]]
        first_half = _Samples(line_m, half_m)
        second_half = _Samples(line_m, route_m, half_m)
        plans.append(Plan(line_m, tuple(walk), *second_half.against(first_half)))
    return _best(plans, unseen, reversed_)


def _random_weights(
    rng: np.random.Generator, is_driven: NDArray[np.bool_], is_visited: NDArray[np.bool_]
) -> Floats:
    """Random weights (h,) of half-edges for a walk."""
    unseen_weight = 10 ** rng.uniform(*UNSEEN_WEIGHT_LOG10_BOUNDS)
    reversed_weight = 10 ** rng.uniform(*REVERSED_WEIGHT_LOG10_BOUNDS)
    return np.where(is_driven, 1.0, np.where(is_visited, reversed_weight, unseen_weight))


def _best(plans: list[Plan], unseen: float, reversed_: float) -> Plan:
    """The plan with the largest coverage, less the weighted errors in the wanted shares."""

    def score(plan: Plan) -> float:
        error = abs(plan.unseen - unseen) + abs(plan.reversed - reversed_)
        return plan.coverage - ERROR_WEIGHT * error

    return max(plans, key=score)


def _with_spare_m(route_m: float) -> float:
    """The length of a plan for a route of `route_m`."""
    return (1 + SPARE_SHARE) * route_m + SPARE_M
