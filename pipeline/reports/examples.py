"""Which queries to show: right ones over the year, and the wrong ones that looked least new."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.judgement import FALSE_ALARM, HIT, Evaluation
from pipeline.reports.result import Result, some

Which = Callable[[Evaluation], NDArray[np.bool_]]
RIGHT = 3
"""Sequences to show a right example of."""
WRONG: tuple[tuple[str, int, Which], ...] = (
    ("next cell", 1, lambda e: (e.cells.outcome == FALSE_ALARM) & e.cells.seen & (e.distance.outcome == HIT)),
    ("misplaced", 4, lambda e: e.distance.seen & (e.distance.true_rank != 0) & (e.cells.true_rank != 0)),
    ("unseen", 2, lambda e: (e.distance.outcome == FALSE_ALARM) & e.distance.unseen),
)
"""What can be wrong with an answer, how many examples of it to show, and which queries (q,) they are."""
APART_M = 40.0
"""Examples of one kind are at least this far apart: one of each stretch of path, and not five neighbours."""
TURNED_DEG = 90.0


@dataclass(frozen=True, eq=False)
class Example:
    """A query to show, and what became of it."""

    result: Result
    query: int
    verdict: str

    @property
    def wrong(self) -> bool:
        """Whether its answer is."""
        return self.verdict != "right"

    @property
    def xy_m(self) -> NDArray[np.float64]:
        """Where the query was taken, (2,)."""
        place: NDArray[np.float64] = self.result.evaluation.xy_m[self.query]
        return place

    @property
    def novelty(self) -> float:
        """By the kind in use."""
        return float(self.result.evaluation.novelty[self.query, 0])

    def caption(self) -> str:
        """What there is to say of it, in four lines."""
        e, i = self.result.evaluation, self.query
        accepted = "accepted" if self.novelty < e.reject_from[0] else "rejected"
        error = f"{e.error_m[i]:.1f}" if e.error_m[i] < 9.95 else f"{e.error_m[i]:.0f}"
        said = f"novelty {self.novelty:.3f}, {error} m off"
        return f"{self.verdict}, {accepted}\n{self.result.label}\n{said}\nheading {degrees(e.turn_deg[i])} to training"


def choose(results: Sequence[Result]) -> list[Example]:
    """Examples of one method: right ones, over the year and one turned; and the wrong ones that looked least new.

    First a query that is right by distance but in a neighbouring cell, then misplaced ones, then unseen ones that were accepted.
    """
    group = sorted(some(results), key=lambda result: result.days)
    chosen = _right(group)
    for verdict, number, which in WRONG:
        found: list[Example] = []
        for example in _surest(group, verdict, which):
            if len(found) < number and _apart(example, found):
                found.append(example)
        chosen += found
    return chosen


def _right(group: Sequence[Result]) -> list[Example]:
    """The hit of median novelty in sequences spread over the year, then the surest one that drove another way than training."""
    hits = {result.sequence: _surest([result], "right", lambda e: e.cells.outcome == HIT) for result in group}
    there = [ordered for ordered in hits.values() if ordered]
    chosen: list[Example] = []
    for n in sorted({round(at) for at in np.linspace(0, len(there) - 1, RIGHT)}) if there else ():
        ordered, middle = there[n], len(there[n]) // 2
        outwards = [ordered[i] for i in sorted(range(len(ordered)), key=lambda i: abs(i - middle))]
        chosen.append(next((example for example in outwards if _apart(example, chosen)), ordered[middle]))
    turned = _surest(group, "right", lambda e: (e.cells.outcome == HIT) & (np.abs(e.turn_deg) > TURNED_DEG))
    shown = {(example.result.sequence, example.query) for example in chosen}
    return chosen + [example for example in turned if (example.result.sequence, example.query) not in shown][:1]


def _surest(group: Sequence[Result], verdict: str, which: Which) -> list[Example]:
    """The queries of some kind in all sequences, least new first."""
    found = [Example(result, int(i), verdict) for result in group for i in np.flatnonzero(which(result.evaluation))]
    return sorted(found, key=lambda example: example.novelty)


def degrees(angle_deg: float) -> str:
    """With its sign, typographically: `+4°`, `−177°`."""
    return f"{round(angle_deg):+d}°".replace("-", "−")


def _apart(example: Example, others: Sequence[Example]) -> bool:
    return all(np.linalg.norm(example.xy_m - other.xy_m) >= APART_M for other in others)
