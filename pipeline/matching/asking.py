"""Localizes queries with a stored model, opened once in each process."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Case
from pipeline.core import store
from pipeline.core.frames import wrapped_deg, yaw
from pipeline.matching.ranking import Localizer, Method, Model, Ranking, Rows, joined
from pipeline.matching.rejection import Rejection


@dataclass
class StoredModel:
    """A model in a file, read when first used, so that each worker reads it itself."""

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
        """The k places of every query, case after case; each case is localized by itself."""
        ranked = (
            self.localizer(rows, self.k).checked(len(rows.stamps_ns)) for rows in cases.values()
        )
        return joined([self.rejection.order(ranking) for ranking in ranked])


def turned_deg(cases: Mapping[Case, Rows]) -> NDArray[np.float64]:
    """The turn of each case's views (query,) to the left of those as driven, in (−180, 180].

    The case as driven comes first.
    """
    as_driven, *_ = cases.values()
    left_rad = [yaw(rows.world_T_anchor) - yaw(as_driven.world_T_anchor) for rows in cases.values()]
    return wrapped_deg(np.rad2deg(np.concatenate(left_rad)))
