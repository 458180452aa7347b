"""Numbers of a localiser that learns day after day (METHODS 11.4): recall, forgetting, cost.

In: the artifact of `lifelong`, which days were learned at each step and what was answered then.
Out: rows of the table of results.

Forgetting is InCloud's F (Knights et al., IROS 2022): of the queries that could be answered after
an earlier step, how many more were answered right then.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.schemas import Lifelong
from pipeline.evaluation.rows import TableRows, number_rows

CHANGE = "lifelong"


@dataclass(frozen=True)
class Course:
    """One strategy's answers after each step, right or wrong."""

    right: NDArray[np.bool_]
    """(step, query)."""
    known_from: NDArray[np.int64]
    """(query,) the step from which its place is known; −1 for never."""
    group: NDArray[np.int64]
    """(query,) index of the day asked, or of the part of the site."""
    groups: Sequence[str]
    steps: Sequence[str]
    later: NDArray[np.bool_]
    """(step, group) whether the group is a day after all that was learned by then."""

    @classmethod
    def of(cls, lifelong: Lifelong, protocol: str) -> Self:
        """The course of a `lifelong` artifact, by cells or by distance."""
        right_by_distance = lifelong.error_m <= lifelong.correct_m
        right = lifelong.right if protocol == "cells" else right_by_distance
        if lifelong.order == "streets":
            steps = lifelong.steps
            never = np.zeros((len(steps), len(steps)), bool)
            return cls(right, lifelong.known_from, lifelong.known_from, steps, steps, never)
        later = np.greater(*np.ix_(lifelong.asked_ns, lifelong.learned_ns)).T
        return cls(right, lifelong.known_from, lifelong.day, lifelong.asked, lifelong.steps, later)

    def recall(self, step: int, group: int, known_by: int | None = None) -> float:
        """The share of right answers after a step to a group's queries with a known place.

        Known by this step, or by the earlier one `known_by`; NaN without such queries.
        """
        last_step = step if known_by is None else known_by
        is_known = (self.known_from >= 0) & (self.known_from <= last_step)
        is_asked = is_known & (self.group == group)
        return float(self.right[step, is_asked].mean()) if is_asked.any() else np.nan

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(step, group) recall; NaN where no place of the group is known yet."""
        return np.array(
            [
                [self.recall(step, group) for group in range(len(self.groups))]
                for step in range(len(self.steps))
            ]
        )

    def mean_recall(self, step: int) -> float:
        """Mean recall over the groups that have a known place."""
        return _mean([self.recall(step, group) for group in range(len(self.groups))])

    def recall_of_all(self, step: int) -> float:
        """The share of right answers among all queries whose place is known after the last step."""
        return float(self.right[step, self.known_from >= 0].mean())

    def forgetting(self, step: int) -> float:
        """The most that was lost since an earlier step, mean over the groups; 0 after the first."""
        if not step:
            return 0.0
        lost = [
            [self.recall(past, group) - self.recall(step, group, past) for past in range(step)]
            for group in range(len(self.groups))
        ]
        return _mean(
            [
                max(finite)
                for losses in lost
                if (finite := [value for value in losses if np.isfinite(value)])
            ]
        )

    def transfer(self, step: int) -> float:
        """Gain since the first step on the queries known then, mean over the days to come."""
        coming = np.flatnonzero(self.later[step]).tolist()
        return _mean([self.recall(step, group, 0) - self.recall(0, group, 0) for group in coming])


def _mean(values: Sequence[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else np.nan


def lifelong_rows(lifelong: Lifelong) -> TableRows:
    """Rows of one strategy: recall after each step in each group, and over all."""
    for step, name in enumerate(lifelong.steps):
        columns = _step_columns(lifelong.order, lifelong.strategy, step)
        for protocol in ("cells", "distance"):
            course = Course.of(lifelong, protocol)
            for group, group_name in enumerate(course.groups):
                yield from number_rows(
                    columns | {"sequence": group_name},
                    protocol,
                    {"recall_at_1": course.recall(step, group)},
                )
            numbers = {
                "mean_recall": course.mean_recall(step),
                "recall_of_all": course.recall_of_all(step),
                "forgetting": course.forgetting(step),
                "transfer": course.transfer(step),
            }
            yield from number_rows(columns, protocol, numbers)
        counts = {
            "places": lifelong.places[step],
            "bytes": lifelong.bytes[step],
            **lifelong.counts[step],
            "correct_m": lifelong.correct_m,
        }
        yield from number_rows(columns | {"sequence": name}, "", counts)


def cost_rows(course: Mapping[str, Any]) -> TableRows:
    """Rows of CPU seconds of each step.

    `course` is the json that the stage keeps beside the artifact; `place` in it are the columns of
    the model.
    """
    for step, (name, seconds) in enumerate(zip(course["steps"], course["cpu_s"], strict=True)):
        yield from number_rows(
            course["place"]
            | _step_columns(course["order"], course["strategy"], step)
            | {"sequence": name},
            "",
            {"cpu_s": seconds},
        )


def _step_columns(order: str, strategy: str, step: int) -> dict[str, Any]:
    """The columns that say which step of which strategy."""
    return {
        "case": f"{order} {strategy} {step}",
        "change": CHANGE,
        "kind": f"{order} {strategy}",
        "level": float(step),
    }
