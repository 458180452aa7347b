"""A study in one table: each model's recall@1 on each test day, its share of answers and time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import pandas as pd

from pipeline.errors import ArtifactError
from pipeline.evaluation.doubts import VOID
from pipeline.report.table import Cell, Table, average, kept, number, table
from pipeline.studies.models import ModelName
from pipeline.studies.study import Study


@dataclass(frozen=True)
class Row:
    """The scores of one model."""

    model: str
    right: Sequence[float]
    """A share a test day: of the seen queries, those whose first answer lies within the tolerance;
    NaN where none is seen."""
    bounds: Sequence[tuple[float, float]]
    """Their 95 % intervals."""
    void: Sequence[bool]
    """Whether a share means nothing, as one answer to every query would do as well."""
    answers: Sequence[float]
    """A share a test day: of the judged queries, seen or not, those that the model answers at its
    own threshold."""
    kept: Sequence[float]
    """A share a test day: of these answers, those that are right; NaN of none."""
    promised: float
    """The precision that the threshold keeps on held-out blocks of training; NaN of one that
    accepts nothing."""
    wanted: float
    """The precision that was wanted there."""
    query_ms: float
    """From points to place, the median; NaN where it was not measured."""
    accepted: float
    accepted_wrong: float
    refused_wrong: float
    """Of all test days: answers that are accepted, wrong ones among them, and wrong ones that are
    refused; NaN in a table that does not say."""

    @property
    def posed(self) -> bool:
        """Whether the answers are poses."""
        return "pose" in self.model.split("-")


@dataclass(frozen=True)
class Summary:
    """The models of one study at one cell size, the best first.

    ViewpointMatches by distance, on queries as driven, with models of the first seed.
    """

    tests: Sequence[str]
    days: Sequence[int]
    within_m: float
    rows: Sequence[Row]

    @property
    def is_timed(self) -> bool:
        """Whether the time of a query was measured for any model."""
        return any(not np.isnan(row.query_ms) for row in self.rows)

    @classmethod
    def of(cls, results: pd.DataFrame, study: Study) -> Self:
        """Summarise the rows of the table of results that are of this study and cell size.

        Raises ArtifactError for a table of an earlier version, which does not say how near is
        right.
        """
        driven_rows = results[
            (results["change"] == "")
            & (results["kind"] == "")
            & (results["stress"] == "")
            & (results["seed"] == 0)
        ]
        test_rows = driven_rows[
            driven_rows["sequence"].isin(study.tests) & (driven_rows["protocol"] == "distance")
        ]
        days = (
            test_rows.drop_duplicates("sequence")
            .sort_values(["days", "sequence"])
            .set_index("sequence")["days"]
        )
        indexed_rows = test_rows.set_index(["method", "variant", "number", "sequence"])[
            ["value", "low", "high"]
        ]
        values_by_key = dict(
            zip(indexed_rows.index, indexed_rows.itertuples(index=False, name=None), strict=True)
        )
        cost = (
            driven_rows[driven_rows["number"] == "query_ms"]
            .set_index(["method", "variant"])["value"]
            .to_dict()
        )
        models = test_rows[test_rows["number"] == "answered"][["method", "variant"]]
        rows = []
        for method, variant in models.drop_duplicates().itertuples(index=False):
            daily = {
                name: [
                    values_by_key.get((method, variant, name, day), (np.nan,) * 3)
                    for day in days.index
                ]
                for name in (
                    "recall_at_1",
                    "answered",
                    "precision_at_threshold",
                    "kept_precision",
                    "wanted_precision",
                    "accepted",
                    "accepted_wrong",
                    "refused_wrong",
                )
            }
            right, answers, kept, promised, wanted, *belief = (
                [value for value, *_ in values] for values in daily.values()
            )
            void = [(method, variant, VOID, day) in values_by_key for day in days.index]
            bounds = [(low, high) for _, low, high in daily["recall_at_1"]]
            ms = float(cost.get((method, variant), np.nan))
            rows.append(
                Row(
                    ModelName(method, variant).name,
                    right,
                    bounds,
                    void,
                    answers,
                    kept,
                    promised[-1],
                    wanted[-1],
                    ms,
                    *map(sum, belief),
                )
            )
        rows.sort(key=lambda row: -np.nan_to_num(average(row.right), nan=-1.0))
        within_m = driven_rows.loc[
            (driven_rows["number"] == "correct_m") & (driven_rows["sequence"] == ""), "value"
        ].max()
        if rows and np.isnan(within_m):
            raise ArtifactError(
                "the tables of results do not say how near is right; `dvc repro` gathers them anew"
            )
        return cls(list(days.index), [int(day) for day in days], float(within_m), rows)


def scorecard(summary: Summary, dates: Sequence[str]) -> Table:
    """A row a model, a column a test day with its recall@1; then columns for the last day.

    These are: share answered, share of those right, precision promised by held-out blocks, time.
    """

    def share(row: Row, i: int) -> Cell:
        cell = number(row.right[i], 3, row.bounds[i])
        return replace(Cell(VOID) if row.void[i] else cell, of=(row.model, summary.tests[i]))

    timed = summary.is_timed
    rows = []
    for row in summary.rows:
        answer_cells = (
            number(row.answers[-1], 3),
            number(row.kept[-1], 3),
            kept(row.promised, row.wanted),
        )
        last = (*answer_cells, *([number(row.query_ms, 1)] if timed else []))
        rows.append((row.model, *(share(row, i) for i in range(len(row.right))), *last))
    heads = ("answers", "right of those", "keeps", *(["ms a query"] if timed else []))
    return table("scorecard", ("method", *dates, *heads), rows, last=dates[-1])
