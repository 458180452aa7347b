"""What the numbers show, as data: who is compared, by how much, and whether that is clear. Templates make the sentences.

Every value is a row of the table of results, or a mean of such rows over the test sequences; names of models come from there too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.evaluation.paired import COMPARED, LEVEL
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS, SHOWN, TO_COME
from pipeline.report.study import Study, against, by_model
from pipeline.report.table import average

SLIGHT = 0.0005
"""A loss that is smaller would be printed as 0."""


@dataclass(frozen=True)
class Finding:
    """One verdict."""

    kind: str
    """Its key in templates/words.yaml, which holds the sentence."""
    values: Mapping[str, Any]
    """What the sentence is filled with: names of models, differences, intervals, whether they are clear."""


def answer(study: Study) -> Finding:
    """The study in a paragraph: how often the best model finds the right place, how that ages, and how the others fare."""
    groups = by_model(study.results)

    def shares(model: str) -> dict[str, Any]:
        group = groups[model]
        means = {by: average([one.number(by, "recall_at_1") for one in group]) for by in ("cells", "distance")}
        ends = [(one.number("distance", "recall_at_1"), one.days) for one in (group[0], group[-1])]
        at = {of: average([one.number("distance", f"{of}_at_threshold") for one in group]) for of in ("precision", "recall")}
        return {"model": model, "mean": means, "ends": ends, "at": at, "wanted": group[0].wanted_precision}

    learned = study.models[study.best]
    budget = float(learned.recipe["budget"]) if learned.rounds and "budget" in learned.recipe else None
    values = {"where": study.where, "train": study.train[:10], "tests": len(groups[study.best]), "budget": budget}
    metres = {"near_m": study.distance.correct_m, "cell_m": study.cell_m}
    return Finding("answer", values | metres | {"first": shares(study.best), "others": [shares(one) for one in study.ranked[1:]]})


def paired(rows: pd.DataFrame, protocol: str) -> list[Finding]:
    """A finding a model: where it is clearly better than the reference on the same queries, and where worse."""
    found = []
    for (model, reference), group in against(rows, protocol).groupby(["model", "kind"], sort=False):
        verdicts = []
        for number in COMPARED:
            values = group[group["number"] == f"{number}_difference"].set_index("sequence")["value"]
            p = group[group["number"] == f"{number}_difference_p"].set_index("sequence")["value"]
            better, worse = ([one[:10] for one in values.index[(p < LEVEL) & (sign * values > 0)]] for sign in (1, -1))
            verdicts.append({"number": number, "mean": values.mean(), "better": better, "worse": worse, "tests": len(values)})
        found.append(Finding("paired", {"model": model, "reference": reference, "protocol": protocol, "verdicts": verdicts}))
    return found


def novelties(study: Study, protocol: str) -> list[Finding]:
    """A finding a model: which kind of novelty rejects best, and whose thresholds kept the wanted precision best."""
    found = []
    for model, group in by_model(study.results).items():
        kinds = group[0].evaluation.kinds
        values = np.stack([one.evaluation.protocol(protocol).rejection for one in group])  # (sequence, kind, measure, 3)
        auroc, area, _, precision, recall = np.moveaxis(values[..., 0], 2, 0)
        there = np.isfinite(auroc).all(axis=1)
        if not there.any():
            continue
        means = {"auroc": auroc[there].mean(axis=0), "auc": area[there].mean(axis=0)}
        order = [int(one) for one in np.argsort(-means["auroc"])]
        low, high = values[there][:, order[0], 0, 1], values[there][:, 0, 0, 2]
        miss = np.where(np.isfinite(precision).all(axis=0), np.abs(precision - group[0].wanted_precision).mean(axis=0), np.inf)
        kept = int(miss.argmin()) if protocol == "cells" and np.isfinite(miss).any() else None
        lowest = None if kept is None else {"kind": kinds[kept], "miss": miss[kept], "wanted": group[0].wanted_precision}
        if lowest:
            lowest |= {"lowest": precision[:, kept].min(), "recall": recall[:, kept].mean()}
        ranked = [{"kind": kinds[one], "auroc": means["auroc"][one], "auc": means["auc"][one]} for one in order]
        ahead = {"ahead": int((auroc[there][:, order[0]] > auroc[there][:, 0]).sum()), "clearly": int((low > high).sum())}
        shown = {"model": model, "protocol": protocol, "used": kinds[0], "ranked": ranked, "tests": int(there.sum())}
        largest = max(ranked, key=lambda one: float(one["auc"]))
        found.append(Finding("novelties", shown | ahead | {"kept": lowest, "largest": largest}))
    return found


def ageing(rows: pd.DataFrame, title: str, protocol: str, number: str, last_day: float) -> Finding:
    """Which models clearly lose of one number with the days, when to train them again, and what the others may lose."""
    slopes, lost = (_lines(rows, protocol, f"{number}_{end}") for end in (f"per_{PER_DAYS}_days", "retrain_after_days"))
    slopes = slopes[np.isfinite(slopes["low"])]
    clear = [model for model in slopes.index if model in lost.index]
    falls = [{"model": model, "slope": tuple(slopes.loc[model]), "days": tuple(lost.loc[model])} for model in clear]
    others = slopes[slopes["high"] >= 0]
    worst = {"model": others["low"].idxmin(), "slope": others["low"].min()} if (others["low"] < -SLIGHT).any() else {}
    values = {"title": title, "known": len(slopes), "falls": falls, "others": len(others), "worst": worst}
    return Finding("ageing", values | {"last": last_day, "per": PER_DAYS})


def newer(rows: pd.DataFrame) -> Finding:
    """To which models the seen places clearly look newer with the days."""
    slopes = _lines(rows, "distance", f"novelty_percentile_per_{PER_DAYS}_days")
    slopes = slopes[np.isfinite(slopes["low"])]
    sure = slopes[slopes["low"] > 0]
    listed = [{"model": model, "slope": tuple(sure.loc[model])} for model in sure.index]
    return Finding("newer", {"known": len(slopes), "sure": listed, "all": len(sure) == len(slopes), "per": PER_DAYS})


def confounders(study: Study) -> Finding:
    """What else differs between the sequences: the shares of unseen queries, and of seen ones that drive another way."""
    first = by_model(study.results)[study.families[0]]
    days = np.array([one.days for one in first], np.float64)
    unseen = np.array([one.number("cells", "unseen") / max(one.number("cells", "queries"), 1) for one in first])
    turned = np.array([one.number("cells", "turned_share") for one in first])

    def change(shares: Any) -> dict[str, float]:
        there = len(days) > 2 and np.isfinite(shares).all() and min(np.ptp(shares), np.ptp(days)) > 1e-6
        correlation = float(np.corrcoef(days, shares)[0, 1]) if there else np.nan
        return {"first": shares[0], "last": shares[-1], "correlation": correlation}

    return Finding("confounders", {"tests": len(days), "unseen": change(unseen), "turned": change(turned)})


def slopes_counted(rows: pd.DataFrame, shown: Sequence[tuple[str, str]], level: float = 0.95) -> Finding:
    """How many of the slopes that are drawn clearly mean ageing, against how many would by chance; and the oracle's."""
    worse = number = 0
    for protocol, name in shown:
        slopes = _lines(rows, protocol, f"{name}_per_{PER_DAYS}_days").dropna()
        worse += int((slopes["low"] > 0).sum() if name == "novelty_percentile" else (slopes["high"] < 0).sum())
        number += len(slopes)
    own = rows[(rows["method"] == ORACLE) & (rows["number"] == f"recall_at_1_same_heading_per_{PER_DAYS}_days")]
    oracle = tuple(own[["value", "low", "high"]].iloc[0]) if len(own) else ()
    values = {"worse": worse, "number": number, "chance": number * (1 - level) / 2, "oracle": oracle, "per": PER_DAYS}
    return Finding("slopes_counted", values)


