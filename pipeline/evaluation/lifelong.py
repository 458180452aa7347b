"""Numbers of a localiser that learns day after day (METHODS 11.4): recall, forgetting, transfer.

In: the artifact of the stage `lifelong`, with the answers to all queries after each step of
learning. Out: rows of the table of results.

- Forgetting is InCloud's F (Knights et al., IROS 2022): how much higher the recall was after an
  earlier step, on the queries that could be answered by then.
- Transfer is how much further days improve the answers on days that are still to come.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.schemas import Lifelong
from pipeline.evaluation.numbers import average
from pipeline.evaluation.rows import COURSE, TableRows, number_rows


@dataclass(frozen=True)
class Course:
    """Which answers are right after each step of one strategy of learning.

    Queries come in groups: the queries of a test day, or, if a site is learned street by street,
    those of a street. A place is known once a step has learned it.
    """

    right: NDArray[np.bool_]
    """(step, query) whether the first answer after that step is right."""
    known_from: NDArray[np.int64]
    """(query,) the step from which the query's place is known; −1 for never."""
    group: NDArray[np.int64]
    """(query,) index of the query's group."""
    groups: Sequence[str]
    """Names of the groups."""
    steps: Sequence[str]
    """Names of the steps."""
    later: NDArray[np.bool_]
    """(step, group) whether the group's day is after all days learned by that step."""

    @classmethod
    def of(cls, lifelong: Lifelong, protocol: str) -> Self:
        """The course of a `lifelong` artifact, by cells or by distance."""
        right_by_distance = lifelong.error_m <= lifelong.correct_m
        right = lifelong.right if protocol == "cells" else right_by_distance
        if lifelong.order == "streets":  # each step learns a street; all are of one day
            streets = lifelong.steps
            later = np.zeros((len(streets), len(streets)), bool)
            return cls(right, lifelong.known_from, lifelong.known_from, streets, streets, later)
        later = np.array(lifelong.queried_ns) > np.array(lifelong.learned_ns)[:, None]
        return cls(
            right, lifelong.known_from, lifelong.day, lifelong.queried, lifelong.steps, later
        )

    def recall(self, step: int, group: int, known_by: int | None = None) -> float:
        """The share of right answers after a step, among a group's queries with a known place.

        The place is known by this step, or by the earlier step `known_by` if it is given. NaN
        without such queries.
        """
        last_step = step if known_by is None else known_by
        is_known = (self.known_from >= 0) & (self.known_from <= last_step)
        is_queried = is_known & (self.group == group)
        return float(self.right[step, is_queried].mean()) if is_queried.any() else np.nan

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The recall (step, group); NaN where no place of the group is known yet."""
        return np.array(
            [
                [self.recall(step, group) for group in range(len(self.groups))]
                for step in range(len(self.steps))
            ]
        )

    def mean_recall(self, step: int) -> float:
        """The mean recall after a step over the groups that have a known place."""
        return float(average([self.recall(step, group) for group in range(len(self.groups))]))

    def recall_of_all(self, step: int) -> float:
        """The share of right answers after a step, of the queries whose place is ever known."""
        return float(self.right[step, self.known_from >= 0].mean())

    def forgetting(self, step: int) -> float:
        """The largest loss of recall since any earlier step, as a mean over the groups.

        It is 0 after the first step.
        """
        if not step:
            return 0.0
        largest_losses = []
        for group in range(len(self.groups)):
            losses = []
            for past in range(step):
                loss = self.recall(past, group) - self.recall(step, group, known_by=past)
                if np.isfinite(loss):
                    losses.append(loss)
            if losses:
                largest_losses.append(max(losses))
        return float(average(largest_losses))

    def transfer(self, step: int) -> float:
        """The gain of recall since the first step, as a mean over the days still to come.

        Only queries count whose place is known from the first step.
        """
        gains = []
        for group in np.flatnonzero(self.later[step]).tolist():
            gains.append(self.recall(step, group, known_by=0) - self.recall(0, group, known_by=0))
        return float(average(gains))


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
    """Rows of the CPU seconds of each step.

    `course` is the json that the stage keeps beside the artifact; its `place` holds the columns
    that name the model.
    """
    for step, (name, seconds) in enumerate(zip(course["steps"], course["cpu_s"], strict=True)):
        step_columns = _step_columns(course["order"], course["strategy"], step)
        columns = course["place"] | step_columns | {"sequence": name}
        yield from number_rows(columns, "", {"cpu_s": seconds})


def _step_columns(order: str, strategy: str, step: int) -> dict[str, Any]:
    """The columns that say which step of which strategy."""
    return {
        "ask": COURSE,
        "of": f"{order} {strategy}",
        "at": float(step),
    }
