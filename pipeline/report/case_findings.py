"""What altered queries and sequences of stress show: who leads, who keeps its AUC, and how much is
chance."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from pipeline.report.comparison import AUC, FAR, KEPT, OFF, RECALL, Comparison, Kind, Measure
from pipeline.report.findings import Finding
from pipeline.report.found import Found
from pipeline.report.table import average

# who keeps this share of its AUC has kept it, and who is right at this share of the queries is
# nearly always right
WHOLE = 0.95
PAPERS_WAYS = 4  # the SCI paper finds that so many headings suffice


def leader(comparison: Comparison, kind: Kind, measure: Measure) -> Finding:
    """The first model in one kind of case, and by how much it is ahead of the next ones."""
    means = {
        model: comparison.found(model, kind, measure) for model in comparison.ordered(kind, measure)
    }
    models = [model for model, found in means.items() if np.isfinite(found.mean)][:4]
    ranked: list[dict[str, Any]] = [{"model": model, **_spread(means[model])} for model in models]
    for one in ranked[1:]:
        margin = comparison.ahead(models[0], one["model"], kind, measure)
        one |= {"behind": -margin.value, "clear": margin.clear}
    return Finding("leader", kind=kind, title=measure.title, digits=measure.digits, ranked=ranked)


def kept(comparison: Comparison, kind: Kind) -> Finding:
    """Who keeps its AUC, and who loses most of it."""
    shares = {
        model: comparison.found(model, kind, KEPT).mean for model in comparison.ordered(kind, KEPT)
    }
    every: list[dict[str, Any]] = [
        {"model": model, "share": share} | _both(comparison, model, kind)
        for model, share in shares.items()
    ]
    ranked = [one for one in every if np.isfinite(one["share"])]
    return Finding(
        "kept",
        kind=kind,
        whole=[one for one in ranked if one["share"] >= WHOLE],
        ranked=ranked,
        limit=WHOLE,
    )


def nearly_always(comparison: Comparison, kind: Kind) -> Finding:
    """By distance, where many models are at the top."""
    right = [
        model for model in comparison.models if comparison.found(model, kind, FAR).mean >= WHOLE
    ]
    return Finding(
        "nearly_always", kind=kind, right=right, models=len(comparison.models), limit=WHOLE
    )


def heading_errors(comparison: Comparison, kind: Kind) -> Finding:
    """How far headings are off, of the models that give any."""
    listed = [
        {"model": model, **_spread(comparison.found(model, kind, OFF))}
        for model in comparison.models
    ]
    return Finding(
        "heading_errors", kind=kind, listed=[one for one in listed if np.isfinite(one["mean"])]
    )


def chance(comparison: Comparison, kind: Kind) -> Finding:
    """How far chance alone moves the AUC: from repeat to repeat, from seed to seed, from day to
    day."""
    found = [comparison.found(model, kind, AUC) for model in comparison.models]
    deviations = []
    for name in ("repeat", "seed", "sequence"):
        mean = average([getattr(one, f"over_{name}s") for one in found])
        deviations += [{"name": name, "mean": mean}] if np.isfinite(mean) else []
    return Finding("chance", kind=kind, deviations=deviations)


def shadows(comparison: Comparison) -> list[Finding]:
    """What it changes to hide what lies behind the most walls; nothing where no case does."""
    hidden = [
        one
        for one in comparison.changes
        if one.shadow and replace(one, shadow=False) in comparison.kinds
    ]
    if not hidden:
        return []
    worst = max(hidden, key=lambda one: one.level)
    bare = replace(worst, shadow=False)
    models = comparison.models
    apart = [
        comparison.found(model, worst, AUC).mean - comparison.found(model, bare, AUC).mean
        for model in models
    ]
    return [
        Finding(
            "shadows",
            kind=bare,
            mean=average(apart),
            lower=int(np.sum(np.array(apart) < 0)),
            models=len(models),
        )
    ]


def n_ways(comparison: Comparison, kind: Kind) -> Finding:
    """Whether training at four headings suffices for arbitrary ones and keeps normal performance,
    as the SCI paper finds."""
    ways = comparison.ways()
    listed = [{"n": n} | _both(comparison, model, kind) for n, model in ways.items()]
    four = ways.get(PAPERS_WAYS)
    if four is None or len(ways) < 2 or np.isnan(share := comparison.found(four, kind, KEPT).mean):
        return Finding("n_ways", kind=kind, listed=listed, n=PAPERS_WAYS, tested=False)
    more = [
        {"n": n} | asdict(comparison.ahead(model, four, kind, AUC))
        for n, model in ways.items()
        if n > PAPERS_WAYS
    ]
    fewer = [
        {"n": n} | asdict(comparison.ahead(four, model, Kind(), AUC))
        for n, model in ways.items()
        if n < PAPERS_WAYS
    ]
    verdict = {
        "suffices": share >= WHOLE and not any(one["clear"] and one["value"] > 0 for one in more),
        "keeps": bool(fewer) and not any(one["clear"] and one["value"] < 0 for one in fewer),
        "decided": max(one["number"] for one in (*more, *fewer)) > 1,
    }
    return Finding(
        "n_ways",
        kind=kind,
        listed=listed,
        n=PAPERS_WAYS,
        tested=True,
        share=share,
        more=more,
        fewer=fewer,
        **verdict,
    )


def best_on_each(comparison: Comparison, named: Mapping[str, str]) -> Finding:
    """The best two models on each sequence as driven."""
    listed = []
    for i, sequence in enumerate(comparison.sequences):
        found = [
            {"model": model, **_spread(comparison.found(model, Kind(), RECALL).on(i))}
            for model in comparison.models
        ]
        there = [one for one in found if np.isfinite(one["mean"])]
        listed.append(
            {"name": named[sequence], "models": sorted(there, key=lambda one: -one["mean"])[:2]}
        )
    return Finding("best_on_each", listed=listed)


def _spread(found: Found) -> dict[str, Any]:
    return {"mean": found.mean, "deviation": found.over_sequences}


def _both(comparison: Comparison, model: str, kind: Kind) -> dict[str, Any]:
    """The AUC as driven and altered."""
    return {
        name: comparison.found(model, one, AUC).mean
        for name, one in (("driven", Kind()), ("altered", kind))
    }
