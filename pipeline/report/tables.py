"""The tables of a report, from the table of results: every cell is a row of it, or a mean and deviation over some rows."""

from collections.abc import Mapping
from textwrap import shorten

import numpy as np
import pandas as pd

from pipeline.evaluation.numbers import MEASURES
from pipeline.evaluation.paired import COMPARED, LEVEL
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS, SHOWN
from pipeline.report.study import Result, Study, against, by_model, by_sequence, dates
from pipeline.report.table import MISSING, Cell, Table, average, count, difference, number, spread, word
from pipeline.studies import catalogue
from pipeline.studies.expansion import ModelName

SHOWN_MEANS = (
    ("AUC exact", "auc_exact_top1", 3), ("F1max", "f1_max", 3), ("R@99%P", "recall_at_99_precision", 3), ("AUROC", "auroc", 3),
    ("precision", "precision_at_threshold", 3), ("recall", "recall_at_threshold", 3), ("error [m]", "median_error_m", 1),
    ("heading error [°]", "median_heading_error_deg", 1), ("within 10°", "heading_within_10deg", 3),
)  # fmt: skip
"""Heading, number, digits: what is shown without intervals."""
HEADINGS = SHOWN_MEANS[-2:]
MAIN = {"recall_at_1": ("recall@1", "oracle"), "auc_top1": ("AUC top-1", "oracle_auc_exact_top1")}
"""Number of the models: its heading, and the oracle's number beside it."""
TESTED_AS = {"recall_at_1": "recall_at_1", "auc_top1": "auc_exact_top1"}
"""The number of the paired test whose mark stands behind each of MAIN: the papers' area and the exact one differ little."""
TITLES = {"recall_at_1": "recall@1", "auc_exact_top1": "exact AUC"}
COSTS = (
    ("CPU [s] to train", "train_cpu_s", 1), ("wall [s]", "train_wall_s", 1), ("peak memory [MB]", "train_peak_memory_mb", 0),
    ("model [MB]", "model_mb", 1), ("view [ms]", "generation_ms", 2), ("ranking [ms]", "retrieval_ms", 2),
    ("query [ms]", "query_ms", 2), ("query, 95 % [ms]", "query_ms_p95", 2),
)  # fmt: skip


def setup(study: Study, longest: int = 400) -> Table:
    """A row a model: what it is, what it looks at, how much of its own full training it had, and its size."""
    rows = []
    for model, learned in study.models.items():
        what = shorten(catalogue.what(learned.recipe.get("_target_", "")), longest, placeholder=" …") or MISSING
        budget, trained = MISSING, "nothing"
        if learned.rounds:
            best = "" if learned.best_round is None else f", no. {learned.best_round + 1} kept"
            budget, trained = learned.recipe.get("budget", MISSING), f"{learned.rounds} rounds{best}"
        source = study.source("train", model=model)
        words = (word(model, source), word(what), word(learned.recipe.get("view", MISSING)), word(budget), word(trained))
        rows.append((*words, number(learned.megabytes, 1, source=source)))
    return Table("setup", ("model", "what it is", "looks at", "budget", "trained", "model [MB]"), tuple(rows), words=5)


def sequences(study: Study) -> Table:
    """Table II of the SCI paper: each test sequence's age, and how much of it lies where training went, by both protocols."""
    rows = []
    for name, (first, *_) in by_sequence(study.results).items():
        source, queries = study.source("labels", name), first.number("cells", "queries")
        (seen, unseen), (near, far) = ([first.number(by, one) for one in ("seen", "unseen")] for by in PROTOCOLS)
        share = number(unseen / queries if queries else np.nan, 3, source=source)
        by_cells = (*(count(one, source) for one in (first.days, queries, seen, unseen)), share)
        rows.append((word(name, source), *by_cells, *(count(one, source) for one in (near, far, queries - near - far))))
    cells, distance = ("cells: seen", "unseen", "share unseen"), ("distance: seen", "unseen", "not judged")
    return Table("sequences", ("sequence", "days", "queries", *cells, *distance), tuple(rows))


