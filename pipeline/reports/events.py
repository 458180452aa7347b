"""The section on real changes: whether methods fail where a building went up or came down."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.events import NUMBERS, Bands, banded, distances
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.formats.changes import Change
from pipeline.reports.events_figures import SHOWN, TITLES, TO_COME, Nearby, by_distance
from pipeline.reports.result import Result, by_method, by_sequence, some
from pipeline.reports.section import Section, Shown
from pipeline.reports.style import save
from pipeline.reports.table import Table, bracket, number

READ = (
    "A row a method; bands of distance from left to right, all test sequences together. Filled: to the nearest change that shows"
    " on the day. Hollow, for comparison: queries that are nearer to one still to come, on the same kind of street before it"
    " changed; were these as low, the street would be hard and not the change. Bars are 95 % intervals; pale ones are of too few"
    " seen queries to say much. Below: how many queries there are, the seen alone for recall."
)
CHANCE = (
    "*Surely* means that the two 95 % intervals do not meet; they know of chance along the paths only, not of which few buildings"
    " changed, nor that what shows is met on later days."
)


def section(
    folder: Path,
    name: str,
    results: Sequence[Result],
    changes: Mapping[str, Iterable[Change]],
    bands: Bands,
    bootstrap: Bootstrap,
    simulated: bool,
    sources: Sequence[str],
    parameters: Mapping[str, Any],
) -> Section:
    """Draw events.svg into `folder` and tell what it shows; raises InputError for no results.

    `changes` of each test sequence are those that show on its day, in the frame of its queries.
    """
    nearby = near(some(results), changes, bands, bootstrap)
    save(by_distance(nearby, bands.names, bands.few, simulated), folder / "events.svg")
    methods = list(by_method(results))
    says = compared(nearby, methods, "auc_exact_top1", bands)
    tables = [
        (f"{title}, by {protocol}", table(nearby, methods, protocol, measure, bands))
        for protocol in PROTOCOLS
        for measure, title in TITLES.items()
    ]
    return Section(
        name,
        "Real changes: buildings that went up or came down",
        "Does a method fail near what has really changed since training?",
        (compared(nearby, methods, "recall_at_1", bands), answer(results, changes, bands), CHANCE),
        simulated,
        (Shown("events.svg", "Recall and AUC by the distance to the nearest change", READ, says),),
        tuple(tables),
        tuple(sources),
        {**parameters, "bands.edges_m": list(bands.edges_m), "bands.kinds": list(bands.kinds), "bands.few": bands.few},
    )


def near(results: Sequence[Result], changes: Mapping[str, Iterable[Change]], bands: Bands, bootstrap: Bootstrap) -> Nearby:
    """Every method by every protocol, near changes that show and near those to come."""
    paths = {sequence: group[0].evaluation.xy_m for sequence, group in by_sequence(results).items()}
    away_m = distances(paths, changes, bands.kinds)
    return {
        (method, protocol, when): banded(
            [result.evaluation for result in group], [away_m[result.sequence][i] for result in group], bands, protocol, bootstrap
        )
        for method, group in by_method(results).items()
        for protocol in PROTOCOLS
        for i, when in enumerate((SHOWN, TO_COME))
    }


def table(nearby: Nearby, methods: Sequence[str], protocol: str, name: str, bands: Bands) -> Table:
    """One number by one protocol: a row a method, a column a band, with intervals; then the oracle and how many queries."""
    at, first = NUMBERS.index(name), nearby[methods[0], protocol, SHOWN]
    rows = [(method, *(_cell(row[at]) for row in nearby[method, protocol, SHOWN].values)) for method in methods]
    if name == "recall_at_1":
        rows.append(("oracle", *(_cell(row[NUMBERS.index("oracle")]) for row in first.values)))
    rows += [("seen queries", *map(str, first.seen)), ("unseen queries", *map(str, first.unseen))]
    return Table(("nearest change", *bands.names), tuple(rows), words=1)


def answer(results: Sequence[Result], changes: Mapping[str, Iterable[Change]], bands: Bands) -> str:
    """How much there is to see: the changes, and the seen queries in the nearest band and in all but the farthest."""
    paths = {sequence: group[0].evaluation for sequence, group in by_sequence(results).items()}
    kinds = Counter(one.what for one in {one for sequence in paths for one in changes[sequence]} if one.what in bands.kinds)
    told = " and ".join(f"{kinds[kind]} {kind}{'' if kinds[kind] == 1 else 's'}" for kind in bands.kinds)
    away_m = distances({sequence: one.xy_m for sequence, one in paths.items()}, changes, bands.kinds)
    close = {name: int((paths[name].cells.seen & (shown <= bands.edges_m[-1])).sum()) for name, (shown, _) in away_m.items()}
    text = f"{told} show in the test sequences, and {sum(close.values())} seen queries lie within {bands.edges_m[-1]:g} m of one"
    most = max(close, key=lambda name: close[name])
    return f"{text}, {close[most]} of them on {most}." if close[most] else f"{text}: nothing to tell of."


def compared(nearby: Nearby, methods: Sequence[str], name: str, bands: Bands) -> str:
    """By cells, in the nearest band with enough seen queries: which methods surely do worse there once a change shows."""
    at, firsts = NUMBERS.index(name), [nearby[methods[0], "cells", when].seen for when in (SHOWN, TO_COME)]
    enough = np.flatnonzero(np.min(firsts, axis=0) >= bands.few)
    if not len(enough) or enough[0] == len(bands.names) - 1:
        return f"{TITLES[name]}: too few seen queries near changes, or near those to come, to say anything."
    band, worse, others = int(enough[0]), [], []
    for method in methods:
        (value, low, high), (before, lowest, _) = (nearby[method, "cells", when].values[band, at] for when in (SHOWN, TO_COME))
        if high < lowest:
            worse.append(f"`{method}` {number(value, 3)}{bracket((low, high), 3)} against {number(before, 3)}")
        else:
            others.append(f"`{method}` {number(value, 3)} against {number(before, 3)}")
    counts = f"{firsts[0][band]} and {firsts[1][band]} seen queries"
    parts = [f"surely lower where a change shows than where one is to come for {', '.join(worse)}"] if worse else []
    parts += [f"not surely lower for {', '.join(others)}"] if others else []
    return f"{TITLES[name]}, by cells, {bands.names[band]} away ({counts}): {'; '.join(parts)}."


def _cell(told: NDArray[np.float64]) -> str:
    value, low, high = told
    return number(value, 3) + bracket((low, high) if np.isfinite(low) else None, 3)
