"""Asking a model where queries were seen: opened once in each process, then asked as often as one
likes."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline import store
from pipeline.alterations import Case
from pipeline.frames import wrapped_deg, yaw
from pipeline.matching.ranking import Localizer, Method, Model, Ranking, Rows, joined
from pipeline.matching.rejection import Rejection


@dataclass
class Asked:
    """A model in a file; it is read at the first question, so a worker that is sent this reads it
    itself."""

    path: str | Path
    method: Method
    rejection: Rejection
    k: int

    @cached_property
    def model(self) -> Model:
        return store.read_model(self.path)

    @cached_property
    def localizer(self) -> Localizer:
        return self.method.localizer(self.model)

    def rank(self, cases: Mapping[Case, Rows]) -> Ranking:
        """The k places of every query, case after case; each case is asked by itself."""
        ranked = (
            self.localizer(rows, self.k).checked(len(rows.stamps_ns)) for rows in cases.values()
        )
        return joined([self.rejection.order(one) for one in ranked])


def turned_deg(cases: Mapping[Case, Rows]) -> NDArray[np.float64]:
    """How far each case's views (query,) are turned to the left of those as driven, which come
    first; in (−180, 180]."""
    driven, *_ = cases.values()
    left_rad = [yaw(rows.world_T_anchor) - yaw(driven.world_T_anchor) for rows in cases.values()]
    return wrapped_deg(np.rad2deg(np.concatenate(left_rad)))
