"""One model on one test sequence, and how such results are grouped."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.core.errors import ArtifactError, InputError
from pipeline.evaluation.doubts import VOID
from pipeline.evaluation.judgement import NOT_JUDGED, Evaluation
from pipeline.report.selection import NONE, Values, indexed
from pipeline.report.table import average
from pipeline.studies.models import ModelName

TITLES = {"recall_at_1": "recall@1", "auc_top1": "AUC top-1", "auc_exact_top1": "exact AUC"}
"""Of the numbers that a study is about."""
DATE = re.compile(r"\d{4}-\d\d-\d\d")
PRECISIONS = [percent / 100 for percent in range(50, 101)]
ROUNDING = 1e-9
AnyScores = TypeVar("AnyScores", bound="Scores")


@dataclass(frozen=True)
class Scores:
    """The numbers of one model on one test sequence as it was driven."""

    model: str  # such as sci or scan_context-engaged
    sequence: str  # the test sequence, named by its date
    days: int  # whole days since the training sequence
    # by protocol and number; those of all sequences too
    numbers: Mapping[tuple[str, str], Values]

    @property
    def label(self) -> str:
        """The date without a time of day, and the days since training: `2012-02-04, +20 d`."""
        return f"{day(self.sequence)}, {self.days:+d} d"

    @property
    def id(self) -> str:
        """The result in the ids of figures: `sci-2012-02-04`."""
        return re.sub(r"[^0-9A-Za-z]+", "-", f"{self.model}-{self.sequence}")

    @property
    def kept(self) -> float:
        """Precision on held-out blocks of training at the threshold in use.

        NaN where it is unknown or the threshold accepts nothing.
        """
        return self.number("distance", "kept_precision")

    @property
    def wanted_precision(self) -> float:
        """The precision that the thresholds were chosen for, on held-out blocks of training."""
        return self.number("distance", "wanted_precision")

    @property
    def posed(self) -> bool:
        """Whether the model answers with poses."""
        return ("distance", "within_2m_5deg") in self.numbers

    def void(self, protocol: str) -> bool:
        """Whether the numbers by that protocol mean nothing.

        So it is where one constant answer to every query would do as well, or no query is seen.
        """
        return (protocol, VOID) in self.numbers

    def values(self, protocol: str, name: str) -> Values:
        """One number by one protocol and its 95 % interval; NaN where there is none."""
        return self.numbers.get((protocol, name), NONE)

    def number(self, protocol: str, name: str) -> float:
        """One number by one protocol; NaN where there is none."""
        return self.values(protocol, name)[0]


@dataclass(frozen=True)
class Result(Scores):
    """One model on one test sequence as it was driven, with each of its queries."""

    evaluation: Evaluation

    @property
    def coverage(self) -> list[float]:
        """By distance, for each of PRECISIONS: the largest share that can be accepted at it.

        Judged queries are accepted in the order of their novelty, least first.
        """
        judgement = self.evaluation.distance
        is_judged = judgement.outcome != NOT_JUDGED
        right = (judgement.seen & (judgement.true_rank == 0))[is_judged]
        return coverage(self.evaluation.novelty[is_judged, 0], right)


def read_scores(rows: pd.DataFrame, tests: Sequence[str]) -> list[Scores]:
    """The scores of each model's first seed on each test sequence, from the rows of a study's grid.

    Raises ArtifactError for a table of an earlier version, which does not say how near is right.
    """
    driven = rows[(rows[["change", "kind", "stress"]] == "").all(axis=1) & (rows["seed"] == 0)]
    judged = driven[driven["sequence"].isin(tests) & (driven["protocol"] == "distance")]
    days = judged.groupby("sequence")["days"].first().astype(int)
    numbers: dict[tuple[str, str], dict[tuple[str, str], Values]] = {}
    for (method, variant, sequence), group in driven.groupby(["method", "variant", "sequence"]):
        numbers[ModelName(method, variant).name, sequence] = indexed(group, "protocol", "number")
    answered = judged[judged["number"] == "answered"]
    models = answered[["method", "variant"]].drop_duplicates().itertuples(index=False)
    names = [ModelName(*model).name for model in models]
    if names and ("distance", "correct_m") not in numbers.get(("", ""), ()):
        raise ArtifactError(
            "the tables of results do not say how near is right; `dvc repro` gathers them anew"
        )
    return [
        Scores(
            name,
            str(sequence),
            days[sequence],
            numbers["", ""] | numbers.get((name, ""), {}) | numbers.get((name, sequence), {}),
        )
        for name in names
        for sequence in days.index
    ]


def coverage(novelty: NDArray[np.floating], right: NDArray[np.bool_]) -> list[float]:
    """For each of PRECISIONS: the largest share of the queries that can be accepted at it.

    Queries (q,) are accepted in the order of their novelty, least first; 0 where none can be.
    """
    if not len(novelty):
        return [np.nan] * len(PRECISIONS)
    order = np.argsort(novelty, kind="stable")
    # equal novelties are accepted together
    whole = np.append(np.flatnonzero(np.diff(novelty[order])), len(order) - 1)
    accepted = whole + 1
    precision = np.cumsum(right[order])[whole] / accepted
    return [
        float(max(accepted[precision >= least - ROUNDING], default=0) / len(order))
        for least in PRECISIONS
    ]


def by_model(results: Sequence[AnyScores]) -> dict[str, list[AnyScores]]:
    """Group the results by model, each group in the order of days.

    Models stay in the order they come. Raises InputError for no results.
    """
    ordered = _by_day(results)
    return {
        model: [result for result in ordered if result.model == model]
        for model in dict.fromkeys(result.model for result in results)
    }


def ranked(results: Sequence[AnyScores]) -> dict[str, list[AnyScores]]:
    """Group the results by model, the highest mean recall@1 by distance first."""
    groups = by_model(results)
    means = {model: mean(group, "distance", "recall_at_1") for model, group in groups.items()}
    return dict(sorted(groups.items(), key=lambda item: -np.nan_to_num(means[item[0]], nan=-1.0)))


def mean(results: Sequence[Scores], protocol: str, name: str) -> float:
    """The mean of one number over some results that have it; NaN where none has."""
    return average([result.number(protocol, name) for result in results])


def by_sequence(results: Sequence[AnyScores]) -> dict[str, list[AnyScores]]:
    """Group the results by test sequence, in the order of days.

    Models stay in the order they come. Raises InputError for no results.
    """
    ordered = _by_day(results)
    return {
        name: [result for result in ordered if result.sequence == name]
        for name in dict.fromkeys(result.sequence for result in ordered)
    }


def _by_day(results: Sequence[AnyScores]) -> list[AnyScores]:
    if not results:
        raise InputError("a figure needs at least one result")
    return sorted(results, key=lambda result: (result.days, result.sequence))


def day(sequence: str) -> str:
    """The date in a sequence's name, without the time of day.

    For a part of a log it is the part's name; for a name without a date, the whole name.
    """
    return sequence[:10] if DATE.match(sequence) else sequence.partition("+")[2] or sequence


def dates(results: Sequence[Scores]) -> dict[str, str]:
    """Map each sequence to its date; to its whole name where two were driven on one day."""
    names = list(by_sequence(results))
    return {name: day(name) if len(set(map(day, names))) == len(names) else name for name in names}
