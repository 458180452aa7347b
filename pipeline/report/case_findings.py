"""What altered queries and sequences of stress show: who leads, who keeps its AUC, and chance."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from pipeline.report.comparison import (
    AUC,
    FAR,
    KEPT,
    OFF,
    RECALL,
    Comparison,
    Kind,
    Measure,
    Measurement,
)
from pipeline.report.findings import Finding
from pipeline.report.table import average

# who keeps this share of its AUC has kept it, and who is right at this share of the queries is
# nearly always right
WHOLE = 0.95
PAPERS_WAYS = 4  # the SCI paper finds that so many headings suffice


def leader(comparison: Comparison, kind: Kind, measure: Measure) -> Finding:
    """The best model in one kind of case, and by how much it is ahead of the next ones."""
    means = {
        model: comparison.measurement(model, kind, measure)
        for model in comparison.ordered(kind, measure)
    }
    models = [model for model, measurement in means.items() if np.isfinite(measurement.mean)][:4]
    ranked: list[dict[str, Any]] = [{"model": model, **_spread(means[model])} for model in models]
    for entry in ranked[1:]:
        margin = comparison.ahead(models[0], entry["model"], kind, measure)
        entry |= {"behind": -margin.value, "clear": margin.clear}
    return Finding("leader", kind=kind, title=measure.title, digits=measure.digits, ranked=ranked)


def kept(comparison: Comparison, kind: Kind) -> Finding:
    """Which models keep their AUC, and which lose most of it."""
    shares = {
        model: comparison.measurement(model, kind, KEPT).mean
        for model in comparison.ordered(kind, KEPT)
    }
    entries: list[dict[str, Any]] = [
        {"model": model, "share": share} | _aucs(comparison, model, kind)
        for model, share in shares.items()
    ]
    ranked = [entry for entry in entries if np.isfinite(entry["share"])]
    return Finding(
        "kept",
        kind=kind,
        whole=[entry for entry in ranked if entry["share"] >= WHOLE],
        ranked=ranked,
        limit=WHOLE,
    )


def nearly_always(comparison: Comparison, kind: Kind) -> Finding:
    """Which models are right, by distance, at nearly all queries."""
    right = [
        model
        for model in comparison.models
        if comparison.measurement(model, kind, FAR).mean >= WHOLE
    ]
    return Finding(
        "nearly_always", kind=kind, right=right, models=len(comparison.models), limit=WHOLE
    )


def heading_errors(comparison: Comparison, kind: Kind) -> Finding:
    """How large the heading errors are, for the models that give headings."""
    entries = [
        {"model": model, **_spread(comparison.measurement(model, kind, OFF))}
        for model in comparison.models
    ]
    return Finding(
        "heading_errors",
        kind=kind,
        listed=[entry for entry in entries if np.isfinite(entry["mean"])],
    )


def chance(comparison: Comparison, kind: Kind) -> Finding:
    """How far chance alone moves the AUC: between repeats, between seeds, between days."""
    measurements = [comparison.measurement(model, kind, AUC) for model in comparison.models]
    deviations = []
    for name in ("repeat", "seed", "sequence"):
        mean = average([getattr(measurement, f"over_{name}s") for measurement in measurements])
        deviations += [{"name": name, "mean": mean}] if np.isfinite(mean) else []
    return Finding("chance", kind=kind, deviations=deviations)


def shadows(comparison: Comparison) -> list[Finding]:
    """What it changes to hide the space behind the most walls; empty without such cases."""
    shadowed = [
        kind
        for kind in comparison.changes
        if kind.shadow and replace(kind, shadow=False) in comparison.kinds
    ]
    if not shadowed:
        return []
    worst = max(shadowed, key=lambda kind: kind.level)
    bare = replace(worst, shadow=False)
    models = comparison.models
    differences = [
        comparison.measurement(model, worst, AUC).mean
        - comparison.measurement(model, bare, AUC).mean
        for model in models
    ]
    return [
        Finding(
            "shadows",
            kind=bare,
            mean=average(differences),
            lower=int(np.sum(np.array(differences) < 0)),
            models=len(models),
        )
    ]


def n_ways(comparison: Comparison, kind: Kind) -> Finding:
    """Whether training at four headings suffices, as the SCI paper finds.

    It must suffice for arbitrary headings and keep the performance at normal ones.
    """
    ways = comparison.ways()
    entries = [{"n": n} | _aucs(comparison, model, kind) for n, model in ways.items()]
    four = ways.get(PAPERS_WAYS)
    untested = Finding("n_ways", kind=kind, listed=entries, n=PAPERS_WAYS, tested=False)
    if four is None or len(ways) < 2:
        return untested
    share = comparison.measurement(four, kind, KEPT).mean
    if np.isnan(share):
        return untested
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
    more_is_better = any(margin["clear"] and margin["value"] > 0 for margin in more)
    fewer_is_better = any(margin["clear"] and margin["value"] < 0 for margin in fewer)
    verdict = {
        "suffices": share >= WHOLE and not more_is_better,
        "keeps": bool(fewer) and not fewer_is_better,
        "decided": max(margin["number"] for margin in (*more, *fewer)) > 1,
    }
    return Finding(
        "n_ways",
        kind=kind,
        listed=entries,
        n=PAPERS_WAYS,
        tested=True,
        share=share,
        more=more,
        fewer=fewer,
        **verdict,
    )


def best_on_each(comparison: Comparison, titles: Mapping[str, str]) -> Finding:
    """The best two models on each sequence as driven."""
    best_models = []
    for i, sequence in enumerate(comparison.sequences):
        entries = [
            {"model": model, **_spread(comparison.measurement(model, Kind(), RECALL).on(i))}
            for model in comparison.models
        ]
        finite = [entry for entry in entries if np.isfinite(entry["mean"])]
        best = sorted(finite, key=lambda entry: -entry["mean"])[:2]
        best_models.append({"name": titles[sequence], "models": best})
    return Finding("best_on_each", listed=best_models)


def _spread(measurement: Measurement) -> dict[str, Any]:
    return {"mean": measurement.mean, "deviation": measurement.over_sequences}


def _aucs(comparison: Comparison, model: str, kind: Kind) -> dict[str, Any]:
    """A model's AUC as driven and altered."""
    return {
        name: comparison.measurement(model, case, AUC).mean
        for name, case in (("driven", Kind()), ("altered", kind))
    }
