"""What a study of robustness says of its models, in sentences made of its numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.alterations import Case
from pipeline.reports.robustness_answers import ONE_SEED, Answers
from pipeline.reports.robustness_numbers import AUC, FAR, KEPT, OFF, Found, Measure, label
from pipeline.reports.table import spread

WHOLE = 0.95
"""Who keeps this share of its AUC has kept it, and who is right at this share of the queries is nearly always right."""
CLEARLY = (
    "± is the standard deviation over the sequences. Clear means on every one of several sequences, by more than the differences"
    f" vary from one to the next and by more than either model's seeds do, which count as {ONE_SEED:g} where there is one."
)


def setup(answers: Answers, dataset: str, grid: str, simulated: bool, parameters: Mapping[str, Any]) -> str:
    """What the sentences rest on: `Asked on simulated campus, 10m cells, 5 test sequences, one seed a model.`"""
    told = [
        f"Asked on {'simulated ' if simulated else ''}{dataset}",
        f"{grid} cells",
        _count(len(answers.sequences), "test sequence"),
    ]
    told += [_count(answers.repeats, "repeat")] if answers.repeats > 1 else []
    told += [f"{'one seed' if answers.seeds == 1 else f'up to {answers.seeds} seeds'} a model"]
    told += [f"budget `{parameters['budget']}`"] if "budget" in parameters else []
    return f"{', '.join(told)}."


def leaders(answers: Answers, kind: Case, measure: Measure) -> str:
    """The first model in one kind of case, and who comes next."""
    ranked = [model for model in answers.ordered(kind, measure) if np.isfinite(answers.found(model, kind, measure).mean)]
    if not ranked:
        return f"{_capital(where(kind))}, no model has an {measure.title}."
    highest = told(answers.found(ranked[0], kind, measure))
    first = f"{_capital(where(kind))}, `{ranked[0]}` has the highest {measure.title} ({highest})"
    if len(ranked) == 1:
        return f"{first}."
    margin = answers.ahead(ranked[0], ranked[1], kind, measure)
    how = "clearly ahead of" if margin.clear else "not clearly ahead of"
    return f"{first}, {how} `{ranked[1]}` ({told(answers.found(ranked[1], kind, measure))})."


def kept(answers: Answers, kind: Case) -> str:
    """Who keeps its AUC, and who loses most of it."""
    shares = {model: answers.found(model, kind, KEPT).mean for model in answers.ordered(kind, KEPT)}
    there = {model: share for model, share in shares.items() if np.isfinite(share)}
    if not there:
        return "No model has an AUC to keep."
    whole = [f"`{model}` ({share:.0%})" for model, share in there.items() if share >= WHOLE]
    last = min(there, key=lambda model: there[model])
    driven, changed = (answers.found(last, case, AUC).mean for case in (Case(), kind))
    least = f"`{last}` keeps least, {there[last]:.0%} ({changed:.3f} instead of {driven:.3f})"
    return (
        f"{_and(whole)} {'keeps' if len(whole) == 1 else 'keep'} {WHOLE:.0%} or more of {'its' if len(whole) == 1 else 'their'}"
        f" own AUC by cells {where(kind)};"
        f" {least}."
        if whole
        else f"No model keeps {WHOLE:.0%} of its AUC by cells {where(kind)}; {least}, and `{next(iter(there))}` most,"
        f" {next(iter(there.values())):.0%}."
    )


def nearly_always(answers: Answers, kind: Case) -> str:
    """By distance, where many methods are at the top."""
    right = [model for model in answers.judged if answers.found(model, kind, FAR).mean >= WHOLE]
    who = f" ({_and([f'`{model}`' for model in right])})" if right else ""
    share = f"{len(right) or 'none'} of {_count(len(answers.models), 'model')} {'are' if len(right) > 1 else 'is'}"
    return f"By distance, {share} right at {WHOLE:.0%} of the seen queries or more, {where(kind)}{who}."


def heading_errors(answers: Answers, kind: Case) -> str:
    """How far the told headings are off, of the models that tell any."""
    found = {model: answers.found(model, kind, OFF) for model in answers.models}
    shown = [f"`{model}` {told(one, OFF)}°" for model, one in found.items() if np.isfinite(one.mean)]
    if not shown:
        return "No model tells a heading."
    return f"Median heading error of the queries placed right by distance, {where(kind)}: {', '.join(shown)}."


def chance(answers: Answers, kind: Case) -> str:
    """How far chance alone moves the AUC: of the repeats, of the seeds, and of the day."""
    found = [answers.found(model, kind, AUC) for model in answers.models]
    shown = {
        "from repeat to repeat": [one.over_repeats for one in found],
        "from seed to seed": [one.over_seeds for one in found],
        "from sequence to sequence": [one.over_sequences for one in found],
    }
    there = {words: np.array(values)[np.isfinite(values)] for words, values in shown.items()}
    told_of = [f"{values.mean():.3f} {words}" for words, values in there.items() if len(values)]
    return f"A model's AUC {where(kind)} deviates by {_and(told_of)}, on average over the models." if told_of else ""


def where(kind: Case) -> str:
    """A kind of case as an adverbial: `turned`, `with 60° removed`."""
    if kind.change == "construction" and kind.shadow:
        return f"with {label(replace(kind, shadow=False))} that {'hides' if kind.level == 1 else 'hide'} what lies behind"
    return f"with {label(kind)}" if kind.change in ("demolition", "construction") else label(kind)


def told(found: Found, measure: Measure = AUC) -> str:
    """A mean and its deviation over the sequences."""
    return spread(list(found.by_sequence), measure.digits)


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _count(number: int, noun: str) -> str:
    return f"1 {noun}" if number == 1 else f"{number} {noun}s"


def _and(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))