def main(study: Study, protocol: str, name: str) -> Table:
    """One number of MAIN by one protocol, a row a test sequence and a column a model, with intervals; the oracle last."""
    (heading, oracle), marks, days = MAIN[name], _marks(study, protocol, TESTED_AS[name]), dates(study.results)

    def entry(one: Result) -> Cell:
        mark, source = marks.get((one.model, one.sequence), ""), study.source("evaluate", one.sequence, one.model)
        return number(one.number(protocol, name), 3, one.interval(protocol, name), mark, source)

    rows = []
    for sequence, group in by_sequence(study.results).items():
        best = number(group[0].number(protocol, oracle), 3, source=study.source("labels", sequence))
        rows.append((word(days[sequence], study.source("labels", sequence)), *map(entry, group), best))
    if len(rows) > 1:
        means = [spread([one.number(protocol, name) for one in group], 3) for group in by_model(study.results).values()]
        oracles = [group[0].number(protocol, oracle) for group in by_sequence(study.results).values()]
        rows.append((word("mean"), *means, spread(oracles, 3)))
    header = (heading, *by_model(study.results), "oracle" if name == "recall_at_1" else "oracle, exact")
    values = {"protocol": protocol, "reference": study.families[0], "marked": bool(marks)}
    return Table(f"main_{name}", header, tuple(rows), values=values, mean=len(rows) > 1)


def _marks(study: Study, protocol: str, tested: str) -> dict[tuple[str, str], str]:
    """Model and sequence to + or −: clearly better or worse than the study's first method in the paired test."""
    rows = against(study.rows, protocol)
    values, p = (
        rows[rows["number"] == f"{tested}_{end}"].set_index(["model", "sequence"])["value"]
        for end in ("difference", "difference_p")
    )
    return {key: "+" if values[key] > 0 else "−" for key in values.index if p[key] < LEVEL}


def means(study: Study) -> Table:
    """The other numbers of each model by both protocols: means over the test sequences."""
    rows = []
    for by in PROTOCOLS:
        for model, group in by_model(study.results).items():
            found = ((average([one.number(by, key) for one in group]), digits) for _, key, digits in SHOWN_MEANS)
            rows.append((word(model), word(by), *(number(*one) for one in found)))
    return Table("means", ("mean", "by", *(heading for heading, *_ in SHOWN_MEANS)), tuple(rows), words=2)


def everything(study: Study, protocol: str) -> Table:
    """The numbers of each sequence and model by one protocol."""
    columns = (("recall@1", "recall_at_1", 3), ("oracle", "oracle", 3), ("AUC top-1", "auc_top1", 3), *SHOWN_MEANS[:7])
    rows = [
        (word(name), word(one.model), *(number(one.number(protocol, key), digits) for _, key, digits in columns))
        for name, group in by_sequence(study.results).items()
        for one in group
    ]
    header = ("sequence", "model", *(heading for heading, *_ in columns))
    return Table("everything", header, tuple(rows), words=2, values={"protocol": protocol})


def headings(study: Study) -> Table | None:
    """How well headings were found, by both protocols; None where no model gives one."""
    rows = []
    columns = [(f"{heading}, by {by}", by, key, digits) for by in PROTOCOLS for heading, key, digits in HEADINGS]
    for model, group in by_model(study.results).items():
        if not any(np.isfinite(one.evaluation.heading_error_deg).any() for one in group):
            continue
        for one in group:
            source = study.source("evaluate", one.sequence, model)
            cells = [number(one.number(by, key), digits, one.interval(by, key), source=source) for _, by, key, digits in columns]
            rows.append((word(model), word(one.sequence), *cells))
        if len(group) > 1:
            found = [spread([one.number(by, key) for one in group], digits) for _, by, key, digits in columns]
            rows.append((word(model), word("mean"), *found))
    return Table("headings", ("model", "sequence", *(heading for heading, *_ in columns)), tuple(rows), words=2) if rows else None


def novelties(study: Study, protocol: str) -> Table:
    """How each kind of novelty rejects by one protocol: means over the test sequences, and the sequence it does worst in."""
    shown, rows = ("AUROC", "AUC exact", "R@99%P", "precision", "recall"), []
    for model, group in by_model(study.results).items():
        values = np.stack([one.evaluation.protocol(protocol).rejection[:, :, 0] for one in group])  # (sequence, kind, measure)
        for k, kind in enumerate(group[0].evaluation.kinds):
            auroc = values[:, k, MEASURES.index("auroc")]
            at = int(np.nanargmin(auroc)) if np.isfinite(auroc).any() else None
            worst = Cell(MISSING) if at is None else Cell(f"{auroc[at]:.3f}", float(auroc[at]), f"on {group[at].sequence[:10]}")
            cells = [number(average(values[:, k, measure]), 3) for measure in range(len(MEASURES))]
            rows.append((word(model), word(kind + ("" if k else ", in use")), *cells, worst))
    return Table("novelties", ("model", "novelty", *shown, "worst AUROC"), tuple(rows), words=2, values={"protocol": protocol})


