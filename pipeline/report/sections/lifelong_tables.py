"""Tables of learning further days: a row a model and strategy, means and deviations over the
seeds."""

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


def of_order(order: str, found: Sequence[StrategyNumbers]) -> list[Table]:
    """All tables of one order."""
    updates = [counts(found), *(asked_days(found, by) for by in BOTH)] if order == UPDATES else []
    return [strategies(order, found), *updates]


def strategies(order: str, found: Sequence[StrategyNumbers]) -> Table:
    """Recall and forgetting after the last step by both protocols, places, and what a step
    costs."""
    rows = []
    for one in found:
        cells = [spread(one.last(name, by), 3) for by in BOTH for name in NUMBERS]
        first, *_, last = one.over("places")[0]
        step_s = [average(seconds[1:]) for seconds in one.over("cpu_s")]
        cost = spread(one.last("bytes") / 1e6, 1), spread(step_s, 1)
        rows.append(
            (one.model, one.strategy, *cells, Cell(f"{first:.0f} → {last:.0f}", float(last)), *cost)
        )
    columns = [
        f"{by}: {title}" if title == "of all" else title
        for by in BOTH
        for title in NUMBERS.values()
    ]
    header = ("model", "strategy", *columns, "places", "model [MB]", "CPU [s] a step")
    return table("lifelong", header, rows, words=2, order=order)


def counts(found: Sequence[StrategyNumbers]) -> Table:
    """What was adopted over all steps, and how many submaps changed."""
    rows = [
        (one.model, one.strategy, *(spread(_total(one, name), 0) for name in COUNTS))
        for one in found
    ]
    return table("lifelong_adopted", ("model", "strategy", *COUNTS.values()), rows, words=2)


def asked_days(found: Sequence[StrategyNumbers], protocol: str) -> Table:
    """Recall on each asked day before the first step and after the last."""
    days = list(dict.fromkeys(day for one in found for day in one.groups))
    rows = []
    for one in found:
        every = {day: one.over("recall_at_1", protocol, day) for day in days}
        for at, when in ((0, "before"), (-1, "after")):
            rows.append(
                (
                    one.model,
                    one.strategy,
                    when,
                    *(spread(values[:, at], 3) for values in every.values()),
                )
            )
    return table(
        "lifelong_asked", ("model", "strategy", "when", *days), rows, words=3, protocol=protocol
    )


def _total(one: StrategyNumbers, name: str) -> list[float]:
    """Of each seed, over the steps; the first step adopts nothing and counts nothing."""
    return [
        float(np.nansum(steps)) if np.isfinite(steps).any() else np.nan for steps in one.over(name)
    ]
