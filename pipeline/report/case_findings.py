"""What altered queries and sequences of stress show: who leads, who keeps its AUC, and how much is chance."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.report.comparison import AUC, FAR, KEPT, OFF, RECALL, Comparison, Kind, Measure
from pipeline.report.findings import Finding
from pipeline.report.found import Found
from pipeline.report.table import average

WHOLE = 0.95
"""Who keeps this share of its AUC has kept it, and who is right at this share of the queries is nearly always right."""
PAPERS_WAYS = 4
"""The SCI paper finds that so many headings suffice."""


def leader(comparison: Comparison, kind: Kind, measure: Measure) -> Finding:
    """The first model in one kind of case, and by how much it is ahead of the next ones."""
    means = {model: comparison.found(model, kind, measure) for model in comparison.ordered(kind, measure)}
    ranked = [model for model, found in means.items() if np.isfinite(found.mean)]
    listed: list[dict[str, Any]] = [{"model": model, **_spread(means[model])} for model in ranked[:4]]
    for one in listed[1:]:
        margin = comparison.ahead(ranked[0], one["model"], kind, measure)
        one |= {"apart": margin.value, "clear": margin.clear}
    return Finding("leader", {"kind": kind, "title": measure.title, "digits": measure.digits, "ranked": listed})


def kept(comparison: Comparison, kind: Kind) -> Finding:
    """Who keeps its AUC, and who loses most of it."""
    shares = {model: comparison.found(model, kind, KEPT).mean for model in comparison.ordered(kind, KEPT)}
    there = {model: share for model, share in shares.items() if np.isfinite(share)}
    whole = [{"model": model, "share": share} for model, share in there.items() if share >= WHOLE]
    ends: list[dict[str, Any]] = [{"model": model, "share": there[model]} for model in (*list(there)[:1], *list(there)[-1:])]
    for one in ends:
        one |= {name: comparison.found(one["model"], case, AUC).mean for name, case in (("driven", Kind()), ("altered", kind))}
    return Finding("kept", {"kind": kind, "whole": whole, "ends": ends, "limit": WHOLE})


def nearly_always(comparison: Comparison, kind: Kind) -> Finding:
    """By distance, where many models are at the top."""
    right = [model for model in comparison.models if comparison.found(model, kind, FAR).mean >= WHOLE]
    return Finding("nearly_always", {"kind": kind, "right": right, "models": len(comparison.models), "limit": WHOLE})


def heading_errors(comparison: Comparison, kind: Kind) -> Finding:
    """How far headings are off, of the models that give any."""
    found = {model: comparison.found(model, kind, OFF) for model in comparison.models}
    listed = [{"model": model, **_spread(one)} for model, one in found.items() if np.isfinite(one.mean)]
    return Finding("heading_errors", {"kind": kind, "listed": listed})


def chance(comparison: Comparison, kind: Kind) -> Finding:
    """How far chance alone moves the AUC: from repeat to repeat, from seed to seed, from day to day."""
    found = [comparison.found(model, kind, AUC) for model in comparison.models]
    parts = {name: [getattr(one, f"over_{name}s") for one in found] for name in ("repeat", "seed", "sequence")}
    finite = {name: np.array(values)[np.isfinite(values)] for name, values in parts.items()}
    return Finding("chance", {"kind": kind, "deviations": {name: float(one.mean()) for name, one in finite.items() if len(one)}})


def shadows(comparison: Comparison) -> list[Finding]:
    """What it changes to hide what lies behind the most walls; nothing where no case does."""
    hidden = [one for one in comparison.changes if one.shadow and replace(one, shadow=False) in comparison.kinds]
    if not hidden:
        return []
    worst = max(hidden, key=lambda one: one.level)
    bare = replace(worst, shadow=False)
    apart = [comparison.found(model, worst, AUC).mean - comparison.found(model, bare, AUC).mean for model in comparison.models]
    lower = int((np.array(apart) < 0).sum())
    return [Finding("shadows", {"kind": bare, "mean": average(apart), "lower": lower, "models": len(apart)})]


def n_ways(comparison: Comparison, kind: Kind) -> Finding:
    """Whether training at four headings suffices for arbitrary ones and keeps normal performance, as the SCI paper finds."""
    ways = comparison.ways()
    listed = [
        {"n": n, **{name: comparison.found(model, case, AUC).mean for name, case in (("driven", Kind()), ("altered", kind))}}
        for n, model in ways.items()
    ]
    four = ways.get(PAPERS_WAYS)
    if four is None or len(ways) < 2 or np.isnan(share := comparison.found(four, kind, KEPT).mean):
        return Finding("n_ways", {"kind": kind, "listed": listed, "n": PAPERS_WAYS, "tested": False})
    more = [{"n": n, **vars(comparison.ahead(model, four, kind, AUC))} for n, model in ways.items() if n > PAPERS_WAYS]
    fewer = [{"n": n, **vars(comparison.ahead(four, model, Kind(), AUC))} for n, model in ways.items() if n < PAPERS_WAYS]
    suffices = share >= WHOLE and not any(one["clear"] and one["value"] > 0 for one in more)
    keeps = bool(fewer) and not any(one["clear"] and one["value"] < 0 for one in fewer)
    decided = max(one["number"] for one in (*more, *fewer)) > 1
    verdict = {"suffices": suffices, "keeps": keeps, "decided": decided, "share": share, "more": more, "fewer": fewer}
    return Finding("n_ways", {"kind": kind, "listed": listed, "n": PAPERS_WAYS, "tested": True, **verdict})


def best_on_each(comparison: Comparison, named: Mapping[str, str]) -> Finding:
    """The best two models on each sequence as driven."""
    listed = []
    for i, sequence in enumerate(comparison.sequences):
        found = {model: comparison.found(model, Kind(), RECALL).on(i) for model in comparison.models}
        first = sorted((one for one in found if np.isfinite(found[one].mean)), key=lambda one: -found[one].mean)[:2]
        listed.append({"name": named[sequence], "models": [{"model": one, **_spread(found[one])} for one in first]})
    return Finding("best_on_each", {"listed": listed})


def _spread(found: Found) -> dict[str, float]:
    return {"mean": found.mean, "deviation": found.over_sequences}
