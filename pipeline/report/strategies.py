"""Strategies of learning further days (METHODS 11.4): their numbers, tables and findings."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.evaluation.lifelong import CHANGE
from pipeline.report.findings import Finding
from pipeline.report.table import Cell, Table, average, spread, table
from pipeline.report.tables import BOTH
from pipeline.studies.models import ModelName

GROWN = "grown"
TUNED = "tuned"
JOINT = "joint"
UPDATED = "updated"
"""Strategies that are compared with each other: files of conf/strategy."""
UPDATES = "updates"
"""The order of days that nobody surveyed."""
PROTOCOL = "distance"
"""By which figures, findings and the terminal judge; the tables have both."""
NUMBERS = {
    "recall_of_all": "of all",
    "mean_recall": "mean",
    "forgetting": "forgetting",
    "transfer": "transfer",
}
COUNTS = {
    "asked": "scans asked",
    "adopted": "adopted",
    "wrong": "of these wrong",
    "changed": "submaps changed",
}


@dataclass(frozen=True, eq=False)
class StrategyNumbers:
    """The numbers of one strategy of one model in one order, over the model's seeds."""

    order: str
    model: str  # method and variant
    name: str  # of the strategy: a file of conf/strategy
    rows: pd.DataFrame  # those of the table of results

    @property
    def steps(self) -> list[str]:
        """The name of each step."""
        step_rows = self.rows[self.rows["number"] == "places"].sort_values("level")
        return list(dict.fromkeys(step_rows["sequence"]))

    @property
    def seeds(self) -> list[int]:
        """The seeds of which there is a model."""
        return sorted(set(self.rows.loc[self.rows["number"] == "places", "seed"]))

    @property
    def groups(self) -> list[str]:
        """The asked days, or the parts of the site."""
        return list(dict.fromkeys(self.rows.loc[self.rows["number"] == "recall_at_1", "sequence"]))

    def over(self, number: str, protocol: str = "", group: str = "") -> NDArray[np.float64]:
        """One number after each step (seed, step), of a group if given; NaN where there is none."""
        number_rows = self.rows[
            (self.rows["number"] == number) & (self.rows["protocol"] == protocol)
        ]
        number_rows = number_rows[number_rows["sequence"] == group] if group else number_rows
        wide = number_rows.pivot(index="seed", columns="level", values="value").reindex(
            self.seeds, columns=range(len(self.steps))
        )
        return np.asarray(wide, np.float64)

    def last(self, number: str, protocol: str = "", group: str = "") -> NDArray[np.float64]:
        """One number after the last step (seed,)."""
        return self.over(number, protocol, group)[:, -1]

    def matrix(self, protocol: str) -> NDArray[np.float64]:
        """Mean recall (step, group) over the seeds; NaN where no place of the group is known."""
        recall_by_group = [self.over("recall_at_1", protocol, group).T for group in self.groups]
        return np.array([[average(seeds) for seeds in steps] for steps in recall_by_group]).T


def read_strategies(rows: pd.DataFrame) -> list[StrategyNumbers]:
    """Every strategy of every model in every order, in the order of the rows.

    Strategies that were only timed are left out.
    """
    learning_rows = rows[rows["change"] == CHANGE]
    timed = learning_rows["number"] == "cpu_s"
    strategies = []
    learning_rows = pd.concat([learning_rows[~timed], learning_rows[timed]])
    for (kind, method, variant), group in learning_rows.groupby(
        ["kind", "method", "variant"], sort=False
    ):
        order, _, name = str(kind).partition(" ")
        strategies.append(
            StrategyNumbers(order, ModelName(str(method), str(variant)).name, name, group)
        )
    return [strategy for strategy in strategies if strategy.steps]


def by_order(strategies: Sequence[StrategyNumbers]) -> dict[str, list[StrategyNumbers]]:
    """Group the strategies by order."""
    return {
        order: [strategy for strategy in strategies if strategy.order == order]
        for order in dict.fromkeys(strategy.order for strategy in strategies)
    }


def by_strategy(
    strategies: Sequence[StrategyNumbers],
) -> dict[tuple[str, str], dict[str, StrategyNumbers]]:
    """Map model and strategy to its numbers in each order."""
    grouped: dict[tuple[str, str], dict[str, StrategyNumbers]] = {}
    for model in dict.fromkeys(strategy.model for strategy in strategies):
        for strategy in (strategy for strategy in strategies if strategy.model == model):
            grouped.setdefault((model, strategy.name), {})[strategy.order] = strategy
    return grouped


def of_order(order: str, strategies: Sequence[StrategyNumbers]) -> list[Table]:
    """All tables of one order."""
    updates = (
        [counts(strategies), *(asked_days(strategies, protocol) for protocol in BOTH)]
        if order == UPDATES
        else []
    )
    return [strategy_table(order, strategies), *updates]


