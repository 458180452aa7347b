"""The first screen of a study on the page and the charts below it; templates hold the words."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.judgement import NOT_JUDGED
from pipeline.evaluation.study_rows import PER_DAYS
from pipeline.report import findings
from pipeline.report.comparison import Kind
from pipeline.report.findings import Finding
from pipeline.report.render import percent
from pipeline.report.result import NONE, Result, by_model, dates
from pipeline.report.study import Study, indexed
from pipeline.report.summary import Row, Summary, scorecard
from pipeline.report.table import Table, difference, number, table
from pipeline.report.web.chart import BEST, NEXT, Chart, Series, chart
from pipeline.studies.colours import method_of

HIGH = 430.0
LOW = 310.0  # px of the first chart and of the other
ROOM = 0.12  # of the days, that the label of one takes
ROUNDING = 1e-9
CASES = 4  # so many kinds of altered queries have a column
PRECISIONS = [percent / 100 for percent in range(50, 101)]
DIGITS = 3


@dataclass(frozen=True)
class Front:
    """The numbers on the first screen of one study at one cell size."""

    study: Study

    @cached_property
    def summary(self) -> Summary:
        """The models, the best first."""
        summary = Summary.of(self.study.rows, self.study.settings)
        return replace(
            summary, rows=[row for row in summary.rows if row.model in self.study.families]
        )

    @property
    def best(self) -> Row:
        """The best model."""
        return self.summary.rows[0]

    @property
    def second(self) -> Row | None:
        """The best model of another method; None where there is one method."""
        return next(
            (
                row
                for row in self.summary.rows
                if method_of(row.model) != method_of(self.best.model)
            ),
            None,
        )

    @property
    def roles(self) -> dict[str, str]:
        """Maps the two best models to how they are drawn; other models are drawn thin."""
        return {row.model: role for row, role in ((self.second, NEXT), (self.best, BEST)) if row}

    @property
    def dates(self) -> list[str]:
        """The dates of the test days."""
        date_of = dates(self.study.results)
        return [date_of[sequence] for sequence in self.summary.tests]

    @property
    def year(self) -> Chart:
        """Each model's share of right answers over the days since training.

        For a single test day it is drawn over the number of places instead.
        """
        days = self.summary.days
        if len(days) == 1:
            return self._places
        lines = []
        for row in self.summary.rows:
            points = zip(days, row.right, self.dates, strict=True)
            dots = [
                (day, share, f"{row.model}, {name}: {percent(share, 1)} right")
                for day, share, name in points
            ]
            bounds = row.bounds if row is self.best else ()
            lines.append(Series(row.model, days, row.right, bounds, dots, self.summary.tests))
        return chart(
            lines,
            self.roles,
            (min(0, *days), max(days)),
            {day: f"{day:+d} d" for day in _spaced_days(days)},
            HIGH,
        )

    @property
    def _places(self) -> Chart:
        """How often a right answer is among the first n places."""
        lines = []
        longest = 1
        for model, (result, *_) in by_model(self.study.results).items():
            shares = result.evaluation.distance.recall_at
            longest = max(longest, len(shares))
            dots = [(1.0, float(shares[0]), f"{model}: {percent(shares[0], 1)} right at once")]
            lines.append(
                Series(
                    model,
                    list(range(1, len(shares) + 1)),
                    shares.tolist(),
                    (),
                    dots,
                    self.summary.tests,
                )
            )
        return chart(
            lines,
            self.roles,
            (1, longest),
            {n: str(n) for n in (1, 5, 10, 15, 20, 25) if n <= longest},
            HIGH,
        )

    @property
    def knows(self) -> Chart:
        """On the last day: the share of queries that can be answered at each wanted precision."""
        lines = []
        for model, group in by_model(self.study.results).items():
            novelty, right = _judged_queries(group[-1])
            accepted = novelty < group[-1].evaluation.reject_from[0]
            kept = float(right[accepted].mean()) if accepted.any() else np.nan
            share = float(accepted.mean())
            label = (
                f"{model}, at its own threshold: answers {percent(share, 1)}, {percent(kept, 1)} "
                "of them right"
            )
            kept_precision = group[-1].kept
            wanted = group[-1].wanted_precision
            if kept_precision < wanted:
                label += (
                    f"; it keeps {percent(kept_precision, 1)} on held-out blocks, "
                    f"wanted {percent(wanted)}"
                )
            lines.append(
                Series(
                    model,
                    PRECISIONS,
                    coverage(novelty, right),
                    dots=[(max(kept, PRECISIONS[0]), share, label)],
                )
            )
        ticks = {share: percent(share) for share in (0.5, 0.6, 0.7, 0.8, 0.9, 1.0)}
        return chart(lines, self.roles, (PRECISIONS[0], PRECISIONS[-1]), ticks, LOW)

    @property
    def scorecard(self) -> Table:
        """A row a model, a column a test day."""
        return scorecard(self.summary, self.dates)

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
        for row in self.summary.rows:
            method, _, variant = row.model.partition("-")
            values = [
                means.get((method, variant, kind.change, kind.level, kind.shadow), np.nan)
                for kind in shown_kinds
            ]
            slope, *bounds = slopes.get((method, variant), NONE)
            older = difference(slope, DIGITS, (bounds[0], bounds[1]))
            table_rows += (
                [(row.model, *(number(value, DIGITS) for value in values), older)]
                if np.isfinite(values[1:]).any()
                else []
            )
        day_names = ", ".join(dates(self.study.results).get(day, day) for day in days)
        header = ("method", *(kind.label for kind in shown_kinds), f"{PER_DAYS} days older")
        return table("altered", header, table_rows, days=day_names) if table_rows else None

    @property
    def cut_short(self) -> list[tuple[str, float]]:
        """The models that had less than their full training, and their share of it."""
        trained_models = (
            (name, model)
            for name, model in self.study.models.items()
            if name in self.study.trained and model.rounds
        )
        shares = ((name, float(model.recipe.get("budget", 1.0))) for name, model in trained_models)
        return [(name, share) for name, share in shares if share < 1]

    @property
    def doubts(self) -> list[Finding]:
        """The findings on numbers that say little or nothing."""
        return findings.doubts(self.study)


def coverage(novelty: NDArray[np.floating], right: NDArray[np.bool_]) -> list[float]:
    """For each of PRECISIONS: the largest share of the queries that can be accepted at it.

    Queries (q,) are accepted in the order of their novelty, least first; 0 where none can be.
    """
    if not len(novelty):
        return [np.nan] * len(PRECISIONS)
    order = np.argsort(novelty, kind="stable")
    # equal novelties are accepted together
    whole = np.append(np.flatnonzero(np.diff(novelty[order])), len(order) - 1)
    accepted = whole + 1
    precision = np.cumsum(right[order])[whole] / accepted
    return [
        float(max(accepted[precision >= least - ROUNDING], default=0) / len(order))
        for least in PRECISIONS
    ]


def _judged_queries(result: Result) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
    """Novelty (q,) of the queries judged by distance, and whether their first answer is right."""
    judgement = result.evaluation.distance
    is_judged = judgement.outcome != NOT_JUDGED
    return result.evaluation.novelty[is_judged, 0], (judgement.seen & (judgement.true_rank == 0))[
        is_judged
    ]


def _spaced_days(days: Sequence[int]) -> list[int]:
    """The days whose labels do not touch: the last one, then backwards."""
    kept: list[int] = []
    for day in sorted(days, reverse=True):
        if not kept or kept[-1] - day >= ROOM * max(max(days) - min(0, *days), 1):
            kept.append(day)
    return kept[::-1]
