"""What altered queries and sequences of stress show: who leads, who keeps its AUC, and chance.

In: a `Comparison` of models, and the kind of query that a finding is about. Out: `Finding`s, which
templates/words.yaml turns into sentences.
"""

from collections.abc import Mapping
from dataclasses import asdict, replace
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np

from pipeline.evaluation.numbers import average
from pipeline.report.comparison import (
    AUC,
    FAR,
    KEPT,
    OFF,
    RECALL,
    Comparison,
    Kind,
    Measure,
)
from pipeline.report.findings import Finding

# A model that keeps this share of its AUC has kept it, and one that is right at this share of the
# queries is nearly always right.
WHOLE = 0.95
PAPERS_WAYS = 4  # the SCI paper finds that training at so many headings suffices


def leader(comparison: Comparison, kind: Kind, measure: Measure) -> Finding:
    """The best model on one kind of query, and by how much it is ahead of the next three."""
    ranked = _means(comparison, kind, measure)[:4]
    for entry in ranked[1:]:
        margin = comparison.ahead(ranked[0]["model"], entry["model"], kind, measure)
        entry |= {"behind": -margin.value, "clear": margin.clear}
    return Finding("leader", kind=kind, title=measure.title, digits=measure.digits, ranked=ranked)


def kept(comparison: Comparison, kind: Kind) -> Finding:
    """Which models keep their AUC, and which lose most of it."""
    ranked = [
        {"model": entry["model"], "share": entry["mean"], **_aucs(comparison, entry["model"], kind)}
        for entry in _means(comparison, kind, KEPT)
    ]
    whole = [entry for entry in ranked if entry["share"] >= WHOLE]
    return Finding("kept", kind=kind, whole=whole, ranked=ranked, limit=WHOLE)


def nearly_always(comparison: Comparison, kind: Kind) -> Finding:
    """Which models are right, by distance, at nearly all queries."""
    entries = _means(comparison, kind, FAR, is_ranked=False)
    right = [entry["model"] for entry in entries if entry["mean"] >= WHOLE]
    models = len(comparison.models)
    return Finding("nearly_always", kind=kind, right=right, models=models, limit=WHOLE)


def heading_errors(comparison: Comparison, kind: Kind) -> Finding:
    """How large the heading errors are, for the models that give headings."""
    listed = _means(comparison, kind, OFF, is_ranked=False)
    return Finding("heading_errors", kind=kind, listed=listed)


def chance(comparison: Comparison, kind: Kind) -> Finding:
    """How far chance alone moves the AUC of a model: between repeats, seeds and sequences."""
    measurements = [comparison.measurement(model, kind, AUC) for model in comparison.models]
    means = {
        "repeat": average([measurement.over_repeats for measurement in measurements]),
        "seed": average([measurement.over_seeds for measurement in measurements]),
        "sequence": average([measurement.over_sequences for measurement in measurements]),
    }
    deviations = [{"name": name, "mean": mean} for name, mean in means.items() if np.isfinite(mean)]
    return Finding("chance", kind=kind, deviations=deviations)


def shadows(comparison: Comparison) -> list[Finding]:
    """What it changes to hide the space behind the most walls; empty without such queries."""
    without_shadow = {
        replace(kind, shadow=False): kind for kind in comparison.changes if kind.shadow
    }
    both = [kind for kind in without_shadow if kind in comparison.kinds]
    if not both:
        return []
    most_walls = max(both, key=attrgetter("level"))
    bare, shadowed = (
        np.array([comparison.measurement(model, kind, AUC).mean for model in comparison.models])
        for kind in (most_walls, without_shadow[most_walls])
    )
    lower = int((shadowed < bare).sum())
    mean = average(shadowed - bare)
    return [Finding("shadows", kind=most_walls, mean=mean, lower=lower, models=len(bare))]


def n_ways(comparison: Comparison, kind: Kind) -> Finding:
    """Whether training at four headings suffices, as the SCI paper finds.

    It suffices if the model keeps its AUC on turned queries and training at more headings is not
    clearly better. It `keeps` the performance on queries as driven if training at fewer headings
    is not clearly better there.
    """
    ways = comparison.ways()
    listed = [{"n": n, **_aucs(comparison, model, kind)} for n, model in ways.items()]
    four = ways.get(PAPERS_WAYS, "")
    share = comparison.measurement(four, kind, KEPT).mean if four and len(ways) > 1 else np.nan
    if np.isnan(share):
        return Finding("n_ways", kind=kind, listed=listed, n=PAPERS_WAYS, tested=False)
    more = [
        {"n": n, **asdict(comparison.ahead(model, four, kind, AUC))}
        for n, model in ways.items()
        if n > PAPERS_WAYS
    ]
    fewer = [
        {"n": n, **asdict(comparison.ahead(four, model, Kind(), AUC))}
        for n, model in ways.items()
        if n < PAPERS_WAYS
    ]
    more_is_better = any(margin["clear"] and margin["value"] > 0 for margin in more)
    fewer_is_better = any(margin["clear"] and margin["value"] < 0 for margin in fewer)
    return Finding(
        "n_ways",
        kind=kind,
        listed=listed,
        n=PAPERS_WAYS,
        tested=True,
        share=share,
        more=more,
        fewer=fewer,
        suffices=share >= WHOLE and not more_is_better,
        keeps=bool(fewer) and not fewer_is_better,
        decided=max(margin["number"] for margin in (*more, *fewer)) > 1,
    )


def best_on_each(comparison: Comparison, titles: Mapping[str, str]) -> Finding:
    """The best two models on each sequence as driven."""
    best_models = [
        {"name": titles[sequence], "models": _means(comparison, Kind(), RECALL, sequence=i)[:2]}
        for i, sequence in enumerate(comparison.sequences)
    ]
    return Finding("best_on_each", listed=best_models)


def _means(
    comparison: Comparison,
    kind: Kind,
    measure: Measure,
    sequence: int | None = None,
    is_ranked: bool = True,
) -> list[dict[str, Any]]:
    """The models that have a number, with its mean and its deviation over the sequences.

    The largest mean comes first if `is_ranked`. `sequence` is the index of the one that counts;
    None if all count.
    """
    entries = []
    for model in comparison.models:
        measurement = comparison.measurement(model, kind, measure)
        if sequence is not None:
            measurement = measurement.on(sequence)
        deviation = measurement.over_sequences
        if np.isfinite(measurement.mean):
            entries.append({"model": model, "mean": measurement.mean, "deviation": deviation})
    return sorted(entries, key=itemgetter("mean"), reverse=True) if is_ranked else entries


def _aucs(comparison: Comparison, model: str, kind: Kind) -> dict[str, float]:
    """A model's AUC as driven and altered."""
    return {
        "driven": comparison.measurement(model, Kind(), AUC).mean,
        "altered": comparison.measurement(model, kind, AUC).mean,
    }