def near_changes(rows: pd.DataFrame, number: str, names: Mapping[float, str], few: int) -> Finding:
    """By cells, in the nearest band with enough seen queries: which models clearly do worse there once a change shows."""
    own = rows[(rows["protocol"] == "cells") & rows["change"].isin([SHOWN, TO_COME])]
    seen = own[own["number"] == "seen"].groupby(["change", "level"])["value"].first().unstack(0, fill_value=0)
    enough = [edge for edge in sorted(names) if np.isfinite(edge) and (seen.loc[edge] >= few).all()]
    if not enough:
        return Finding("near_changes", {"number": number, "band": ""})
    edge, verdicts = enough[0], []
    values = own[(own["number"] == number) & (own["level"] == edge)].set_index(["method", "change"])[["value", "low", "high"]]
    for model in dict.fromkeys(values.index.get_level_values(0)):
        shown, before = (tuple(values.loc[(model, when)]) for when in (SHOWN, TO_COME))
        verdicts.append({"model": model, "shown": shown, "before": before, "lower": bool(shown[2] < before[1])})
    counts = {"shown": int(seen.loc[edge, SHOWN]), "to_come": int(seen.loc[edge, TO_COME])}
    return Finding("near_changes", {"number": number, "band": names[edge], "counts": counts, "verdicts": verdicts})


