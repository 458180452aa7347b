"""What the table of results holds of strategies of learning further days (METHODS 11.4)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.evaluation.lifelong import CHANGE
from pipeline.report.table import average
from pipeline.studies.expansion import ModelName

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
    """One strategy of one model in one order, over the model's seeds."""

    order: str
    model: str  # method and variant
    strategy: str
    rows: pd.DataFrame  # those of the table of results

    @property
    def steps(self) -> list[str]:
        """The name of each step."""
        own = self.rows[self.rows["number"] == "places"].sort_values("level")
        return list(dict.fromkeys(own["sequence"]))

    @property
    def seeds(self) -> list[int]:
        """Of which there is a model."""
        return sorted(set(self.rows.loc[self.rows["number"] == "places", "seed"]))

    @property
    def groups(self) -> list[str]:
        """The days that were asked, or the parts of the site."""
        return list(dict.fromkeys(self.rows.loc[self.rows["number"] == "recall_at_1", "sequence"]))

    def over(self, number: str, protocol: str = "", group: str = "") -> NDArray[np.float64]:
        """One number after each step (seed, step), of a group where it has one; NaN where there is
        none."""
        own = self.rows[(self.rows["number"] == number) & (self.rows["protocol"] == protocol)]
        own = own[own["sequence"] == group] if group else own
        wide = own.pivot(index="seed", columns="level", values="value").reindex(
            self.seeds, columns=range(len(self.steps))
        )
        return np.asarray(wide, np.float64)

    def last(self, number: str, protocol: str = "", group: str = "") -> NDArray[np.float64]:
        """The same after the last step (seed,)."""
        return self.over(number, protocol, group)[:, -1]

    def matrix(self, protocol: str) -> NDArray[np.float64]:
        """Recall (step, group), means over the seeds; NaN where no place of the group is known
        yet."""
        every = [self.over("recall_at_1", protocol, group).T for group in self.groups]
        return np.array([[average(seeds) for seeds in steps] for steps in every]).T


def strategies(rows: pd.DataFrame) -> list[StrategyNumbers]:
    """Every strategy of every model in every order, in the order of the rows; of what was timed
    alone, none."""
    own = rows[rows["change"] == CHANGE]
    timed = own["number"] == "cpu_s"
    found = []
    own = pd.concat([own[~timed], own[timed]])
    for (kind, method, variant), group in own.groupby(["kind", "method", "variant"], sort=False):
        order, _, strategy = str(kind).partition(" ")
        found.append(
            StrategyNumbers(order, ModelName(str(method), str(variant)).name, strategy, group)
        )
    return [one for one in found if one.steps]


def by_order(every: Sequence[StrategyNumbers]) -> dict[str, list[StrategyNumbers]]:
    """The strategies of each order."""
    return {
        order: [one for one in every if one.order == order]
        for order in dict.fromkeys(one.order for one in every)
    }


def by_strategy(
    every: Sequence[StrategyNumbers],
) -> dict[tuple[str, str], dict[str, StrategyNumbers]]:
    """Model and strategy to what there is of them in each order."""
    found: dict[tuple[str, str], dict[str, StrategyNumbers]] = {}
    for model in dict.fromkeys(one.model for one in every):
        for one in (one for one in every if one.model == model):
            found.setdefault((model, one.strategy), {})[one.order] = one
    return found
