"""One model on one test sequence, and how such results are grouped by model or by sequence.

In: the rows of the table of results that are of one study and cell size. Out: `Scores`, the numbers
of a model on a test sequence; a `Result` holds each of its queries too. Figures, tables and
findings of a study of the year are made of lists of them.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.core.errors import ArtifactError, InputError
from pipeline.evaluation.bootstrap import NONE, Estimate
from pipeline.evaluation.caveats import DEGENERATE
from pipeline.evaluation.evaluations import NOT_JUDGED, Evaluation
from pipeline.evaluation.numbers import average
from pipeline.evaluation.rows import UNPERTURBED, indexed, pick
from pipeline.evaluation.steadiness import AWC_FT

# The titles of the numbers that a study is about.
TITLES = {
    "recall_at_1": "recall@1",
    "auc_top1": "AUC top-1",
    "auc_exact_top1": "exact AUC",
    AWC_FT: "AwC-FT",
}
DATE = re.compile(r"\d{4}-\d\d-\d\d")
# The precisions at which coverage is measured.
PRECISIONS = [percent / 100 for percent in range(50, 101)]
ROUNDING = 1e-9  # a precision may fall short of one of PRECISIONS by so much
AnyScores = TypeVar("AnyScores", bound="Scores")
Item = TypeVar("Item")


@dataclass(frozen=True, eq=False)
class Scores:
    """The numbers of one model on one unperturbed test sequence."""

    model: str  # such as sci or scan_context-engaged
    sequence: str  # the test sequence, named by its date
    days: int  # whole days since the training sequence
    rows: pd.DataFrame  # its rows of the table of results, those of the whole year among them

    @cached_property
    def numbers(self) -> dict[tuple[str, str], Estimate]:
        """Protocol and number to its value and interval."""
        return indexed(self.rows, "protocol", "number")

    @property
    def label(self) -> str:
        """The date without a time of day, and the days since training: `2012-02-04, +20 d`."""
        return f"{day(self.sequence)}, {self.days:+d} d"

    @property
    def id(self) -> str:
        """The result in the ids of figures: `sci-2012-02-04`."""
        return re.sub(r"[^0-9A-Za-z]+", "-", f"{self.model}-{self.sequence}")

    @property
    def validation_precision(self) -> float:
        """The validation precision of the threshold in use.

        NaN if it is unknown, or the threshold accepts nothing.
        """
        return self.number("distance", "validation_precision")

    @property
    def target_precision(self) -> float:
        """The precision that the thresholds were chosen for on validation blocks of training."""
        return self.number("distance", "target_precision")

    @property
    def kept_precision(self) -> float | None:
        """The precision that accepted poses keep, of at most .99; None if none can be kept.

        None also without poses, and if the table of results does not say.
        """
        kept = self.number("distance", "kept_precision")
        return None if np.isnan(kept) else kept

    @property
    def keeps_nothing(self) -> bool:
        """Whether the poses can keep no target precision, so that none is accepted."""
        return ("distance", "kept_precision") in self.numbers and self.kept_precision is None

    @property
    def posed(self) -> bool:
        """Whether the model answers with poses."""
        return ("distance", "within_2m_5deg") in self.numbers

    def degenerate(self, protocol: str) -> bool:
        """Whether the numbers by that protocol mean nothing.

        They mean nothing if a single answer would be right for half of the queries, or if
        no query is seen.
        """
        return (protocol, DEGENERATE) in self.numbers

    def values(self, protocol: str, name: str) -> Estimate:
        """One number by one protocol and its 95 % interval; NaN where there is none."""
        return self.numbers.get((protocol, name), NONE)

    def number(self, protocol: str, name: str) -> float:
        """One number by one protocol; NaN where there is none."""
        return self.values(protocol, name).value


@dataclass(frozen=True, eq=False)
class Result(Scores):
    """One model on one unperturbed test sequence, with each query judged."""

    evaluation: Evaluation

    @property
    def coverage(self) -> list[float]:
        """For each of PRECISIONS the largest share of the queries that can be accepted at it.

        See `coverage`; right answers are those by distance.
        """
        judgement = self.evaluation.distance
        is_judged = judgement.outcome != NOT_JUDGED
        right = (judgement.seen & (judgement.true_rank == 0))[is_judged]
        return coverage(self.evaluation.novelty[is_judged, 0], right)


def read_scores(rows: pd.DataFrame, tests: Sequence[str]) -> list[Scores]:
    """The scores of each model's first seed on each test sequence, from the rows of a study's grid.

    Raises ArtifactError for a table of an earlier version, which does not say how near is right.
    """
    unperturbed = pick(rows, ask=UNPERTURBED, seed=0)
    judged = pick(unperturbed[unperturbed["sequence"].isin(tests)], protocol="distance")
    days = judged.groupby("sequence")["days"].first().astype(int)
    models = pick(judged, number="answered")["model"].unique()
    groups = dict(iter(unperturbed.groupby(["model", "sequence"])))
    scores = []
    for model, sequence in product(models, days.index):
        # Rows without a model are of the study; rows without a sequence are of all its tests.
        levels = (("", ""), (model, ""), (model, sequence))
        own = pd.concat([groups[level] for level in levels if level in groups])
        scores.append(Scores(model, str(sequence), days[sequence], own))
    if scores and ("distance", "correct_m") not in scores[0].numbers:
        raise ArtifactError(
            "the tables of results do not say how near is right; `dvc repro` gathers them again"
        )
    return scores


def coverage(novelty: NDArray[np.floating], right: NDArray[np.bool_]) -> list[float]:
    """For each of PRECISIONS the largest share of the queries that can be accepted at it.

    Takes the novelty (q,) of each query and whether its answer is right (q,). Queries are accepted
    in the order of their novelty, least first. The share is 0 where no threshold has the precision,
    and NaN if there are no queries.
    """
    if not len(novelty):
        return [np.nan] * len(PRECISIONS)
    order = np.argsort(novelty, kind="stable")
    # equal novelties are accepted together
    ends = np.append(np.flatnonzero(np.diff(novelty[order])), len(order) - 1)
    accepted = ends + 1
    precision = np.cumsum(right[order])[ends] / accepted
    return [
        float(max(accepted[precision >= least - ROUNDING], default=0) / len(order))
        for least in PRECISIONS
    ]


def by_model(results: Sequence[AnyScores]) -> dict[str, list[AnyScores]]:
    """Group the results by model, each group in the order of days.

    The models keep their order. Raises InputError if there are no results.
    """
    groups = grouped(_by_day(results), "model")
    return {model: groups[model] for model in grouped(results, "model")}


def ranked(results: Sequence[AnyScores]) -> dict[str, list[AnyScores]]:
    """Group the results by model, the highest mean recall@1 by distance first."""
    groups = by_model(results)
    means = {model: mean(group, "distance", "recall_at_1") for model, group in groups.items()}
    return dict(sorted(groups.items(), key=lambda item: -np.nan_to_num(means[item[0]], nan=-1.0)))


def mean(results: Sequence[Scores], protocol: str, name: str) -> float:
    """The mean of one number over the results that have it; NaN if none has it."""
    return float(average([result.number(protocol, name) for result in results]))


def by_sequence(results: Sequence[AnyScores]) -> dict[str, list[AnyScores]]:
    """Group the results by test sequence, the sequences in the order of days.

    The models keep their order. Raises InputError if there are no results.
    """
    return grouped(_by_day(results), "sequence")


def grouped(items: Iterable[Item], attribute: str) -> dict[str, list[Item]]:
    """Group scores or strategies by one of their attributes; groups and items keep their order."""
    groups: dict[str, list[Item]] = {}
    for item in items:
        groups.setdefault(getattr(item, attribute), []).append(item)
    return groups


def is_posed(model: str) -> bool:
    """Whether a model, such as `sci-4way-pose`, answers with poses, by its name."""
    return "pose" in model.split("-")


def _by_day(results: Sequence[AnyScores]) -> list[AnyScores]:
    if not results:
        raise InputError("a figure needs at least one result")
    return sorted(results, key=lambda result: (result.days, result.sequence))


def day(sequence: str) -> str:
    """The date in a sequence's name, without the time of day.

    A part of a log, as in `log+part`, is named by its part; another name without a date is returned
    whole.
    """
    return sequence[:10] if DATE.match(sequence) else sequence.partition("+")[2] or sequence


def dates(results: Sequence[Scores]) -> dict[str, str]:
    """Map each sequence to its date; to its whole name where two were driven on one day."""
    names = list(by_sequence(results))
    are_distinct = len(set(map(day, names))) == len(names)
    return {name: day(name) if are_distinct else name for name in names}
