"""Ranks queries with a stored model: a model's file and the views of queries in, a ranking out.

A model is opened once in each process, at its first use.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core import store
from pipeline.core.frames import wrapped_deg, yaw
from pipeline.matching.ranking import Localizer, Method, Model, Ranking, Rows, joined
from pipeline.matching.rejection import Rejection
from pipeline.perturbations import Case


@dataclass
class StoredModel:
    """A model in a file, with all that is needed to rank queries with it.

    The file is read at the first use, so that each worker process reads the arrays itself.
    """

    path: str | Path
    method: Method
    rejection: Rejection
    """Chooses the kind of novelty that comes first in a ranking."""
    k: int
    """Places in the ranking of a query."""

    @cached_property
    def model(self) -> Model:
        """The model's arrays."""
        return store.read_model(self.path)

    @cached_property
    def localizer(self) -> Localizer:
        """The function that ranks views with the model."""
        return self.method.localizer(self.model)

    def rank(self, cases: Mapping[Case, Rows]) -> Ranking:
        """Rank k places for every query, one case after the other.

        A case is one way in which queries are perturbed (`pipeline.perturbations`). Each case is
        ranked by itself, since some methods match all queries of a call together.
        """
        rankings = []
        for rows in cases.values():
            ranking = self.localizer(rows, self.k).checked(len(rows.stamps_ns))
            rankings.append(self.rejection.order(ranking))
        return joined(rankings)


def turned_deg(cases: Mapping[Case, Rows]) -> NDArray[np.float64]:
    """How far the robot is turned to the left in each case's queries, one case after the other.

    The angles, one per query and case, are in degrees in (−180, 180], against the first case, which
    is unperturbed.
    """
    unperturbed = next(iter(cases.values()))
    unperturbed_yaw_rad = yaw(unperturbed.world_T_anchor)
    left_rad = [yaw(rows.world_T_anchor) - unperturbed_yaw_rad for rows in cases.values()]
    return wrapped_deg(np.rad2deg(np.concatenate(left_rad)))
