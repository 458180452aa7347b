"""A study in one table: how often each model is right on each test day, how often it dares to answer, and how long it takes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import pandas as pd

from pipeline.evaluation.doubts import VOID
from pipeline.report.table import average
from pipeline.studies.expansion import TOLERANCE, ModelName


@dataclass(frozen=True)
class Row:
    """One model."""

    model: str
    right: Sequence[float]
    """A share a test day: of the seen queries, those whose first answer lies within the tolerance; NaN where none is seen."""
    bounds: Sequence[tuple[float, float]]
    """Their 95 % intervals."""
    void: Sequence[bool]
    """Whether a share means nothing, as one answer to every query would do as well."""
    answers: Sequence[float]
    """A share a test day: of all queries, those that the model answers at its own threshold."""
    kept: Sequence[float]
    """A share a test day: of these answers, those that are right; NaN of none."""
    query_ms: float
    """From points to place, the median; NaN where it was not measured."""


@dataclass(frozen=True)
class Summary:
    """The models of one study at one cell size, by distance, as driven, of the first seed; the best first."""

    tests: Sequence[str]
    days: Sequence[int]
    within_m: float
    rows: Sequence[Row]

    @classmethod
    def of(cls, table: pd.DataFrame, study: Mapping[str, Any]) -> Self:
        """From the rows of the table of results that are of this study and cell size."""
        own = table[(table["change"] == "") & (table["kind"] == "") & (table["stress"] == "") & (table["seed"] == 0)]
        asked = own[own["sequence"].isin(study["tests"]) & (own["protocol"] == "distance")]
        days = asked.drop_duplicates("sequence").sort_values(["days", "sequence"]).set_index("sequence")["days"]
        found = asked.set_index(["method", "variant", "number", "sequence"])[["value", "low", "high"]]
        known = dict(zip(found.index, found.itertuples(index=False, name=None), strict=True))
        cost = own[own["number"] == "query_ms"].set_index(["method", "variant"])["value"].to_dict()
        rows = []
        for method, variant in (
            asked[asked["number"] == "answered"][["method", "variant"]].drop_duplicates().itertuples(index=False)
        ):
            of = {
                name: [known.get((method, variant, name, day), (np.nan,) * 3) for day in days.index]
                for name in ("recall_at_1", "answered", "precision_at_threshold")
            }
            right, answers, kept = ([value for value, *_ in values] for values in of.values())
            void = [(method, variant, VOID, day) in known for day in days.index]
            bounds = [(low, high) for _, low, high in of["recall_at_1"]]
            ms = float(cost.get((method, variant), np.nan))
            rows.append(Row(ModelName(method, variant).name, right, bounds, void, answers, kept, ms))
        rows.sort(key=lambda row: -np.nan_to_num(average(row.right), nan=-1.0))
        within_m = float(study.get("tolerance", TOLERANCE).removesuffix("m"))
        return cls(list(days.index), [int(day) for day in days], within_m, rows)
