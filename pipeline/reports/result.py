"""What the figures and tables are made of: one method's judgement on one test sequence."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.evaluation.judgement import Judgement


@dataclass(frozen=True)
class Result:
    """One `evaluations` artifact and the metrics.json beside it."""

    method: str
    sequence: str
    """The test sequence, named by its date."""
    numbers: Mapping[str, float | None]
    """As `evaluation.judgement.summary` makes them."""
    judgement: Judgement

    @property
    def days(self) -> int:
        """Whole days since the training sequence."""
        return int(self.numbers["days"] or 0)

    @property
    def label(self) -> str:
        """The date without a time of day, and the days since training: `2012-02-04, +20 d`."""
        return f"{self.sequence[:10]}, {self.days:+d} d"


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


def _when(result: Result) -> tuple[int, str]:
    return result.days, result.sequence
