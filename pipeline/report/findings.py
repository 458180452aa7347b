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
from pipeline.report.result import Result, by_model, day
from pipeline.report.selection import Values, indexed
from pipeline.report.study import Study, against
from pipeline.report.table import average
from pipeline.report.tables import TITLES

SLIGHT = 0.0005  # a loss that is smaller would be printed as 0


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

    def shares(model: str) -> dict[str, Any]:
        group = groups[model]
        means = {
            protocol: average([result.number(protocol, "recall_at_1") for result in group])
            for protocol in ("cells", "distance")
        }
        ends = [
            (result.number("distance", "recall_at_1"), result.days)
            for result in (group[0], group[-1])
        ]
        at_threshold = {
            measure: average(
                [result.number("distance", f"{measure}_at_threshold") for result in group]
            )
            for measure in ("precision", "recall")
        }
        return {
            "model": model,
            "mean": means,
            "ends": ends,
            "at": at_threshold,
            "wanted": group[0].wanted_precision,
            "kept": group[0].kept,
        }

    record = study.models[study.ranked[0]]
    (first, *other_models) = map(shares, study.ranked)
    budget = float(record.recipe["budget"]) if record.rounds and "budget" in record.recipe else None
    context = {
        "where": study.where,
        "train": day(study.train),
        "tests": len(groups[study.ranked[0]]),
        "budget": budget,
    }
    return Finding(
        "answer",
        **context,
        near_m=study.distance.correct_m,
        cell_m=study.cell_m,
        first=first,
        others=other_models,
    )


def doubts(study: Study) -> list[Finding]:
    """Why a model's numbers say little or nothing, and on which test sequences.

    A finding a model, or two where the protocols differ.
    """
    findings = []
    for model, group in by_model(study.results).items():
        doubts_by_protocol = {
            protocol: [
                doubt for name in (VOID, *DOUBTS) if (doubt := _doubt(group, protocol, name))["on"]
            ]
            for protocol in PROTOCOLS
        }
        protocols_agree = doubts_by_protocol["cells"] == doubts_by_protocol["distance"]
        if protocols_agree:
            doubts_by_protocol = {"both protocols": doubts_by_protocol["cells"]}
        for protocol_name, model_doubts in doubts_by_protocol.items():
            blind = max(
                result.number(protocol, BLIND)
                for result in group
                for protocol in PROTOCOLS
                if protocols_agree or protocol == protocol_name
            )
            context = {"wanted": group[0].wanted_precision, "tests": len(group), "blind": blind}
            if model_doubts:
                findings.append(
                    Finding(
                        "doubts",
                        model=model,
                        protocol=protocol_name,
                        listed=model_doubts,
                        **context,
                    )
                )
    return findings


def _doubt(group: Sequence[Result], protocol: str, name: str) -> dict[str, Any]:
    """On which test sequences a doubt applies, and its largest value."""
    value_on = {
        result.sequence: result.number(protocol, name)
        for result in group
        if (protocol, name) in result.numbers
    }
    return {"name": name, "on": list(value_on), "value": max(value_on.values(), key=abs, default=0)}


