"""Records what a localiser answers after each step of learning (METHODS 11.4).

The localisers of steps.py and the queries of days that are never learned go in; a `Lifelong`
artifact comes out, which the stage `lifelong` writes.
"""

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from pipeline.core.schemas import Lifelong
from pipeline.lifelong.steps import Step
from pipeline.matching.ranking import Rows

K = 25
"""So many places are ranked for each query."""


def record(
    steps: Iterator[Step],
    queries: Mapping[str, Rows],
    report_line: Callable[[str], None],
    order: str,
    strategy: str,
    correct_m: float,
) -> tuple[Lifelong, list[float]]:
    """Localise all queries, by day, after every step of learning.

    `report_line` is called with a line after each step. `order`, `strategy` and `correct_m` are
    written into the artifact as they are. Returns the artifact, and the CPU seconds that each step
    took.
    """
    query_xy_m = np.concatenate([views.world_T_anchor[:, :2, 3] for views in queries.values()])
    query_counts = [len(views.stamps_ns) for views in queries.values()]
    answers = []
    errors_m = []
    done_steps = list[Step]()
    for step in steps:
        rankings = [step.localizer(views, K) for views in queries.values()]
        answer = np.concatenate([ranking.places[:, 0] for ranking in rankings])
        answer_xy_m = np.concatenate([ranking.xy_m[:, 0] for ranking in rankings])
        true_place = step.places.at(query_xy_m)
        seen = true_place >= 0
        right = np.mean((answer == true_place)[seen])
        report_line(f"{step.name}: {right:.3f} right of {seen.sum()} seen")
        answers.append(answer)
        errors_m.append(np.linalg.norm(answer_xy_m - query_xy_m, axis=1))
        done_steps.append(step)
    last_places = done_steps[-1].places
    true_place = last_places.at(query_xy_m)
    is_known = np.array([step.places.at(query_xy_m) >= 0 for step in done_steps])
    lifelong = Lifelong(
        right=(np.array(answers) == true_place) & (true_place >= 0),
        error_m=np.array(errors_m),
        known_from=np.where(is_known.any(axis=0), is_known.argmax(axis=0), -1),
        day=np.repeat(np.arange(len(queries)), query_counts),
        xy_m=query_xy_m,
        place_xy_m=last_places.grid.centre(last_places.cells),
        newest_ns=done_steps[-1].newest_ns,
        order=order,
        strategy=strategy,
        steps=tuple(step.name for step in done_steps),
        asked=tuple(queries),
        learned_ns=tuple(int(step.newest_ns.max()) for step in done_steps),
        asked_ns=tuple(int(views.stamps_ns[0]) for views in queries.values()),
        correct_m=correct_m,
        places=tuple(len(step.places.cells) for step in done_steps),
        bytes=tuple(step.bytes for step in done_steps),
        counts=[dict(step.counts) for step in done_steps],
    )
    return lifelong, [step.cpu_s for step in done_steps]


def line(lifelong: Lifelong) -> str:
    """Sum the results up in a line: the share of right answers after the first and last step.

    It is of the queries whose place was surveyed in some step.
    """
    knowable = lifelong.known_from >= 0
    first = float(lifelong.right[0, knowable].mean())
    last = float(lifelong.right[-1, knowable].mean())
    return (
        f"{len(lifelong.steps)} steps to {lifelong.places[-1]} places: of {knowable.sum()} queries "
        f"that can be known {first:.3f} right at first, {last:.3f} at last"
    )
