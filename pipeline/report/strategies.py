"""Strategies of learning further days (docs/METHODS.md, 11.4): their numbers, and what they show.

In: the rows of the table of results that are on learning further days. Out: a `Strategy` for each
model, order of days and strategy, whose numbers figures and tables show, and the findings on them.
A step learns a day (or a part of a day); after each step the same days are queried.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.evaluation.numbers import average
from pipeline.evaluation.rows import COURSE, pick
from pipeline.report.findings import Finding
from pipeline.report.result import grouped

# Strategies that are compared with each other: files of conf/strategy.
INCREMENTAL = "incremental"
FINE_TUNED = "fine_tuned"
JOINT = "joint"
SELF_TRAINED = "self_trained"
SELF_TRAINING = "self_training"  # the order of days without reference poses
PROTOCOL = "distance"  # by which figures, findings and the terminal judge; tables have both


@dataclass(frozen=True, eq=False)
class Strategy:
    """The numbers of one strategy of one model in one order, over the model's seeds."""

    order: str
    model: str  # method and variant
    name: str  # a file of conf/strategy
    rows: pd.DataFrame  # its rows of the table of results

    @property
    def steps(self) -> list[str]:
        """The name of each step."""
        return [*pick(self.rows, number="places").sort_values("at")["sequence"].unique()]

    @property
    def seeds(self) -> list[int]:
        """The seeds that the model was trained with."""
        return sorted(pick(self.rows, number="places")["seed"].unique())

    @property
    def groups(self) -> list[str]:
        """The days that are queried after each step, or the parts of the site."""
        return [*pick(self.rows, number="recall_at_1")["sequence"].unique()]

    def over(self, number: str, protocol: str = "", group: str = "") -> NDArray[np.float64]:
        """One number after each step (seed, step), NaN where there is none; of a group if given."""
        rows = pick(self.rows, number=number, protocol=protocol)
        if group:
            rows = pick(rows, sequence=group)
        wide = rows.pivot(index="seed", columns="at", values="value")
        return np.asarray(wide.reindex(self.seeds, columns=range(len(self.steps))), np.float64)

    def last(self, number: str, protocol: str = "", group: str = "") -> NDArray[np.float64]:
        """One number after the last step (seed,)."""
        return self.over(number, protocol, group)[:, -1]

    def total(self, number: str) -> list[float]:
        """The sum of a number over the steps, for each seed."""
        return [*pd.DataFrame(self.over(number)).sum(axis=1, min_count=1)]

    def matrix(self, protocol: str) -> NDArray[np.float64]:
        """Mean recall (step, group) over the seeds; NaN where no place of the group is known."""
        recalls = [self.over("recall_at_1", protocol, group) for group in self.groups]
        return np.array(
            [[average(recall[:, step]) for recall in recalls] for step in range(len(self.steps))]
        )


def read_strategies(rows: pd.DataFrame) -> list[Strategy]:
    """Every strategy of every model in every order, in the order of the rows.

    Strategies that were only timed are left out.
    """
    rows = pick(rows, ask=COURSE)
    is_time = rows["number"] == "cpu_s"
    rows = pd.concat([rows[~is_time], rows[is_time]])
    strategies = []
    for (course, model), group in rows.groupby(["of", "model"], sort=False):
        order, _, name = course.partition(" ")
        strategies.append(Strategy(order, model, name, group))
    return [strategy for strategy in strategies if strategy.steps]


def findings(strategies: Sequence[Strategy]) -> list[Finding]:
    """For each model: forgetting, distance from joint training, and what self-training regains.

    Which of these findings a model has depends on its strategies.
    """
    models = grouped(strategies, "model")
    all_findings = []
    for kind, number, reference in (
        ("incremental_forgets", "forgetting", FINE_TUNED),
        ("below_joint", "recall_of_all", JOINT),
    ):
        for model, group in models.items():
            if listed := against(group, number, reference):
                values = {"listed": listed, "protocol": PROTOCOL, "strategy": INCREMENTAL}
                all_findings.append(Finding(kind, model=model, reference=reference, **values))
    for group in models.values():
        all_findings += regained(group)
    return all_findings


def against(strategies: Sequence[Strategy], number: str, reference: str) -> list[dict[str, Any]]:
    """Compare incremental learning of one model with a reference strategy, after the last step.

    Returns for each order the means of both over the seeds, and the mean, lowest and highest
    difference between models of the same seed.
    """
    entries = []
    for order, group in grouped(strategies, "order").items():
        last = {strategy.name: strategy.last(number, PROTOCOL) for strategy in group}  # (seed,)
        if INCREMENTAL in last and reference in last:
            differences = last[INCREMENTAL] - last[reference]
            entries.append(
                {
                    "order": order,
                    "own": average(last[INCREMENTAL]),
                    "reference": average(last[reference]),
                    "difference": average(differences),
                    "low": float(differences.min()),
                    "high": float(differences.max()),
                    "seeds": len(differences),
                }
            )
    return entries


def regained(strategies: Sequence[Strategy]) -> Iterator[Finding]:
    """One model's recall before and after days without reference poses, if it had any.

    Recall is that of the last queried day, and the mean of all. The finding adds how many scans
    were pseudo-labelled, and how many of them at a wrong pose.
    """
    self_training = [strategy for strategy in strategies if strategy.order == SELF_TRAINING]
    entries = []
    for strategy in self_training:
        recall = strategy.over("recall_at_1", PROTOCOL, strategy.groups[-1])
        means = strategy.over("mean_recall", PROTOCOL)
        queried, pseudo_labelled, wrong = (
            average(np.nansum(strategy.over(name), axis=1))
            for name in ("queried", "pseudo_labelled", "wrong")
        )
        entries.append(
            {
                "strategy": strategy.name,
                "before": average(recall[:, 0]),
                "after": average(recall[:, -1]),
                "means": [average(means[:, 0]), average(means[:, -1])],
                "queried": queried,
                "pseudo_labelled": pseudo_labelled,
                "wrong": wrong,
                "digits": int(wrong % 1 > 0),
            }
        )
    if self_training:
        first = self_training[0]
        yield Finding(
            "regained",
            model=first.model,
            protocol=PROTOCOL,
            last=first.groups[-1],
            seeds=len(first.seeds),
            listed=entries,
        )
