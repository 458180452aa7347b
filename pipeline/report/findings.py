"""What the numbers show, as data: who is compared, by how much, and whether that is clear.

Templates make the sentences.

Every value is a row of the table of results, or a mean of such rows over the test sequences; names
of models come from there too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.evaluation.doubts import BLIND, DOUBTS, VOID
from pipeline.evaluation.paired import COMPARED, LEVEL
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS, SHOWN, TO_COME
from pipeline.report.result import TITLES, Result, by_model, day, mean
from pipeline.report.selection import Values, indexed, pick
from pipeline.report.study import Study, against

SLIGHT = 0.0005  # a loss that is smaller would be printed as 0
BOTH = "both protocols"


@dataclass(frozen=True, init=False)
class Finding:
    """A verdict on the numbers, as data."""

    kind: str  # its key in templates/words.yaml, which holds the sentence
    # what the sentence is filled with: names of models, differences, intervals, whether clear
    values: Mapping[str, Any]

    def __init__(self, kind: str, /, **values: Any) -> None:
        vars(self).update(kind=kind, values=values)


def answer(study: Study) -> Finding:
    """The study in a paragraph: how often the best model is right, how it ages, how others fare."""
    groups = by_model(study.results)
    record = study.models[study.ranked[0]]
    first, *others = (
        {
            "model": model,
            "mean": {by: mean(groups[model], by, "recall_at_1") for by in PROTOCOLS},
            "ends": [
                (result.number("distance", "recall_at_1"), result.days)
                for result in (groups[model][0], groups[model][-1])
            ],
            "at": {
                measure: mean(groups[model], "distance", f"{measure}_at_threshold")
                for measure in ("precision", "recall")
            },
            "wanted": groups[model][0].wanted_precision,
            "kept": groups[model][0].kept,
        }
        for model in study.ranked
    )
    return Finding(
        "answer",
        where=study.where,
        train=day(study.train),
        tests=len(groups[study.ranked[0]]),
        budget=float(record.recipe["budget"])
        if record.rounds and "budget" in record.recipe
        else None,
        near_m=study.distance.correct_m,
        cell_m=study.cell_m,
        first=first,
        others=others,
    )


def doubts(study: Study) -> list[Finding]:
    """Why a model's numbers say little or nothing, and on which test sequences.

    A finding a model, or two where the protocols differ.
    """
    findings = []
    for model, group in by_model(study.results).items():
        doubts_by = {protocol: _doubts(group, protocol) for protocol in PROTOCOLS}
        if doubts_by["cells"] == doubts_by["distance"]:
            doubts_by = {BOTH: doubts_by["cells"]}
        findings += [
            Finding(
                "doubts",
                model=model,
                protocol=protocol,
                listed=listed,
                wanted=group[0].wanted_precision,
                tests=len(group),
                blind=max(
                    result.number(by, BLIND)
                    for result in group
                    for by in PROTOCOLS
                    if protocol in (BOTH, by)
                ),
            )
            for protocol, listed in doubts_by.items()
            if listed
        ]
    return findings


def _doubts(group: Sequence[Result], protocol: str) -> list[dict[str, Any]]:
    """Each doubt of a model by one protocol: on which test sequences, and its largest value."""
    rows = {
        name: {r.sequence: r.number(protocol, name) for r in group if (protocol, name) in r.numbers}
        for name in (VOID, *DOUBTS)
    }
    return [
        {"name": name, "on": [*on], "value": max(on.values(), key=abs)}
        for name, on in rows.items()
        if on
    ]


def paired(rows: pd.DataFrame, protocol: str) -> list[Finding]:
    """A finding a model: on which sequences it is clearly better or worse than the reference.

    Both are compared on the same queries.
    """
    findings = []
    for (model, reference), group in against(rows, protocol).groupby(["model", "kind"], sort=False):
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
                "paired", model=model, reference=reference, protocol=protocol, verdicts=verdicts
            )
        )
    return findings


def novelties(study: Study, protocol: str) -> list[Finding]:
    """A finding a model: which kind of novelty rejects best, and which kept its precision best."""
    findings = []
    for model, group in by_model(study.results).items():
        kinds = group[0].evaluation.kinds
        wanted = group[0].wanted_precision
        # (sequence, kind, measure, 3)
        values = np.stack([result.evaluation.protocol(protocol).rejection for result in group])
        _, _, _, precision, recall = np.moveaxis(values[..., 0], 2, 0)
        values = values[np.isfinite(values[:, :, 0, 0]).all(axis=1)]
        if not len(values):
            continue
        auroc = values[:, :, 0]  # (sequence, kind, 3)
        ranked = sorted(
            (
                {"kind": kind, "auroc": auroc[:, k, 0].mean(), "auc": values[:, k, 1, 0].mean()}
                for k, kind in enumerate(kinds)
            ),
            key=lambda novelty: -novelty["auroc"],
        )
        first = kinds.index(ranked[0]["kind"])
        # other thresholds were chosen for the precision that could be kept, not the wanted one
        below = np.array(group[0].evaluation.kept_precision) < wanted
        chosen = np.isfinite(precision).all(axis=0) & ~below
        miss = np.where(chosen, np.abs(precision - wanted).mean(axis=0), np.inf)
        best = int(miss.argmin())
        kept = {
            "kind": kinds[best],
            "miss": miss[best],
            "wanted": wanted,
            "lowest": precision[:, best].min(),
            "recall": recall[:, best].mean(),
        }
        findings.append(
            Finding(
                "novelties",
                model=model,
                protocol=protocol,
                used=kinds[0],
                ranked=ranked,
                largest=max(ranked, key=lambda novelty: novelty["auc"]),
                ahead=int((auroc[:, first, 0] > auroc[:, 0, 0]).sum()),
                clearly=int((auroc[:, first, 1] > auroc[:, 0, 2]).sum()),
                tests=len(values),
                kept=kept if protocol == "cells" and np.isfinite(miss[best]) else {},
            )
        )
    return findings


def ageing(rows: pd.DataFrame, title: str, protocol: str, number: str, last_day: float) -> Finding:
    """Which models clearly lose of one number with the days, and when to train them again.

    For the other models: the most that they may lose.
    """
    slopes = _lines(rows, protocol, f"{number}_per_{PER_DAYS}_days")
    retrain_after = _lines(rows, protocol, f"{number}_retrain_after_days")
    lowest = {model: low for model, (_, low, high) in slopes.items() if high >= 0}
    worst = min(lowest, key=lambda model: lowest[model], default="")
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
    """For which models the seen places clearly look newer with the days."""
    slopes = _lines(rows, "distance", f"novelty_percentile_per_{PER_DAYS}_days")
    clear = [{"model": model, "slope": slope} for model, slope in slopes.items() if slope[1] > 0]
    everyone = len(clear) == len(slopes)
    return Finding("newer", known=len(slopes), sure=clear, all=everyone, per=PER_DAYS)


def confounders(study: Study) -> Finding:
    """What else differs between the sequences than their age.

    These are the shares of unseen queries, and of seen ones that drive another way.
    """
    results = by_model(study.results)[study.families[0]]
    days = np.array([result.days for result in results], np.float64)

    def change(shares: Sequence[float]) -> dict[str, float]:
        defined = (
            len(days) > 2 and np.isfinite(shares).all() and min(np.ptp(shares), np.ptp(days)) > 1e-6
        )
        correlation = float(np.corrcoef(days, shares)[0, 1]) if defined else np.nan
        return {"first": shares[0], "last": shares[-1], "correlation": correlation}

    unseen = [r.number("cells", "unseen") / max(r.number("cells", "queries"), 1) for r in results]
    turned = [result.number("cells", "turned_share") for result in results]
    return Finding("confounders", tests=len(days), unseen=change(unseen), turned=change(turned))


def slopes_counted(
    rows: pd.DataFrame, numbers: Sequence[tuple[str, str]], level: float = 0.95
) -> Finding:
    """How many of the drawn slopes clearly mean ageing, and how many would by chance.

    Adds the oracle's slope.
    """
    worse = [
        low > 0 if name == "novelty_percentile" else high < 0
        for protocol, name in numbers
        for _, low, high in _lines(rows, protocol, f"{name}_per_{PER_DAYS}_days").values()
    ]
    oracle = pick(rows, method=ORACLE, number=f"recall_at_1_same_heading_per_{PER_DAYS}_days")
    return Finding(
        "slopes_counted",
        worse=sum(worse),
        number=len(worse),
        chance=len(worse) * (1 - level) / 2,
        oracle=indexed(oracle, "method").get(ORACLE, ()),
        per=PER_DAYS,
    )


def near_changes(rows: pd.DataFrame, number: str, names: Mapping[float, str], few: int) -> Finding:
    """Which models clearly do worse once a change shows, by cells.

    Taken from the nearest band with at least `few` seen queries.
    """
    values = indexed(pick(rows, protocol="cells"), "number", "level", "change", "method")
    models = pick(rows, protocol="cells", number=number, change=SHOWN)["method"].unique()
    for edge in sorted(filter(np.isfinite, names)):
        seen = [values.get(("seen", edge, when, models[0]), (0,))[0] for when in (SHOWN, TO_COME)]
        if min(seen) >= few:
            return Finding(
                "near_changes",
                title=TITLES[number],
                band=names[edge],
                counts=[*map(int, seen)],
                verdicts=[
                    {
                        "model": model,
                        "shown": values[number, edge, SHOWN, model][0],
                        "before": values[number, edge, TO_COME, model][0],
                        "lower": values[number, edge, SHOWN, model][2]
                        < values[number, edge, TO_COME, model][1],
                    }
                    for model in models
                ],
            )
    return Finding("near_changes", title=TITLES[number], band="")


def changes_counted(rows: pd.DataFrame, kinds: Sequence[str], within_m: float) -> Finding:
    """The number of real changes, and of seen queries near one."""
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
    """Whether a number rises or falls from the smallest cells to the largest.

    Models are compared with themselves on the same sequences.
    """
    changes = {
        model: np.asarray(by_size[-1]) - np.asarray(by_size[0])
        for model, by_size in values.items()
        if len(by_size[0]) == len(by_size[-1])
    }
    ways = [
        {
            "way": way,
            "models": [
                {"model": model, "mean": float(change.mean())}
                for model, change in changes.items()
                if len(change) and (sign * change > 0).all()
            ],
        }
        for way, sign in (("rises", 1), ("falls", -1))
    ]
    ends = {"first_m": sizes_m[0], "last_m": sizes_m[-1]}
    return Finding("trend", title=title, models=len(changes), ways=ways, **ends)


def best_at_each_size(
    values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]
) -> Finding:
    """The best model at each cell size."""
    best_models: list[dict[str, Any]] = []
    for i, size_m in enumerate(sizes_m):
        means: list[dict[str, Any]] = [
            {"model": model, "size_m": size_m, "mean": float(np.mean(by_size[i]))}
            for model, by_size in values.items()
            if len(by_size[i])
        ]
        best_models += sorted(means, key=lambda entry: -entry["mean"])[:1]
    return Finding("best_at_each_size", title=title, listed=best_models)


def scope(study: Study, sequences: int, seeds: int, repeats: int = 1) -> Finding:
    """The data of a section: where, cells, sequences, repeats, seeds and budget."""
    return Finding(
        "scope",
        where=study.where,
        grid=study.grid,
        sequences=sequences,
        seeds=seeds,
        repeats=repeats,
        budget=study.settings.budget,
    )


def _lines(rows: pd.DataFrame, protocol: str, number: str) -> dict[str, Values]:
    """One number of the whole year and its interval, by model.

    The oracle, and models without an interval, are left out.
    """
    lines = pick(rows, protocol=protocol, number=number)
    return indexed(lines[(lines["method"] != ORACLE) & np.isfinite(lines["low"])], "method")
