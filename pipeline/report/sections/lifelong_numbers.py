"""Strategies of learning further days (METHODS 11.4), read from the table of results."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.evaluation.lifelong import CHANGE
from pipeline.report.table import average
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
