"""The tables on learning further days: recall and forgetting after the last step, and costs.

A step learns one day; after it the same days are asked again (docs/METHODS.md, 11.4).
"""

from collections.abc import Sequence
from itertools import product

from pipeline.report.strategies import UPDATES, Strategy
from pipeline.report.table import Cell, Table, average, spread, table
from pipeline.report.tables.columns import DISTANCE_FIRST

# The numbers of `learning` by each protocol, and their headings.
LEARNING = {
    "recall_of_all": "of all",
    "mean_recall": "mean",
    "forgetting": "forgetting",
    "transfer": "transfer",
}
# The numbers of `adopted`, and their headings.
ADOPTED = {
    "asked": "scans asked",
    "adopted": "adopted",
    "wrong": "of these wrong",
    "changed": "submaps changed",
}


def of_order(order: str, strategies: Sequence[Strategy]) -> list[Table]:
    """All tables of one order of learning further days."""
    tables = [learning(order, strategies)]
    if order == UPDATES:
        tables += [adopted(strategies), *(asked_days(strategies, by) for by in DISTANCE_FIRST)]
    return tables


def learning(order: str, strategies: Sequence[Strategy]) -> Table:
    """Recall and forgetting after the last step by both protocols, places, and costs of a step."""
    columns = list(product(DISTANCE_FIRST, LEARNING))  # protocol and number of each
    rows = []
    for strategy in strategies:
        places = strategy.over("places")[0]  # (step,) of the first seed
        # step 0 is the first training, whose cost is another table's
        cpu_s = [average(of_seed[1:]) for of_seed in strategy.over("cpu_s")]
        rows.append(
            (
                strategy.model,
                strategy.name,
                *(spread(strategy.last(name, protocol), 3) for protocol, name in columns),
                Cell(f"{places[0]:.0f} → {places[-1]:.0f}", float(places[-1])),
                spread(strategy.last("bytes") / 1e6, 1),
                spread(cpu_s, 1),
            )
        )
    titles = []
    for protocol, name in columns:
        is_first_of_protocol = name == "recall_of_all"
        titles.append(f"{protocol}: {LEARNING[name]}" if is_first_of_protocol else LEARNING[name])
    header = ("model", "strategy", *titles, "places", "model [MB]", "CPU [s] a step")
    return table("lifelong", header, rows, text_columns=2, order=order)


def adopted(strategies: Sequence[Strategy]) -> Table:
    """The numbers of adopted scans and of changed submaps over all steps."""
    rows = [
        (strategy.model, strategy.name, *(spread(strategy.total(name), 0) for name in ADOPTED))
        for strategy in strategies
    ]
    header = ("model", "strategy", *ADOPTED.values())
    return table("lifelong_adopted", header, rows, text_columns=2)


def asked_days(strategies: Sequence[Strategy], protocol: str) -> Table:
    """Recall on each asked day before the first step and after the last."""
    days = list(dict.fromkeys(day for strategy in strategies for day in strategy.groups))
    rows = []
    for strategy in strategies:
        recalls = [strategy.over("recall_at_1", protocol, day) for day in days]  # (seed, step) each
        for when, step in (("before", 0), ("after", -1)):
            cells = [spread(recall[:, step], 3) for recall in recalls]
            rows.append((strategy.model, strategy.name, when, *cells))
    header = ("model", "strategy", "when", *days)
    return table("lifelong_asked", header, rows, text_columns=3, protocol=protocol)