def paired(study: Study, protocol: str) -> Table | None:
    """Every model against the first: differences with intervals, p, and who alone was right; None where there is one model."""
    own = against(study.rows, protocol)
    if own.empty:
        return None
    known, rows = own.set_index(["model", "sequence", "number"])[["value", "low", "high"]], []
    for model, sequence in dict.fromkeys(zip(own["model"], own["sequence"], strict=True)):
        cells = [word(model, study.source("evaluate", sequence, model)), word(sequence)]
        for name in COMPARED:
            value, low, high = known.loc[(model, sequence, f"{name}_difference")]
            p = known.loc[(model, sequence, f"{name}_difference_p"), "value"]
            verdict = "undecided" if not p < LEVEL else "better" if value > 0 else "worse"
            cells += [difference(value, 3, (low, high)), number(p, 3), Cell(verdict)]
        alone = [known.loc[(model, sequence, f"only_{who}_right"), "value"] for who in ("this", "reference")]
        rows.append((*cells, *map(count, alone)))
    reference = study.families[0]
    columns = [text for name in COMPARED for text in (f"Δ {TITLES[name]}", "p", "verdict")]
    header = ("model", "sequence", *columns, "only it right", f"only {reference} right")
    return Table("paired", header, tuple(rows), words=2, values={"protocol": protocol, "reference": reference})


def costs(study: Study) -> Table | None:
    """A row a model, variants and seeds too: what training cost where it was done here, and a query's time; None of none."""
    rows = []
    names = zip(study.rows["method"], study.rows["variant"], study.rows["seed"], strict=True)
    known = study.rows.assign(model=[ModelName(*name).name for name in names]).set_index(["model", "number"])["value"]
    for model in study.trained:
        cells = [number(known.get((model, key), np.nan), digits) for _, key, digits in COSTS]
        rows.append((word(model, study.source("train", model=model)), *cells))
    header = ("model", *(heading for heading, *_ in COSTS))
    return Table("costs", header, tuple(rows)) if any(cell.key is not None for row in rows for cell in row) else None


def ageing(rows: pd.DataFrame, protocol: str, name: str, title: str) -> Table:
    """The line through one number over the days, a row a model and the oracle."""
    own = rows[rows["protocol"] == protocol].set_index(["method", "number"])[["value", "low", "high"]]
    digits, found = (1 if name == "novelty_percentile" else 3), []
    for model in dict.fromkeys(rows.loc[rows["number"] == f"{name}_line", "method"]):
        value = {end: own.loc[(model, f"{name}_{end}")] for end in _ENDS if (model, f"{name}_{end}") in own.index}
        slope = value.get(_ENDS[1], pd.Series({"value": np.nan, "low": np.nan, "high": np.nan}))
        lost = value.get(_ENDS[4])
        again = Cell(MISSING) if lost is None or model == ORACLE else number(lost["value"], 0, (lost["low"], lost["high"]))
        single = [value[end]["value"] if end in value else np.nan for end in (_ENDS[0], _ENDS[2], _ENDS[3])]
        cells = (number(single[0], digits), difference(slope["value"], digits, (slope["low"], slope["high"])))
        found.append((word(model), *cells, difference(single[1], digits), number(single[2], 3), again))
    header = ("model", "on day 0", f"per {PER_DAYS} days", "Theil–Sen", "p", "train again after [days]")
    return Table("ageing", header, tuple(found), values={"title": title, "per": PER_DAYS})


_ENDS = ("day_0", f"per_{PER_DAYS}_days", f"theil_sen_per_{PER_DAYS}_days", "slope_p", "retrain_after_days")


def near_changes(rows: pd.DataFrame, protocol: str, name: str, bands: Mapping[float, str]) -> Table:
    """One number by one protocol: a row a model, a column a band of distance, with intervals; then the oracle and the queries."""
    shown = rows[(rows["change"] == SHOWN) & (rows["protocol"] == protocol)]
    own = shown.set_index(["number", "method", "level"])[["value", "low", "high"]]
    models = list(dict.fromkeys(own.index.get_level_values("method")))

    def line(text: str, key: str, model: str, digits: int) -> tuple[Cell, ...]:
        return (word(text), *(number(v, digits, (low, high)) for v, low, high in (own.loc[(key, model, edge)] for edge in bands)))

    found = [line(model, name, model, 3) for model in models]
    found += [line("oracle", "oracle", models[0], 3)] if name == "recall_at_1" else []
    found += [line(f"{which} queries", which, models[0], 0) for which in ("seen", "unseen")]
    values = {"title": TITLES[name], "protocol": protocol}
    return Table("near_changes", ("nearest change", *bands.values()), tuple(found), values=values)