def changes_counted(rows: pd.DataFrame, kinds: Sequence[str], within_m: float) -> Finding:
    """How much there is to see: the changes, and the seen queries near one."""
    counts = {kind: int(rows.loc[rows["number"] == f"{kind}_changes", "value"].sum()) for kind in kinds}
    near = rows[rows["number"] == "seen_near_a_change"].set_index("sequence")["value"]
    most = {} if near.empty or not near.max() else {"sequence": near.idxmax(), "seen": int(near.max())}
    return Finding("changes_counted", {"counts": counts, "seen": int(near.sum()), "within_m": within_m, "most": most})


def trend(values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]) -> Finding:
    """Which way a number goes from the smallest cells to the largest, model by model, on the same sequences."""
    ends = {model: (found[0], found[-1]) for model, found in values.items() if len(found[0]) == len(found[-1])}
    apart = {model: np.asarray(last) - np.asarray(first) for model, (first, last) in ends.items()}
    ways = {"rises": {m: float(d.mean()) for m, d in apart.items() if len(d) and (d > 0).all()}}
    ways["falls"] = {m: float(d.mean()) for m, d in apart.items() if len(d) and (d < 0).all()}
    return Finding("trend", {"title": title, "first_m": sizes_m[0], "last_m": sizes_m[-1], "models": len(apart), "ways": ways})


def best_at_each_size(values: Mapping[str, Sequence[Any]], title: str, sizes_m: Sequence[float]) -> Finding:
    """The first model at each size."""
    listed = []
    for i, size_m in enumerate(sizes_m):
        means = {model: float(np.mean(found[i])) for model, found in values.items() if len(found[i])}
        best = [max(means, key=lambda one: means[one])] if means else []
        listed += [{"model": model, "size_m": size_m, "mean": means[model]} for model in best]
    return Finding("best_at_each_size", {"title": title, "listed": listed})


def scope(study: Study, grid: str, sequences: int, seeds: int, repeats: int = 1) -> Finding:
    """What a section rests on: where, cells, how many sequences, repeats and seeds, and the budget."""
    rests = {"sequences": sequences, "seeds": seeds, "repeats": repeats, "budget": study.words["budget"]}
    return Finding("scope", {"where": study.where, "grid": grid, **rests})


def _lines(rows: pd.DataFrame, protocol: str, number: str) -> pd.DataFrame:
    """Value, low and high of one number of the whole year, a row a model; the oracle left out."""
    own = rows[(rows["protocol"] == protocol) & (rows["number"] == number) & (rows["method"] != ORACLE)]
    return own.set_index("method")[["value", "low", "high"]]
