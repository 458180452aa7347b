"""The first screen of a study on the page, and what stands below it: numbers alone, whose words are
in the templates."""

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
    """Of one study at one cell size."""

    study: Study

    @cached_property
    def summary(self) -> Summary:
        """The models, the best first."""
        summary = Summary.of(self.study.rows, self.study.words)
        return replace(
            summary, rows=[row for row in summary.rows if row.model in self.study.families]
        )

    @property
    def best(self) -> Row:
        """The first of them."""
        return self.summary.rows[0]

    @property
    def second(self) -> Row | None:
        """The best of another method; None where there is one method."""
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
        """Of the two: the others are drawn thin."""
        return {row.model: role for row, role in ((self.second, NEXT), (self.best, BEST)) if row}

    @property
    def dates(self) -> list[str]:
        """Of the test days, without the time of day."""
        named = dates(self.study.results)
        return [named[sequence] for sequence in self.summary.tests]

    @property
    def year(self) -> Chart:
        """Each model's share of right answers over the days since training; of a single day over
        the places that it named."""
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
            {day: f"{day:+d} d" for day in _spaced(days)},
            HIGH,
        )

    @property
    def _places(self) -> Chart:
        """How often a right answer is among the first n."""
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
        """Of the last day: the share of the judged queries that each model answers where at least
        so many answers are right."""
        lines = []
        for model, group in by_model(self.study.results).items():
            novelty, right = _judged_queries(group[-1])
            accepted = novelty < group[-1].evaluation.reject_from[0]
            kept = float(right[accepted].mean()) if accepted.any() else np.nan
            share = float(accepted.mean())
            says = (
                f"{model}, at its own threshold: answers {percent(share, 1)}, {percent(kept, 1)} "
                "of them right"
            )
            promised = group[-1].kept
            wanted = group[-1].wanted_precision
            says += (
                f"; it keeps {percent(promised, 1)} on held-out blocks, wanted {percent(wanted)}"
                * (promised < wanted)
            )
            lines.append(
                Series(
                    model,
                    PRECISIONS,
                    coverage(novelty, right),
                    dots=[(max(kept, PRECISIONS[0]), share, says)],
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
        """How often models are right when their queries are altered, and as driven on the same
        days; None where none are."""
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
        named = ", ".join(dates(self.study.results).get(day, day) for day in days)
        header = ("method", *(kind.label for kind in shown_kinds), f"{PER_DAYS} days older")
        return table("altered", header, table_rows, days=named) if table_rows else None

    @property
    def cut_short(self) -> list[tuple[str, float]]:
        """The models that had less than their own full training, and which share of it they had."""
        learned = (
            (name, model)
            for name, model in self.study.models.items()
            if name in self.study.trained and model.rounds
        )
        shares = ((name, float(model.recipe.get("budget", 1.0))) for name, model in learned)
        return [(name, share) for name, share in shares if share < 1]

    @property
    def doubts(self) -> list[Finding]:
        """What makes numbers say little, or nothing."""
        return findings.doubts(self.study)


def coverage(novelty: NDArray[np.floating], right: NDArray[np.bool_]) -> list[float]:
    """For each of PRECISIONS the largest share of the queries (q,) that can be accepted, least new
    first, so that at least so many of the accepted are right; 0 where none can."""
    if not len(novelty):
        return [np.nan] * len(PRECISIONS)
    order = np.argsort(novelty, kind="stable")
    whole = np.append(
        np.flatnonzero(np.diff(novelty[order])), len(order) - 1
    )  # equal novelties are accepted together
    accepted = whole + 1
    precision = np.cumsum(right[order])[whole] / accepted
    return [
        float(max(accepted[precision >= least - ROUNDING], default=0) / len(order))
        for least in PRECISIONS
    ]


def _judged_queries(result: Result) -> tuple[NDArray[np.floating], NDArray[np.bool_]]:
    """Novelty (q,) of the queries that are judged by distance, and whether the first answer to each
    is right."""
    judgement = result.evaluation.distance
    judged = judgement.outcome != NOT_JUDGED
    return result.evaluation.novelty[judged, 0], (judgement.seen & (judgement.true_rank == 0))[
        judged
    ]


def _spaced(days: Sequence[int]) -> list[int]:
    """Those of the days whose labels do not touch: the last, then backwards."""
    kept: list[int] = []
    for day in sorted(days, reverse=True):
        if not kept or kept[-1] - day >= ROOM * max(max(days) - min(0, *days), 1):
            kept.append(day)
    return kept[::-1]
