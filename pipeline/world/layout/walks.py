"""Random walks on the street graph."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.world.layout.streets import Streets

U_TURN_WEIGHT, STRAIGHT_WEIGHT, REVISIT_WEIGHT = 0.02, 1.4, 6.0


@dataclass(frozen=True)
class Graph:
    """The half-edges of the streets: 2e is street e from start to end, 2e + 1 is the reverse."""

    tails: NDArray[np.int64]
    """(h,) corner at which each half-edge starts; it ends at `heads`."""
    heads: NDArray[np.int64]
    headings: NDArray[np.float64]
    lengths_m: NDArray[np.float64]
    leaving: list[NDArray[np.int64]]
    """The half-edges that start at each corner."""

    @staticmethod
    def of(streets: Streets) -> "Graph":
        tails, heads = streets.edges.ravel(), streets.edges[:, ::-1].ravel()
        along = np.repeat(streets.directions()[0], 2, axis=0)
        along[1::2] *= -1
        leaving = [np.flatnonzero(tails == node) for node in range(len(streets.nodes_m))]
        return Graph(tails, heads, along, np.repeat(streets.lengths_m, 2), leaving)

    def wander(self, rng: np.random.Generator, weights: NDArray[np.float64], start: int, length_m: float) -> list[int]:
        """A random walk of at least `length_m` from corner `start`; it prefers new streets, straight on, and large weights."""
        walk: list[int] = []
        visits = np.zeros(len(weights) // 2)
        node, driven_m = start, 0.0
        while driven_m < length_m:
            options = self.leaving[node]
            appeal = weights[options] / (1 + REVISIT_WEIGHT * visits[options // 2]) ** 2
            if walk:
                straightness = self.headings[options] @ self.headings[walk[-1]]
                appeal = appeal * np.where(options == walk[-1] ^ 1, U_TURN_WEIGHT, STRAIGHT_WEIGHT + straightness)
            up_to = np.cumsum(appeal + 1e-9)
            step = int(options[min(np.searchsorted(up_to, rng.random() * up_to[-1]), len(options) - 1)])
            walk.append(step)
            visits[step // 2] += 1
            driven_m += self.lengths_m[step]
            node = int(self.heads[step])
        return walk
