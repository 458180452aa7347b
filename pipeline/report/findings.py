"""What the numbers of a study show, as data: who is compared, by how much, and whether it is clear.

In: a study, rows of its table of results, or a comparison of models on perturbed queries. Out:
`Finding`s, which templates/words.yaml turns into sentences. Every value is a row of the table of
results, or a mean of such rows over the test sequences.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np
import pandas as pd

from pipeline.evaluation.bootstrap import Estimate
from pipeline.evaluation.caveats import BLIND, CAVEATS, DEGENERATE
from pipeline.evaluation.numbers import MEASURES, average
from pipeline.evaluation.paired import COMPARED, LEVEL
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.rows import NEAR_CHANGE, indexed, pick
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS, PERCENTILE, SHOWN, TO_COME
from pipeline.report.comparison import (
    AUC,
    AUC_SHARE,
    HEADING_ERROR,
    RECALL,
    RECALL_BY_DISTANCE,
    UNPERTURBED_KIND,
    Comparison,
    Kind,
    Measure,
)
from pipeline.report.result import TITLES, Result, by_model, day, is_posed, mean
from pipeline.report.study import StudyResults, against

SLIGHT = 0.0005  # a smaller loss would be printed as 0
BOTH = "both protocols"
# A model that keeps this fraction of its AUC counts as keeping it, and a model that answers this
# fraction of the queries right as nearly always right.
WHOLE = 0.95
# The N of the N-way training (N rotated copies of each training scan) that suffices, as the SCI
# paper finds (Kim, Park and Kim, RA-L 2019).
PAPERS_WAYS = 4


@dataclass(frozen=True, init=False)
class Finding:
    """One thing that the numbers show."""

    kind: str  # the key of its sentence in templates/words.yaml
    # what fills the sentence: names of models, differences, intervals, whether they are clear
    values: Mapping[str, Any]

    def __init__(self, kind: str, /, **values: Any) -> None:
        vars(self).update(kind=kind, values=values)


def answer(study: StudyResults) -> Finding:
    """The study in a paragraph: how often the best model is right, how it ages, how others fare.

    A model with poses is compared with others that have poses, if there are any.
    """
    groups = by_model(study.results)
    best, *all_others = (_summary(model, groups[model]) for model in study.ranked)
    similar = [other for other in all_others if other["posed"] == best["posed"]]
    others = similar or all_others
    record = study.models[study.ranked[0]]
    was_cut = record.rounds and "budget" in record.recipe
    return Finding(
        "answer",
        where=study.where,
        train=day(study.training),
        of_map=bool(study.settings.map),
        tests=len(groups[study.ranked[0]]),
        budget=float(record.recipe["budget"]) if was_cut else None,
        near_m=study.distance.correct_m,
        cell_m=study.cell_m,
        first=best,
        others=others,
    )


def _summary(model: str, group: Sequence[Result]) -> dict[str, Any]:
    """One model over the year: mean recall, recall on the first and last day, at its threshold."""
    ends = (group[0], group[-1])
    return {
        "model": model,
        "posed": group[0].posed,
        "mean": {by: mean(group, by, "recall_at_1") for by in PROTOCOLS},
        "ends": [(result.number("distance", "recall_at_1"), result.days) for result in ends],
        "at": {
            measure: mean(group, "distance", f"{measure}_at_threshold")
            for measure in ("precision", "recall")
        },
        "target_precision": group[0].target_precision,
        "validation_precision": group[0].validation_precision,
    }


def caveats(study: StudyResults) -> list[Finding]:
    """Why a model's numbers say little or nothing, and on which test sequences.

    There is one finding per model, or two where the protocols differ. `blind` is the recall that
    a single answer to every query would reach.
    """
    findings = []
    for model, group in by_model(study.results).items():
        caveats_by = {protocol: _caveats(group, protocol) for protocol in PROTOCOLS}
        if caveats_by["cells"] == caveats_by["distance"]:
            caveats_by = {BOTH: caveats_by["cells"]}
        for protocol, listed in caveats_by.items():
            if not listed:
                continue
            judged_by = PROTOCOLS if protocol == BOTH else (protocol,)
            blind = max(result.number(by, BLIND) for result in group for by in judged_by)
            findings.append(
                Finding(
                    "caveats",
                    model=model,
                    protocol=protocol,
                    listed=listed,
                    target_precision=group[0].target_precision,
                    tests=len(group),
                    blind=blind,
                )
            )
    return findings


def _caveats(group: Sequence[Result], protocol: str) -> list[dict[str, Any]]:
    """Each caveat about a model by one protocol: its sequences, and its largest value there.

    See `pipeline.evaluation.caveats` for their names.
    """
    listed = []
    for name in (DEGENERATE, *CAVEATS):
        affected = [result for result in group if (protocol, name) in result.numbers]
        if affected:
            largest = max((result.number(protocol, name) for result in affected), key=abs)
            sequences = [result.sequence for result in affected]
            listed.append({"name": name, "on": sequences, "value": largest})
    return listed


def paired(rows: pd.DataFrame, protocol: str) -> list[Finding]:
    """One finding per model: where it is clearly better or worse than the reference.

    Both are compared on the same queries of each sequence.
    """
    findings = []
    for (model, reference), group in against(rows, protocol).groupby(["model", "of"], sort=False):
        wide = group.pivot(index="sequence", columns="number", values="value")
        verdicts = []
        for number in COMPARED:
            change = wide[f"{number}_difference"]
            clear = change[wide[f"{number}_difference_p"] < LEVEL]
            verdicts.append(
                {
                    "title": TITLES[number],
                    "mean": change.mean(),
                    "better": [*map(day, clear.index[clear > 0])],
                    "worse": [*map(day, clear.index[clear < 0])],
                    "tests": len(change),
                }
            )
        findings.append(
            Finding(
                "paired",
                model=model,
                reference=reference,
                unlike=is_posed(model) and not is_posed(reference),
                protocol=protocol,
                verdicts=verdicts,
            )
        )
    return findings


def novelties(study: StudyResults, protocol: str) -> list[Finding]:
    """One finding per model: which kind of novelty rejects best, and which misses its target least.

    The kind in use is the first one. By how much it is behind is counted over the sequences.
    """
    findings = []
    for model, group in by_model(study.results).items():
        kinds = group[0].evaluation.kinds
        # (sequence, kind, measure, 3): value, low, high of each of MEASURES
        rejection = np.stack([result.evaluation.protocol(protocol).rejection for result in group])
        rejection = rejection[np.isfinite(rejection[:, :, 0, 0]).all(axis=1)]
        if not len(rejection):
            continue
        # (sequence, kind) each
        auroc, low, high = np.moveaxis(rejection[:, :, MEASURES.index("auroc")], 2, 0)
        auc = rejection[:, :, MEASURES.index("auc_exact_top1"), 0]
        ranked = [
            {"kind": kind, "auroc": auroc[:, i].mean(), "auc": auc[:, i].mean()}
            for i, kind in enumerate(kinds)
        ]
        ranked.sort(key=itemgetter("auroc"), reverse=True)
        best = kinds.index(ranked[0]["kind"])
        findings.append(
            Finding(
                "novelties",
                model=model,
                protocol=protocol,
                used=kinds[0],
                ranked=ranked,
                largest=max(ranked, key=itemgetter("auc")),
                ahead=int((auroc[:, best] > auroc[:, 0]).sum()),
                clearly=int((low[:, best] > high[:, 0]).sum()),
                tests=len(rejection),
                nearest=_nearest_to_target(group) if protocol == "cells" else {},
            )
        )
    return findings


def _nearest_to_target(group: Sequence[Result]) -> dict[str, Any]:
    """The kind of novelty whose threshold came nearest to the target precision, by cells.

    Kinds are left out whose threshold was chosen for less, since no threshold reached the target
    precision on validation blocks. Empty if no kind remains.
    """
    target = group[0].target_precision
    # (sequence, kind) each
    rejection = np.stack([result.evaluation.cells.rejection for result in group])
    precision = rejection[:, :, MEASURES.index("precision_at_threshold"), 0]
    recall = rejection[:, :, MEASURES.index("recall_at_threshold"), 0]
    fell_short = np.array(group[0].evaluation.validation_precision) < target
    is_chosen = np.isfinite(precision).all(axis=0) & ~fell_short
    if not is_chosen.any():
        return {}
    miss = np.where(is_chosen, np.abs(precision - target).mean(axis=0), np.inf)
    best = int(miss.argmin())
    return {
        "kind": group[0].evaluation.kinds[best],
        "miss": miss[best],
        "target_precision": target,
        "lowest": precision[:, best].min(),
        "recall": recall[:, best].mean(),
    }


def ageing(rows: pd.DataFrame, title: str, protocol: str, number: str, last_day: float) -> Finding:
    """The models of which one number clearly falls with the days, and when to train them again.

    Of the other models it names that which may lose most. `rows` are of unperturbed queries.
    """
    slopes = _lines(rows, protocol, f"{number}_per_{PER_DAYS}_days")
    retrain_after = _lines(rows, protocol, f"{number}_retrain_after_days")
    lowest = {model: low for model, (_, low, high) in slopes.items() if high >= 0}
    worst = min(lowest, key=lowest.__getitem__, default="")
    return Finding(
        "ageing",
        title=title,
        falls=[
            {"model": model, "slope": slope, "days": retrain_after[model]}
            for model, slope in slopes.items()
            if model in retrain_after
        ],
        worst={"model": worst, "slope": lowest[worst]} if worst and lowest[worst] < -SLIGHT else {},
        known=len(slopes),
        others=len(lowest),
        last=last_day,
        per=PER_DAYS,
    )


def newer(rows: pd.DataFrame) -> Finding:
    """The models to which places that they know look newer and newer with the days."""
    slopes = _lines(rows, "distance", f"{PERCENTILE}_per_{PER_DAYS}_days")
    clear = []
    for model, slope in slopes.items():
        _, low, _ = slope
        if low > 0:
            clear.append({"model": model, "slope": slope})
    all_clear = len(clear) == len(slopes)
    return Finding("newer", known=len(slopes), sure=clear, all=all_clear, per=PER_DAYS)


def confounders(study: StudyResults) -> Finding:
    """The differences between the sequences besides their age.

    They are the share of unseen queries, and the share of seen queries with another heading than
    training.
    """
    results = by_model(study.results)[study.families[0]]
    days = [result.days for result in results]
    unseen = [r.number("cells", "unseen") / max(r.number("cells", "queries"), 1) for r in results]
    turned = [result.number("cells", "turned_share") for result in results]
    return Finding(
        "confounders",
        tests=len(days),
        unseen=_change(days, unseen),
        turned=_change(days, turned),
    )


def _change(days: Sequence[float], shares: Sequence[float]) -> dict[str, float]:
    """The first and last of some shares, and their correlation with the days, NaN if undefined."""
    varies = min(np.ptp(shares), np.ptp(days)) > 1e-6
    is_defined = len(days) > 2 and np.isfinite(shares).all() and varies
    correlation = float(np.corrcoef(days, shares)[0, 1]) if is_defined else np.nan
    return {"first": shares[0], "last": shares[-1], "correlation": correlation}


def slopes_counted(
    rows: pd.DataFrame, numbers: Sequence[tuple[str, str]], level: float = 0.95
) -> Finding:
    """How many slopes of some numbers clearly mean ageing, and how many are expected by chance.

    It adds the slope of the oracle, which answers each query with its nearest training pose.
    """
    worse = [
        low > 0 if name == PERCENTILE else high < 0
        for protocol, name in numbers
        for _, low, high in _lines(rows, protocol, f"{name}_per_{PER_DAYS}_days").values()
    ]
    oracle = pick(rows, method=ORACLE, number=f"recall_at_1_same_heading_per_{PER_DAYS}_days")
    return Finding(
        "slopes_counted",
        worse=sum(worse),
        number=len(worse),
        by_chance=len(worse) * (1 - level) / 2,
        oracle=indexed(oracle, "method").get(ORACLE, ()),
        per=PER_DAYS,
    )


def near_changes(
    rows: pd.DataFrame, number: str, names: Mapping[float, str], least_queries: int
) -> Finding:
    """The models that clearly do worse near a real change than where one is to come, by cells.

    They are compared in the nearest band of distance that has at least `least_queries` seen queries
    of both. `names` maps the farthest distance of a band in metres to its name.
    """
    values = indexed(pick(rows, ask=NEAR_CHANGE, protocol="cells"), "number", "at", "of", "method")
    near = pick(rows, ask=NEAR_CHANGE, of=SHOWN, protocol="cells", number=number)
    models = near["method"].unique()
    for edge_m in sorted(filter(np.isfinite, names)):
        seen = [values.get(("seen", edge_m, when, models[0]), (0,))[0] for when in (SHOWN, TO_COME)]
        if min(seen) < least_queries:
            continue
        verdicts = []
        for model in models:
            shown, _, shown_high = values[number, edge_m, SHOWN, model]
            before, before_low, _ = values[number, edge_m, TO_COME, model]
            is_lower = shown_high < before_low
            verdicts.append({"model": model, "shown": shown, "before": before, "lower": is_lower})
        return Finding(
            "near_changes",
            title=TITLES[number],
            band=names[edge_m],
            counts=[*map(int, seen)],
            verdicts=verdicts,
        )
    return Finding("near_changes", title=TITLES[number], band="")


def changes_counted(rows: pd.DataFrame, kinds: Sequence[str], within_m: float) -> Finding:
    """The numbers of real changes by kind, and of seen queries at most `within_m` from one."""
    near = pick(rows, number="seen_near_a_change").set_index("sequence")["value"]
    busiest = {"sequence": day(near.idxmax()), "seen": int(near.max())} if near.any() else {}
    return Finding(
        "changes_counted",
        counts={kind: int(pick(rows, number=f"{kind}_changes")["value"].sum()) for kind in kinds},
        seen=int(near.sum()),
        within_m=within_m,
        most=busiest,
    )


def trend(values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]) -> Finding:
    """The models whose numbers rise, and those whose fall, from the smallest cells to the largest.

    `values` maps a model to its values (sequence,) at each size. A number rises if it does so on
    every sequence.
    """
    changes = {
        model: np.asarray(by_size[-1]) - np.asarray(by_size[0])
        for model, by_size in values.items()
        if len(by_size[0]) == len(by_size[-1])
    }
    ways = []
    for way, sign in (("rises", 1), ("falls", -1)):
        models = [
            {"model": model, "mean": float(change.mean())}
            for model, change in changes.items()
            if len(change) and (sign * change > 0).all()
        ]
        ways.append({"way": way, "models": models})
    ends = {"first_m": sizes_m[0], "last_m": sizes_m[-1]}
    return Finding("trend", title=title, models=len(changes), ways=ways, **ends)


def best_at_each_size(
    values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]
) -> Finding:
    """The best model at each cell size; `values` as in `trend`."""
    best_models = []
    for i, size_m in enumerate(sizes_m):
        means = {m: float(np.mean(by_size[i])) for m, by_size in values.items() if len(by_size[i])}
        if means:
            model = max(means, key=means.__getitem__)
            best_models.append({"model": model, "size_m": size_m, "mean": means[model]})
    return Finding("best_at_each_size", title=title, listed=best_models)


def scope(study: StudyResults, sequences: int, seeds: int, repeats: int = 1) -> Finding:
    """The data behind a section: where, which cells, how many sequences, seeds and repeats."""
    return Finding(
        "scope",
        where=study.where,
        grid=study.grid,
        sequences=sequences,
        seeds=seeds,
        repeats=repeats,
        budget=study.settings.budget,
    )


def _lines(rows: pd.DataFrame, protocol: str, number: str) -> dict[str, Estimate]:
    """Map each model to one number of the whole year and its interval.

    The oracle, and models without an interval, are left out.
    """
    lines = pick(rows, protocol=protocol, number=number)
    return indexed(lines[(lines["method"] != ORACLE) & np.isfinite(lines["low"])], "method")


def leader(comparison: Comparison, kind: Kind, measure: Measure) -> Finding:
    """The best model on one kind of query, and by how much it is ahead of the next three."""
    ranked = _means(comparison, kind, measure)[:4]
    for entry in ranked[1:]:
        margin = comparison.ahead(ranked[0]["model"], entry["model"], kind, measure)
        entry |= {"behind": -margin.value, "clear": margin.clear}
    return Finding("leader", kind=kind, title=measure.title, digits=measure.digits, ranked=ranked)


def kept(comparison: Comparison, kind: Kind) -> Finding:
    """The models that keep their AUC, and the model that loses most of it."""
    ranked = [
        {"model": entry["model"], "share": entry["mean"], **_aucs(comparison, entry["model"], kind)}
        for entry in _means(comparison, kind, AUC_SHARE)
    ]
    whole = [entry for entry in ranked if entry["share"] >= WHOLE]
    return Finding("kept", kind=kind, whole=whole, ranked=ranked, limit=WHOLE)


def nearly_always(comparison: Comparison, kind: Kind) -> Finding:
    """The models that answer nearly all queries right, by distance."""
    entries = _means(comparison, kind, RECALL_BY_DISTANCE, is_ranked=False)
    right = [entry["model"] for entry in entries if entry["mean"] >= WHOLE]
    models = len(comparison.models)
    return Finding("nearly_always", kind=kind, right=right, models=models, limit=WHOLE)


def heading_errors(comparison: Comparison, kind: Kind) -> Finding:
    """The heading errors of the models that give headings."""
    listed = _means(comparison, kind, HEADING_ERROR, is_ranked=False)
    return Finding("heading_errors", kind=kind, listed=listed)


def variation(comparison: Comparison, kind: Kind) -> Finding:
    """How much the AUC of a model varies at random: between repeats, seeds and sequences."""
    measurements = [comparison.measurement(model, kind, AUC) for model in comparison.models]
    means = {
        "repeat": average([measurement.over_repeats for measurement in measurements]),
        "seed": average([measurement.over_seeds for measurement in measurements]),
        "sequence": average([measurement.over_sequences for measurement in measurements]),
    }
    deviations = [{"name": name, "mean": mean} for name, mean in means.items() if np.isfinite(mean)]
    return Finding("variation", kind=kind, deviations=deviations)


def shadows(comparison: Comparison) -> list[Finding]:
    """The effect of hiding the space behind the most walls; empty without such queries."""
    shadowless = {replace(kind, shadow=False): kind for kind in comparison.changes if kind.shadow}
    both = [kind for kind in shadowless if kind in comparison.kinds]
    if not both:
        return []
    most_walls = max(both, key=attrgetter("level"))
    bare, shadowed = (
        np.array([comparison.measurement(model, kind, AUC).mean for model in comparison.models])
        for kind in (most_walls, shadowless[most_walls])
    )
    lower = int((shadowed < bare).sum())
    mean = average(shadowed - bare)
    return [Finding("shadows", kind=most_walls, mean=mean, lower=lower, models=len(bare))]


def n_ways(comparison: Comparison, kind: Kind) -> Finding:
    """Whether training at four headings suffices, as the SCI paper finds.

    It suffices if the model keeps its AUC on turned queries and training at more headings is not
    clearly better. It `keeps` the performance on unperturbed queries if training at fewer headings
    is not clearly better there.
    """
    ways = comparison.ways()
    listed = [{"n": n, **_aucs(comparison, model, kind)} for n, model in ways.items()]
    four = ways.get(PAPERS_WAYS, "")
    share = comparison.measurement(four, kind, AUC_SHARE).mean if four and len(ways) > 1 else np.nan
    if np.isnan(share):
        return Finding("n_ways", kind=kind, listed=listed, n=PAPERS_WAYS, tested=False)
    more = [
        {"n": n, **asdict(comparison.ahead(model, four, kind, AUC))}
        for n, model in ways.items()
        if n > PAPERS_WAYS
    ]
    fewer = [
        {"n": n, **asdict(comparison.ahead(four, model, UNPERTURBED_KIND, AUC))}
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
    """The best two models on each unperturbed sequence."""
    best_models = [
        {
            "name": titles[sequence],
            "models": _means(comparison, UNPERTURBED_KIND, RECALL, sequence=i)[:2],
        }
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
    """The models that have a measure, with its mean and standard deviation over the sequences.

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
    """A model's AUC unperturbed and perturbed."""
    return {
        "unperturbed": comparison.measurement(model, UNPERTURBED_KIND, AUC).mean,
        "perturbed": comparison.measurement(model, kind, AUC).mean,
    }
