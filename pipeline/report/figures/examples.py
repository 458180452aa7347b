"""Which queries Fig. 7 shows: right ones over the year, and the wrong ones of least novelty."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluation.judgement import FALSE_ALARM, HIT, Evaluation
from pipeline.report.study import Result, some

Which = Callable[[Evaluation], NDArray[np.bool_]]
RIGHT = 3  # sequences with a right example
WRONG: tuple[tuple[str, int, Which], ...] = (
    ("next cell", 1, lambda e: (e.cells.outcome == FALSE_ALARM) & e.cells.seen & (e.distance.outcome == HIT)),
    ("misplaced", 4, lambda e: e.distance.seen & (e.distance.true_rank != 0) & (e.cells.true_rank != 0)),
    ("unseen", 2, lambda e: (e.distance.outcome == FALSE_ALARM) & e.distance.unseen),
)
"""Kinds of wrong answers, how many examples to show of each, and which queries (q,) they are."""
APART_M = 40.0  # least distance between examples of one kind, so that they are no neighbours
TURNED_DEG = 90.0


@dataclass(frozen=True, eq=False)
class Example:
    """A query to show."""

    result: Result
    query: int
    verdict: str  # "right" or a kind of wrong answer

    @property
    def xy_m(self) -> NDArray[np.float64]:
        """Position of the query (2,)."""
        return np.asarray(self.result.evaluation.xy_m[self.query])

    @property
    def novelty(self) -> float:
        """The one in use."""
        return float(self.result.evaluation.novelty[self.query, 0])

    def caption(self) -> str:
        """Verdict, sequence, novelty, error and heading, in four lines."""
        e, i = self.result.evaluation, self.query
        accepted = "accepted" if self.novelty < e.reject_from[0] else "rejected"
        numbers = f"novelty {self.novelty:.3f}, {e.error_m[i]:.{int(e.error_m[i] < 9.95)}f} m off"
        return f"{self.verdict}, {accepted}\n{self.result.label}\n{numbers}\nheading {degrees(e.turn_deg[i])} to training"

    def apart(self, others: Sequence["Example"]) -> bool:
        """At least APART_M from all others."""
        return all(np.linalg.norm(self.xy_m - other.xy_m) >= APART_M for other in others)


def choose(results: Sequence[Result]) -> list[Example]:
    """Examples of one model: right ones over the year, one of them turned, and the wrong ones of least novelty by kind."""
    group = sorted(some(results), key=lambda result: result.days)
    chosen = _right(group)
    for verdict, number, which in WRONG:
        found: list[Example] = []
        for example in _surest(group, verdict, which):
            if len(found) < number and example.apart(found):
                found.append(example)
        chosen += found
    return chosen


def _right(group: Sequence[Result]) -> list[Example]:
    """The hit of median novelty in sequences spread over the year; then the surest one that drove another way than training."""
    every = (_surest([result], "right", lambda e: e.cells.outcome == HIT) for result in group)
    hits = [ordered for ordered in every if ordered]
    chosen: list[Example] = []
    for n in np.unique(np.linspace(0, len(hits) - 1, RIGHT).round().astype(int)) if hits else ():
        middle = len(hits[n]) // 2
        outwards = sorted(range(len(hits[n])), key=lambda i: abs(i - middle))
        chosen.append(next((hits[n][i] for i in outwards if hits[n][i].apart(chosen)), hits[n][middle]))
    turned = _surest(group, "right", lambda e: (e.cells.outcome == HIT) & (np.abs(e.turn_deg) > TURNED_DEG))
    shown = {(example.result.sequence, example.query) for example in chosen}
    return chosen + [example for example in turned if (example.result.sequence, example.query) not in shown][:1]


def _surest(group: Sequence[Result], verdict: str, which: Which) -> list[Example]:
    """The queries of some kind in all sequences, least novel first."""
    found = [Example(result, int(i), verdict) for result in group for i in np.flatnonzero(which(result.evaluation))]
    return sorted(found, key=lambda example: example.novelty)


def degrees(angle_deg: float) -> str:
    """An angle with its sign: `+4°`, `−177°`."""
    return f"{round(angle_deg):+d}°".replace("-", "−")
