"""The numbers of the study of cells: every method's at every size, over the test sequences."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.reports.result import Result, by_method
from pipeline.reports.table import present

Evaluated = Mapping[str, Sequence[Result]]
"""Grid to its results."""


def values(results: Sequence[Result], method: str, protocol: str, name: str) -> list[float]:
    """One number of a method on each test sequence that has it."""
    return present([result.number(protocol, name) for result in results if result.method == method])


def methods(evaluated: Evaluated) -> list[str]:
    """In the order they come."""
    return list(dict.fromkeys(result.method for results in evaluated.values() for result in results))


def average(found: Sequence[float]) -> float:
    """NaN of none."""
    return float(np.mean(found)) if found else np.nan


def deviation(found: Sequence[float]) -> float:
    """Standard deviation; 0 of fewer than two, which have no bar."""
    return float(np.std(found, ddof=1)) if len(found) > 1 else 0.0


def oracle(results: Sequence[Result], protocol: str) -> float:
    """Mean recall@1 of the nearest training anchor's place."""
    return average(present([r.number(protocol, "oracle") for r in next(iter(by_method(results).values()))]))
