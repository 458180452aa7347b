"""The first screen of a study on the page and the charts below it; templates hold the words."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from pipeline.evaluation.study_rows import PER_DAYS
from pipeline.report import findings
from pipeline.report.comparison import FAR, Kind
from pipeline.report.figures import curves
from pipeline.report.figures.style import Mark, inline
from pipeline.report.findings import Finding
from pipeline.report.render import anchor, percent, words
from pipeline.report.result import Result, by_model, dates, ranked
from pipeline.report.selection import NONE, indexed
from pipeline.report.study import Study
from pipeline.report.table import Table, difference, number, table
from pipeline.report.tables import believed, scorecard
from pipeline.studies.colours import method_of

CASES = 4  # so many kinds of altered queries have a column
DIGITS = 3


@dataclass(frozen=True)
class Front:
    """The numbers on the first screen of one study at one cell size."""

    study: Study

    @cached_property
    def models(self) -> dict[str, list[Result]]:
        """The models, the best first, with their result on each test day."""
        return ranked(self.study.results)

    @property
    def best(self) -> list[Result]:
        """The results of the model that a robot would be given, one a test day."""
        return self.models[self.study.best]

    @cached_property
    def folded(self) -> dict[str, float]:
        """The models that had too little training to be compared, with their share of it.

        The best model's own method stays: with more training it would be no worse.
        """
        best_method = method_of(self.study.best)
        return {
            model: share
            for model, share in self.study.cut_short.items()
            if method_of(model) != best_method
        }

    @property
    def compared(self) -> list[Result]:
        """The results of the models that are not folded away, the best model first."""
        groups = [group for model, group in self.models.items() if model not in self.folded]
        return [result for group in groups for result in group]

    @property
    def baseline(self) -> list[Result] | None:
        """The results of the best compared method of another family; None without one.

        Methods of a family begin with the same word: `sci_ring` is of the family of `sci`. Our
        variants of other families' methods are no baselines.
        """
        own_family = _family(self.study.best)
        others = (
            group
            for model, group in self.models.items()
            if model == method_of(model)
            and model not in self.folded
            and _family(model) != own_family
        )
        return next(others, None)

    @property
    def believed(self) -> Table:
        """A row a test day: how many answers were believed, and what the verdict got wrong."""
        return believed(self.best)

    def counted(self, number: str) -> int:
        """The sum of a number of what is believed over the test days, such as `accepted`.

        0 of a number that the results have not.
        """
        return int(np.nansum([result.number("distance", number) for result in self.best]))

    @property
    def dates(self) -> list[str]:
        """The dates of the test days."""
        return list(dates(self.study.results).values())

    @property
    def year(self) -> Markup:
        """Each model's share of right answers over the days since training.

        For a single test day it is drawn over the number of places instead.
        """
        results = self.compared
        if len(self.dates) == 1:
            return self._inline("year", curves.recall_at(results), {})
        marks = {}
        for result in results:
            share = percent(result.number("distance", "recall_at_1"), 1)
            text = f"{result.model}, {result.label}: {share} right"
            marks[result.id] = (result.model, result.sequence, text)
        figure = curves.year(results, self.study.train, (FAR,), curves.PAGE_IN)
        return self._inline("year", figure, marks)

    @property
    def knows(self) -> Markup:
        """On the last day: the share of queries that can be answered at each wanted precision."""
        last = [group[-1] for group in by_model(self.compared).values()]
        marks = {
            result.id: (result.model, result.sequence, words("front", "threshold", result=result))
            for result in last
        }
        return self._inline("knows", curves.coverage(last), marks)

    def _inline(self, name: str, figure: Figure, marks: Mapping[str, Mark]) -> Markup:
        page_name = anchor(self.study.name, self.study.grid, name)
        return inline(figure, self.study.simulated, page_name, marks)

    @property
    def scorecards(self) -> list[Table]:
        """A row a model, a column a test day: the compared models, then those folded away."""
        folded = [result for model in self.folded for result in self.models[model]]
        return [scorecard(results) for results in (self.compared, folded) if results]

    @property
    def altered(self) -> Table | None:
        """Recall@1 as driven and on altered queries, on the same days; None if none are altered."""
        rows = self.study.rows
        recall_rows = rows[
            (rows["protocol"] == "distance")
            & (rows["number"] == "recall_at_1")
            & (rows["kind"] == "")
            & (rows["seed"] == 0)
        ]
        recall_rows = recall_rows[
            recall_rows["change"].isin(["", "turned", "demolition", "construction"])
            & (recall_rows["sequence"] != "")
        ]
        days = recall_rows.loc[recall_rows["change"] != "", "sequence"].unique()
        recall_rows = recall_rows[
            recall_rows["sequence"].isin(days) & (recall_rows["stress"] == "")
        ]
        kinds = [
            Kind(*key)
            for key in recall_rows[["change", "level", "shadow"]]
            .drop_duplicates()
            .itertuples(index=False)
        ]
        means = (
            recall_rows.groupby(["method", "variant", "change", "level", "shadow"])["value"]
            .mean()
            .to_dict()
        )
        shown_kinds = sorted(kinds, key=lambda kind: kind.change != "")[: CASES + 1]
        table_rows = []
        slopes = indexed(
            self.study.driven.query(f"number == 'recall_at_1_per_{PER_DAYS}_days'"),
            "method",
            "variant",
        )
        for model in self.models:
            method, _, variant = model.partition("-")
            values = [
                means.get((method, variant, kind.change, kind.level, kind.shadow), np.nan)
                for kind in shown_kinds
            ]
            slope, *bounds = slopes.get((method, variant), NONE)
            older = difference(slope, DIGITS, (bounds[0], bounds[1]))
            table_rows += (
                [(model, *(number(value, DIGITS) for value in values), older)]
                if np.isfinite(values[1:]).any()
                else []
            )
        day_names = ", ".join(dates(self.study.results).get(day, day) for day in days)
        header = ("method", *(kind.label for kind in shown_kinds), f"{PER_DAYS} days older")
        return table("altered", header, table_rows, days=day_names) if table_rows else None

    @property
    def doubts(self) -> list[Finding]:
        """The findings on numbers that say little or nothing."""
        return findings.doubts(self.study)


def _family(model: str) -> str:
    return method_of(model).partition("_")[0]