def paired(rows: pd.DataFrame, protocol: str) -> list[Finding]:
    """A finding a model: on which sequences it is clearly better or worse than the reference.

    Both are compared on the same queries.
    """
    findings = []
    for (model, reference), group in against(rows, protocol).groupby(["model", "kind"], sort=False):
        verdicts = []
        values_of = group.set_index(["number", "sequence"])["value"]
        for number in COMPARED:
            values = values_of[f"{number}_difference"]
            p = values_of[f"{number}_difference_p"]
            better, worse = (
                [day(sequence) for sequence in values.index[(p < LEVEL) & (sign * values > 0)]]
                for sign in (1, -1)
            )
            verdicts.append(
                {
                    "title": TITLES[number],
                    "mean": values.mean(),
                    "better": better,
                    "worse": worse,
                    "tests": len(values),
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
        judgements = [result.evaluation.protocol(protocol) for result in group]
        # (sequence, kind, measure, 3)
        values = np.stack([judgement.rejection for judgement in judgements])
        auroc, area, _, precision, recall = np.moveaxis(values[..., 0], 2, 0)
        finite = np.isfinite(auroc).all(axis=1)
        if not finite.any():
            continue
        means = zip(kinds, auroc[finite].mean(axis=0), area[finite].mean(axis=0), strict=True)
        kind_means: list[dict[str, Any]] = [
            {"kind": kind, "auroc": mean_auroc, "auc": mean_auc}
            for kind, mean_auroc, mean_auc in means
        ]
        ranked = sorted(kind_means, key=lambda novelty: -novelty["auroc"])
        first = kinds.index(ranked[0]["kind"])
        low = values[finite][:, first, 0, 1]
        high = values[finite][:, 0, 0, 2]
        context: dict[str, Any] = {
            "ahead": int((auroc[finite][:, first] > auroc[finite][:, 0]).sum()),
            "clearly": int((low > high).sum()),
        }
        # these thresholds were chosen for the precision that could be kept, not the wanted one
        below_wanted = np.array(group[0].evaluation.kept_precision) < wanted
        chosen = np.isfinite(precision).all(axis=0) & ~below_wanted
        miss = np.where(chosen, np.abs(precision - wanted).mean(axis=0), np.inf)
        best = int(miss.argmin())
        kept = {}
        if protocol == "cells" and np.isfinite(miss[best]):
            kept = {"kind": kinds[best], "miss": miss[best], "wanted": wanted}
            kept |= {"lowest": precision[:, best].min(), "recall": recall[:, best].mean()}
        context |= {"used": kinds[0], "ranked": ranked, "tests": int(finite.sum()), "kept": kept}
        largest = max(ranked, key=lambda novelty: novelty["auc"])
        findings.append(
            Finding("novelties", model=model, protocol=protocol, largest=largest, **context)
        )
    return findings


def ageing(rows: pd.DataFrame, title: str, protocol: str, number: str, last_day: float) -> Finding:
    """Which models clearly lose of one number with the days, and when to train them again.

    For the other models: the most that they may lose.
    """
    slopes, retrain_after = (
        _lines(rows, protocol, f"{number}_{end}")
        for end in (f"per_{PER_DAYS}_days", "retrain_after_days")
    )
    falls = [
        {"model": model, "slope": slope, "days": retrain_after[model]}
        for model, slope in slopes.items()
        if model in retrain_after
    ]
    not_falling = {model: low for model, (_, low, high) in slopes.items() if high >= 0}
    lowest = min(not_falling.values(), default=0.0)
    worst = (
        {"model": min(not_falling, key=lambda model: not_falling[model]), "slope": lowest}
        if lowest < -SLIGHT
        else {}
    )
    counts = {"known": len(slopes), "others": len(not_falling), "last": last_day, "per": PER_DAYS}
    return Finding("ageing", title=title, falls=falls, worst=worst, **counts)


def newer(rows: pd.DataFrame) -> Finding:
    """For which models the seen places clearly look newer with the days."""
    slopes = _lines(rows, "distance", f"novelty_percentile_per_{PER_DAYS}_days")
    clear_slopes = [
        {"model": model, "slope": slope} for model, slope in slopes.items() if slope[1] > 0
    ]
    return Finding(
        "newer",
        known=len(slopes),
        sure=clear_slopes,
        all=len(clear_slopes) == len(slopes),
        per=PER_DAYS,
    )


def confounders(study: Study) -> Finding:
    """What else differs between the sequences than their age.

    These are the shares of unseen queries, and of seen ones that drive another way.
    """
    results = by_model(study.results)[study.families[0]]
    days = np.array([result.days for result in results], np.float64)
    unseen = np.array(
        [
            result.number("cells", "unseen") / max(result.number("cells", "queries"), 1)
            for result in results
        ]
    )
    turned = np.array([result.number("cells", "turned_share") for result in results])

    def change(shares: Any) -> dict[str, float]:
        defined = (
            len(days) > 2 and np.isfinite(shares).all() and min(np.ptp(shares), np.ptp(days)) > 1e-6
        )
        correlation = float(np.corrcoef(days, shares)[0, 1]) if defined else np.nan
        return {"first": shares[0], "last": shares[-1], "correlation": correlation}

    return Finding("confounders", tests=len(days), unseen=change(unseen), turned=change(turned))


def slopes_counted(
    rows: pd.DataFrame, numbers: Sequence[tuple[str, str]], level: float = 0.95
) -> Finding:
    """How many of the drawn slopes clearly mean ageing, and how many would by chance.

    Adds the oracle's slope.
    """
    slopes = [
        (name, slope)
        for protocol, name in numbers
        for slope in _lines(rows, protocol, f"{name}_per_{PER_DAYS}_days").values()
    ]
    worse = sum(
        low > 0 if name == "novelty_percentile" else high < 0 for name, (_, low, high) in slopes
    )
    oracle_rows = rows[
        (rows["method"] == ORACLE)
        & (rows["number"] == f"recall_at_1_same_heading_per_{PER_DAYS}_days")
    ]
    oracle = indexed(oracle_rows, "method").get(ORACLE, ())
    chance = len(slopes) * (1 - level) / 2
    return Finding(
        "slopes_counted",
        worse=worse,
        number=len(slopes),
        chance=chance,
        oracle=oracle,
        per=PER_DAYS,
    )


def near_changes(rows: pd.DataFrame, number: str, names: Mapping[float, str], few: int) -> Finding:
    """Which models clearly do worse once a change shows, by cells.

    Taken from the nearest band with at least `few` seen queries.
    """
    values = indexed(rows[rows["protocol"] == "cells"], "number", "level", "change", "method")
    models = list(
        dict.fromkeys(
            model for name, _, change, model in values if name == number and change == SHOWN
        )
    )
    for edge in sorted(names):
        counts = [
            int(values.get(("seen", edge, when, models[0]), (0,))[0]) for when in (SHOWN, TO_COME)
        ]
        if np.isfinite(edge) and min(counts) >= few:
            break
    else:
        return Finding("near_changes", title=TITLES[number], band="")
    verdicts = []
    for model in models:
        shown_values, earlier_values = (
            values[number, edge, when, model] for when in (SHOWN, TO_COME)
        )
        verdicts.append(
            {
                "model": model,
                "shown": shown_values[0],
                "before": earlier_values[0],
                "lower": shown_values[2] < earlier_values[1],
            }
        )
    return Finding(
        "near_changes", title=TITLES[number], band=names[edge], counts=counts, verdicts=verdicts
    )


def changes_counted(rows: pd.DataFrame, kinds: Sequence[str], within_m: float) -> Finding:
    """The number of real changes, and of seen queries near one."""
    counts = {
        kind: int(rows.loc[rows["number"] == f"{kind}_changes", "value"].sum()) for kind in kinds
    }
    near = rows[rows["number"] == "seen_near_a_change"].set_index("sequence")["value"]
    busiest = (
        {}
        if near.empty or not near.max()
        else {"sequence": day(near.idxmax()), "seen": int(near.max())}
    )
    return Finding(
        "changes_counted", counts=counts, seen=int(near.sum()), within_m=within_m, most=busiest
    )


def trend(values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]) -> Finding:
    """Whether a number rises or falls from the smallest cells to the largest.

    Models are compared with themselves on the same sequences.
    """
    comparable = {
        model: by_size for model, by_size in values.items() if len(by_size[0]) == len(by_size[-1])
    }
    differences = {
        model: np.asarray(by_size[-1]) - np.asarray(by_size[0])
        for model, by_size in comparable.items()
    }
    ways = [
        {
            "way": way,
            "models": [
                {"model": model, "mean": float(difference.mean())}
                for model, difference in differences.items()
                if len(difference) and (sign * difference > 0).all()
            ],
        }
        for way, sign in (("rises", 1), ("falls", -1))
    ]
    return Finding(
        "trend",
        title=title,
        first_m=sizes_m[0],
        last_m=sizes_m[-1],
        models=len(differences),
        ways=ways,
    )


def best_at_each_size(
    values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]
) -> Finding:
    """The best model at each cell size."""
    best_models = []
    for i, size_m in enumerate(sizes_m):
        means = {
            model: float(np.mean(by_size[i]))
            for model, by_size in values.items()
            if len(by_size[i])
        }
        if means:
            best = max(means, key=lambda model: means[model])
            best_models.append({"model": best, "size_m": size_m, "mean": means[best]})
    return Finding("best_at_each_size", title=title, listed=best_models)


def scope(study: Study, sequences: int, seeds: int, repeats: int = 1) -> Finding:
    """The data of a section: where, cells, sequences, repeats, seeds and budget."""
    extent = {
        "sequences": sequences,
        "seeds": seeds,
        "repeats": repeats,
        "budget": study.settings.budget,
    }
    return Finding("scope", where=study.where, grid=study.grid, **extent)


def _lines(rows: pd.DataFrame, protocol: str, number: str) -> dict[str, Values]:
    """One number of the whole year and its interval, by model.

    The oracle, and models without an interval, are left out.
    """
    number_rows = rows[
        (rows["protocol"] == protocol) & (rows["number"] == number) & (rows["method"] != ORACLE)
    ]
    return indexed(number_rows[np.isfinite(number_rows["low"])], "method")
