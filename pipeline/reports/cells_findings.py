"""What the study of cells says, in sentences made of its numbers."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.reports.cells_numbers import Evaluated, average, methods, values
from pipeline.reports.result import Result, by_method
from pipeline.reports.table import mean, number, signed


def trend(evaluated: Evaluated, cell_m: Mapping[str, float], protocol: str, name: str, title: str) -> str:
    """Which way a number goes from the smallest cells to the largest, method by method, on the same sequences."""
    if len(evaluated) < 2:
        return f"One size alone tells nothing of how {title} depends on it."
    small, large = ([*evaluated.values()][i] for i in (0, -1))
    apart = {method: differences(small, large, method, protocol, name) for method in methods(evaluated)}
    there = {method: found for method, found in apart.items() if found}
    ways = {"rises": [m for m, found in there.items() if min(found) > 0], "falls": [m for m, f in there.items() if max(f) < 0]}
    parts = [
        f"{way} on every sequence for {len(which) or 'none'} of {len(there)} methods"
        + (f" ({', '.join(f'`{method}` {signed(mean(there[method]), 3)}' for method in which)})" if which else "")
        for way, which in ways.items()
    ]
    first, last = [f"{cell_m[grid]:g}" for grid in evaluated][:: len(evaluated) - 1]
    return f"From {first} to {last} m, {title} {' and '.join(parts)}."


def differences(small: Sequence[Result], large: Sequence[Result], method: str, protocol: str, name: str) -> list[float]:
    """Large cells' number minus small cells' on each sequence that has both."""
    before, after = (
        {result.sequence: result.number(protocol, name) for result in results if result.method == method}
        for results in (small, large)
    )
    both = [(before[sequence], after[sequence]) for sequence in before.keys() & after.keys()]
    return sorted(late - early for early, late in both if early is not None and late is not None)


def best(evaluated: Evaluated, cell_m: Mapping[str, float], protocol: str, name: str, title: str) -> str:
    """The first method at each size."""
    parts = []
    for grid, results in evaluated.items():
        means = {method: average(values(results, method, protocol, name)) for method in by_method(results)}
        there = {method: value for method, value in means.items() if np.isfinite(value)}
        if there:
            first = max(there, key=lambda method: there[method])
            parts.append(f"`{first}` at {cell_m[grid]:g} m ({number(there[first], 3)})")
    return f"Highest mean {title}: {', '.join(parts) or 'none'}."