def strategy_table(order: str, strategies: Sequence[StrategyNumbers]) -> Table:
    """Recall and forgetting after the last step by both protocols, places, and costs of a step."""
    rows = []
    for strategy in strategies:
        cells = [spread(strategy.last(name, protocol), 3) for protocol in BOTH for name in NUMBERS]
        first, *_, last = strategy.over("places")[0]
        step_s = [average(seconds[1:]) for seconds in strategy.over("cpu_s")]
        cost = spread(strategy.last("bytes") / 1e6, 1), spread(step_s, 1)
        rows.append(
            (
                strategy.model,
                strategy.name,
                *cells,
                Cell(f"{first:.0f} → {last:.0f}", float(last)),
                *cost,
            )
        )
    columns = [
        f"{protocol}: {title}" if title == "of all" else title
        for protocol in BOTH
        for title in NUMBERS.values()
    ]
    header = ("model", "strategy", *columns, "places", "model [MB]", "CPU [s] a step")
    return table("lifelong", header, rows, words=2, order=order)


def counts(strategies: Sequence[StrategyNumbers]) -> Table:
    """The numbers of adopted scans and of changed submaps over all steps."""
    rows = [
        (strategy.model, strategy.name, *(spread(_total(strategy, name), 0) for name in COUNTS))
        for strategy in strategies
    ]
    return table("lifelong_adopted", ("model", "strategy", *COUNTS.values()), rows, words=2)


def asked_days(strategies: Sequence[StrategyNumbers], protocol: str) -> Table:
    """Recall on each asked day before the first step and after the last."""
    days = list(dict.fromkeys(day for strategy in strategies for day in strategy.groups))
    rows = []
    for strategy in strategies:
        recall_by_day = {day: strategy.over("recall_at_1", protocol, day) for day in days}
        for step, when in ((0, "before"), (-1, "after")):
            rows.append(
                (
                    strategy.model,
                    strategy.name,
                    when,
                    *(spread(values[:, step], 3) for values in recall_by_day.values()),
                )
            )
    return table(
        "lifelong_asked", ("model", "strategy", "when", *days), rows, words=3, protocol=protocol
    )


def _total(strategy: StrategyNumbers, name: str) -> list[float]:
    """The sum over the steps for each seed; the first step adopts and counts nothing."""
    return [
        float(np.nansum(steps)) if np.isfinite(steps).any() else np.nan
        for steps in strategy.over(name)
    ]


def findings(strategies: Sequence[StrategyNumbers]) -> list[Finding]:
    """For each model: what growth forgets, what it lacks, and what a site regains by itself.

    A model has the findings that its strategies allow.
    """
    models = {
        model: [strategy for strategy in strategies if strategy.model == model]
        for model in dict.fromkeys(strategy.model for strategy in strategies)
    }
    context = {"protocol": PROTOCOL, "strategy": GROWN}
    verdicts = []
    for model, model_strategies in models.items():
        if entries := against(model_strategies, "forgetting", TUNED):
            verdicts.append(
                Finding("growth_forgets", model=model, reference=TUNED, listed=entries, **context)
            )
    for model, model_strategies in models.items():
        if entries := against(model_strategies, "recall_of_all", JOINT):
            verdicts.append(
                Finding("below_joint", model=model, reference=JOINT, listed=entries, **context)
            )
    for model_strategies in models.values():
        verdicts += regained(model_strategies)
    return verdicts


def against(
    strategies: Sequence[StrategyNumbers], number: str, reference: str
) -> list[dict[str, Any]]:
    """Compare one model's growth with a reference strategy in each order, after the last step.

    Gives the means of both over the seeds, and the mean, lowest and highest difference on the same
    seed.
    """
    by_key = {(strategy.order, strategy.name): strategy for strategy in strategies}
    entries = []
    for order in dict.fromkeys(strategy.order for strategy in strategies):
        if (order, GROWN) in by_key and (order, reference) in by_key:
            grown_values, reference_values = (
                by_key[order, name].last(number, PROTOCOL) for name in (GROWN, reference)
            )
            differences = grown_values - reference_values
            ends = {
                "low": float(differences.min()),
                "high": float(differences.max()),
                "seeds": len(differences),
            }
            entries.append(
                {
                    "order": order,
                    "own": average(grown_values),
                    "reference": average(reference_values),
                    "apart": average(differences),
                    **ends,
                }
            )
    return entries


def regained(strategies: Sequence[StrategyNumbers]) -> Iterator[Finding]:
    """One model's recall before and after days that nobody surveyed.

    Recall is of the last asked day and on average. Adds how many scans were adopted, and at a wrong
    pose.
    """
    updates = [strategy for strategy in strategies if strategy.order == UPDATES]
    entries = []
    for strategy in updates:
        recall = strategy.over("recall_at_1", PROTOCOL, strategy.groups[-1])
        means = strategy.over("mean_recall", PROTOCOL)
        counts = {
            name: average(np.nansum(strategy.over(name), axis=1))
            for name in ("asked", "adopted", "wrong")
        }
        ends = {
            "before": average(recall[:, 0]),
            "after": average(recall[:, -1]),
            "digits": int(counts["wrong"] % 1 > 0),
        }
        entries.append(
            {
                "strategy": strategy.name,
                "means": [average(means[:, 0]), average(means[:, -1])],
                **ends,
                **counts,
            }
        )
    for strategy in updates[:1]:
        yield Finding(
            "regained",
            model=strategy.model,
            protocol=PROTOCOL,
            last=strategy.groups[-1],
            seeds=len(strategy.seeds),
            listed=entries,
        )
