"""What the figures and tables are made of: one method's evaluation on one test sequence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.errors import InputError
from pipeline.evaluation.judgement import Evaluation
from pipeline.evaluation.numbers import NUMBERS


@dataclass(frozen=True)
class Result:
    """One `evaluations` artifact and the metrics.json beside it."""

    method: str
    sequence: str
    """The test sequence, named by its date."""
    numbers: Mapping[str, Any]
    """As `evaluation.judgement.summary` makes them: by protocol, and of calibration."""
    evaluation: Evaluation
    wanted_precision: float | None = None
    """What the thresholds were chosen for, on held-out blocks of training."""

    @property
    def days(self) -> int:
        """Whole days since the training sequence."""
        return int(self.numbers["days"] or 0)

    @property
    def label(self) -> str:
        """The date without a time of day, and the days since training: `2012-02-04, +20 d`."""
        return f"{self.sequence[:10]}, {self.days:+d} d"

    def number(self, protocol: str, name: str) -> float | None:
        """One number by one protocol; None where there is none."""
        value = self.numbers[protocol][name]
        return None if value is None else float(value)

    def interval(self, protocol: str, name: str) -> tuple[float, float] | None:
        """Its 95 % interval, lowest and highest; None where there is none."""
        if name not in NUMBERS:
            return None
        low, high = (float(bound) for bound in self.evaluation.protocol(protocol).interval[NUMBERS.index(name)])
        return (low, high) if low <= high else None


def some(results: Sequence[Result]) -> Sequence[Result]:
    """The results, of which a figure needs one at least."""
    if not results:
        raise InputError("a figure needs at least one result")
    return results


def by_method(results: Sequence[Result]) -> dict[str, list[Result]]:
    """The results of each method in the order of their days; methods in the order they come."""
    groups: dict[str, list[Result]] = {}
    for result in results:
        groups.setdefault(result.method, []).append(result)
    return {method: sorted(group, key=_when) for method, group in groups.items()}


def by_sequence(results: Sequence[Result]) -> dict[str, list[Result]]:
    """The results on each test sequence, in the order of its days; methods in the order they come."""
    groups: dict[str, list[Result]] = {}
    for result in sorted(results, key=_when):
        groups.setdefault(result.sequence, []).append(result)
    return groups


def dates(results: Sequence[Result]) -> dict[str, str]:
    """Each sequence's name without its time of day, unless two were driven on one day."""
    names = list(by_sequence(results))
    return {name: name[:10] if len({name[:10] for name in names}) == len(names) else name for name in names}


def _when(result: Result) -> tuple[int, str]:
    return result.days, result.sequence
