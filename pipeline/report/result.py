"""One model on one test sequence, and how such results are grouped."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError
from pipeline.evaluation.doubts import VOID
from pipeline.evaluation.judgement import Evaluation

# a number and its 95 % interval, lowest and highest; NaN where there is none
Values = tuple[float, float, float]
DATE = re.compile(r"\d{4}-\d\d-\d\d")
NONE: Values = (np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class Result:
    """One model on one test sequence as it was driven."""

    model: str  # such as sci or scan_context-engaged
    sequence: str  # the test sequence, named by its date
    days: int  # whole days since the training sequence
    evaluation: Evaluation
    wanted_precision: float  # what the thresholds were chosen for, on held-out blocks of training
    numbers: Mapping[tuple[str, str], Values]  # by protocol and number

    @property
    def label(self) -> str:
        """The date without a time of day, and the days since training: `2012-02-04, +20 d`."""
        return f"{day(self.sequence)}, {self.days:+d} d"

    @property
    def posed(self) -> bool:
        """Whether the model answers with poses."""
        return not np.isnan(self.evaluation.reject_pose_from)

    @property
    def kept(self) -> float:
        """Precision on held-out blocks of training at the threshold in use.

        NaN where it is unknown or the threshold accepts nothing.
        """
        return self.evaluation.kept_precision[0]

    def void(self, protocol: str) -> bool:
        """Whether the numbers by that protocol mean nothing.

        So it is where one constant answer to every query would do as well, or no query is seen.
        """
        return (protocol, VOID) in self.numbers

    def number(self, protocol: str, name: str) -> float:
        """One number by one protocol; NaN where there is none."""
        return self.numbers.get((protocol, name), NONE)[0]

    def interval(self, protocol: str, name: str) -> tuple[float, float] | None:
        """The 95 % interval of one number, lowest and highest; None where there is none."""
        _, low, high = self.numbers.get((protocol, name), NONE)
        return (low, high) if low <= high else None


def by_model(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Group the results by model, each group in the order of days.

    Models stay in the order they come. Raises InputError for no results.
    """
    ordered = _by_day(results)
    return {
        model: [result for result in ordered if result.model == model]
        for model in dict.fromkeys(result.model for result in results)
    }


def of_one_model(results: Sequence[Result]) -> list[Result]:
    """The results of the first model in the order of days; raises InputError for no results."""
    return next(iter(by_model(results).values()))


def by_sequence(results: Sequence[Result]) -> dict[str, list[Result]]:
    """Group the results by test sequence, in the order of days.

    Models stay in the order they come. Raises InputError for no results.
    """
    ordered = _by_day(results)
    return {
        name: [result for result in ordered if result.sequence == name]
        for name in dict.fromkeys(result.sequence for result in ordered)
    }


def _by_day(results: Sequence[Result]) -> list[Result]:
    if not results:
        raise InputError("a figure needs at least one result")
    return sorted(results, key=lambda result: (result.days, result.sequence))


def day(sequence: str) -> str:
    """The date in a sequence's name, without the time of day.

    For a part of a log it is the part's name; for a name without a date, the whole name.
    """
    return sequence[:10] if DATE.match(sequence) else sequence.partition("+")[2] or sequence


def dates(results: Sequence[Result]) -> dict[str, str]:
    """Map each sequence to its date; to its whole name where two were driven on one day."""
    names = list(by_sequence(results))
    return {name: day(name) if len(set(map(day, names))) == len(names) else name for name in names}
