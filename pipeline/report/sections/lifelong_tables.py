"""Tables of learning further days: a row a model and strategy, means ± deviation over the seeds."""

from collections.abc import Sequence

import numpy as np

from pipeline.report.sections.lifelong_numbers import UPDATES, StrategyNumbers
from pipeline.report.table import Cell, Table, average, spread, table
from pipeline.report.tables import BOTH

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
