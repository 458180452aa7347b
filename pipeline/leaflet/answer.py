"""The answer of a study in one paragraph made of numbers."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from pipeline.reports.result import Result, by_method
from pipeline.reports.table import mean

if TYPE_CHECKING:
    from pipeline.reports.study import Study

FOUND = "recall_at_1"


def answer(study: "Study") -> str:
    """Which method finds the right place how often over the year, how it ages, and how the others fare."""
    groups = by_method(study.results)
    first, *others = ranked(study)
    best, near = groups[first], study.distance.correct_m
    days = "the one test day" if len(best) == 1 else f"{len(best)} test days"
    named = f"{'simulated ' * study.simulated}**{study.dataset}**, learned on the one day {study.train[:10]}"
    told = (
        f"In {named}, `{first}`{_budget(study, first)} answers with a place within {near:g} m for **{_percent(average(best))}**"
        f" of the queries that training had been near (mean of {days}), and with the very cell of {study.cell_m:g} m for"
        f" {_percent(average(best, 'cells'))}."
    )
    return " ".join(part for part in (told, _aged(best), _others(study, others), _trusted(best)) if part)


def ranked(study: "Study") -> list[str]:
    """The methods, those that find the right place most often first, by distance."""
    groups = by_method(study.results)
    return sorted(groups, key=lambda method: -(average(groups[method]) or 0.0))


def average(group: Sequence[Result], protocol: str = "distance", name: str = FOUND) -> float | None:
    """The mean of a number over the test sequences."""
    return mean([result.number(protocol, name) for result in group])


def _aged(group: Sequence[Result]) -> str:
    if len(group) < 2:
        return ""
    first, last = (f"{_percent(one.number('distance', FOUND))}{_between(one)} {_after(one)}" for one in (group[0], group[-1]))
    return f"It goes from {first} to {last}."


def _others(study: "Study", others: Sequence[str]) -> str:
    if not others:
        return ""
    groups = by_method(study.results)
    (second, *rest), group = others, groups[others[0]]
    span = ""
    if len(group) > 1:
        first, last = (_percent(one.number("distance", FOUND)) for one in (group[0], group[-1]))
        span = f" (from {first} to {last})"
    told = f"Next is `{second}` with {_percent(average(group))}{span}"
    if len(rest) == 1:
        told += f", then `{rest[0]}` with {_percent(average(groups[rest[0]]))}"
    elif rest:
        low, high = (_percent(average(groups[method])) for method in (rest[-1], rest[0]))
        told += f"; the other {len(rest)} lie between {low} and {high}"
    return f"{told}."


def _trusted(group: Sequence[Result]) -> str:
    """What remains once the model rejects at its own threshold."""
    wanted = group[0].wanted_precision
    recall, precision = (average(group, "distance", f"{name}_at_threshold") for name in ("recall", "precision"))
    if wanted is None or recall is None:
        return ""
    kept = "nothing that it answers is left to judge" if precision is None else f"{_percent(precision)} of its answers are right"
    return (
        f"Left to reject what looks new, at the threshold that it chose on held-out parts of the training day for a precision of"
        f" {_percent(wanted, 0)}, it still places {_percent(recall)} of them; then {kept}."
    )


def _budget(study: "Study", method: str) -> str:
    budget = study.models[method].recipe.get("budget")
    return f" (given {_percent(float(budget))} of its full training)" if budget and study.models[method].rounds else ""


def _between(result: Result) -> str:
    bounds = result.interval("distance", FOUND)
    return f" [{100 * bounds[0]:.0f}, {100 * bounds[1]:.0f}]" if bounds else ""


def _after(result: Result) -> str:
    return f"after {result.days} day{'s' * (result.days != 1)}"


def _percent(share: float | None, digits: int = 1) -> str:
    return "–" if share is None else f"{100 * share:.{digits}f}".removesuffix(".0") + " %"
