"""The further tables of a study of the year: all other numbers, tests of them, and ageing."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from pipeline.evaluation.numbers import MEASURES
from pipeline.evaluation.paired import COMPARED, LEVEL
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS, PERCENTILE
from pipeline.report.result import TITLES, Result, by_model, by_sequence, day, mean
from pipeline.report.selection import NONE, indexed, is_posed, pick
from pipeline.report.study import Study, against
from pipeline.report.table import (
    Cell,
    Table,
    average,
    count,
    difference,
    kept_precision,
    number,
    table,
)
from pipeline.report.tables.columns import (
    DISTANCE_FIRST,
    Column,
    bounded_cells,
    headings_of,
    mean_cells,
    plain_cells,
)

# The columns of `headings`: errors of the headings that a model gives.
HEADINGS = (
    Column("heading error [°]", "median_heading_error_deg", 1),
    Column("within 10°", "heading_within_10deg", 3),
)
# The columns of `means` and `everything`: the numbers that no main table shows.
FURTHER = (
    Column("AUC exact", "auc_exact_top1", 3),
    Column("AUC top-5", "auc_top5", 3),
    Column("AUC top-25", "auc_top25", 3),
    Column("F1max", "f1_max", 3),
    Column("R@99%P", "recall_at_99_precision", 3),
    Column("AUROC", "auroc", 3),
    Column("precision", "precision_at_threshold", 3),
    Column("keeps", "kept_precision", 3),
    Column("recall", "recall_at_threshold", 3),
    Column("error [m]", "median_error_m", 1),
)
# The columns of `everything`: the main numbers before the further ones.
EVERYTHING = (
    Column("recall@1", "recall_at_1", 3),
    Column("oracle", "oracle", 3),
    Column("AUC top-1", "auc_top1", 3),
    *FURTHER,
)
# The columns of `novelties`: MEASURES, the precision kept, and the sequence of the worst AUROC.
NOVELTY_HEADINGS = (
    "AUROC",
    "AUC exact",
    "R@99%P",
    "precision",
    "recall",
    "keeps",
    "worst AUROC",
)


def means(study: Study) -> Table:
    """The other numbers of each model by both protocols: means over the test sequences."""
    columns = (*FURTHER, *HEADINGS)
    rows = []
    for protocol in DISTANCE_FIRST:
        for model, group in by_model(study.results).items():
            cells = [
                number(mean(group, protocol, column.number), column.digits) for column in columns
            ]
            rows.append((model, protocol, *cells))
    return table("means", ("mean", "by", *headings_of(columns)), rows, text_columns=2)


def everything(study: Study, protocol: str) -> Table:
    """All numbers of each sequence and model by one protocol."""
    rows = [
        (name, result.model, *plain_cells(result, EVERYTHING, protocol))
        for name, group in by_sequence(study.results).items()
        for result in group
    ]
    header = ("sequence", "model", *headings_of(EVERYTHING))
    return table("everything", header, rows, text_columns=2, protocol=protocol)


def headings(study: Study) -> Table | None:
    """Errors of the headings by both protocols; None if no model gives a heading.

    There is one row per model and sequence, and one of a model's mean over several.
    """
    rows = []
    for model, group in by_model(study.results).items():
        if not any(np.isfinite(result.evaluation.heading_error_deg).any() for result in group):
            continue
        for result in group:
            row: list[Cell | str] = [model, result.sequence]
            for protocol in DISTANCE_FIRST:
                row += bounded_cells(result, HEADINGS, protocol)
            rows.append(row)
        if len(group) > 1:
            row = [model, "mean"]
            for protocol in DISTANCE_FIRST:
                row += mean_cells(group, HEADINGS, protocol)
            rows.append(row)
    header = ["model", "sequence"]
    for protocol in DISTANCE_FIRST:
        header += [f"{heading}, by {protocol}" for heading in headings_of(HEADINGS)]
    return table("headings", header, rows, text_columns=2) if rows else None


def novelties(study: Study, protocol: str) -> Table:
    """How each kind of novelty rejects by one protocol: means, and the sequence of worst AUROC."""
    rows = []
    for model, group in by_model(study.results).items():
        judgements = [result.evaluation.protocol(protocol) for result in group]
        # (sequence, kind of novelty, measure); the last axis of `rejection` is value, low and high
        values = np.stack([judgement.rejection[:, :, 0] for judgement in judgements])
        evaluation = group[0].evaluation
        for i, novelty in enumerate(evaluation.kinds):
            is_in_use = i == 0
            rows.append(
                (
                    model,
                    f"{novelty}, in use" if is_in_use else novelty,
                    *(number(average(of_measure), 3) for of_measure in values[:, i].T),
                    kept_precision(evaluation.kept_precision[i], group[0].wanted_precision),
                    _worst_day(group, values[:, i, MEASURES.index("auroc")]),
                )
            )
    header = ("model", "novelty", *NOVELTY_HEADINGS)
    return table("novelties", header, rows, text_columns=2, protocol=protocol)


def _worst_day(group: Sequence[Result], auroc: NDArray[np.floating]) -> Cell:
    """A cell with the lowest AUROC (sequence,) of a model's results, and its day."""
    worst = int(np.nan_to_num(auroc, nan=np.inf).argmin())
    is_known = np.isfinite(auroc[worst])
    worst_day = f"on {day(group[worst].sequence)}" if is_known else ""
    return replace(number(auroc[worst], 3), small=worst_day)


def paired(study: Study, protocol: str) -> list[Table]:
    """Every model against a reference: differences with intervals, p, and who alone was right.

    Models with poses have a table of their own if their reference has poses too.
    """
    tested = against(study.rows, protocol)
    return [
        _paired(group, protocol, reference) for reference, group in tested.groupby("of", sort=False)
    ]


def _paired(tested: pd.DataFrame, protocol: str, reference: str) -> Table:
    rows = []
    for (model, sequence), group in tested.groupby(["model", "sequence"], sort=False):
        values = indexed(group, "number")
        row: list[Cell | str] = [model, sequence]
        for name in COMPARED:
            change, *interval = values[f"{name}_difference"]
            p, *_ = values[f"{name}_difference_p"]
            row += [difference(change, 3, interval), number(p, 3), _verdict(change, p)]
        for side in ("this", "reference"):
            right_alone, *_ = values[f"only_{side}_right"]
            row.append(count(right_alone))
        rows.append(row)
    header = ["model", "sequence"]
    for name in COMPARED:
        header += [f"Δ {TITLES[name]}", "p", "verdict"]
    header += ["only it right", f"only {reference} right"]
    unlike = any(map(is_posed, tested["model"])) and not is_posed(reference)
    caption: Any = {"protocol": protocol, "reference": reference, "unlike": unlike}
    return table("paired", header, rows, text_columns=2, **caption)


def _verdict(change: float, p: float) -> str:
    """Whether a model is `better` or `worse` than the reference; `undecided` for a p of NaN."""
    if not p < LEVEL:
        return "undecided"
    return "better" if change > 0 else "worse"


def ageing(rows: pd.DataFrame, protocol: str, name: str, title: str) -> Table:
    """The line fitted to one number over the days: one row per model, and one for the oracle."""
    lines = pick(rows, protocol=protocol)
    digits = 1 if name == PERCENTILE else 3
    per = f"per_{PER_DAYS}_days"
    table_rows = []
    for model in lines.loc[lines["number"] == f"{name}_line", "method"].unique():
        fitted = indexed(pick(lines, method=model), "number")
        first_day, *_ = fitted.get(f"{name}_day_0", NONE)
        slope, *interval = fitted.get(f"{name}_{per}", NONE)
        theil_sen_slope, *_ = fitted.get(f"{name}_theil_sen_{per}", NONE)
        p, *_ = fitted.get(f"{name}_slope_p", NONE)
        retrain_after, *retrain_interval = fitted.get(f"{name}_retrain_after_days", NONE)
        if model == ORACLE:  # it is not trained
            retrain_after = np.nan
        table_rows.append(
            (
                model,
                number(first_day, digits),
                difference(slope, digits, interval),
                difference(theil_sen_slope, digits),
                number(p, 3),
                number(retrain_after, 0, retrain_interval),
            )
        )
    columns = ("on day 0", f"per {PER_DAYS} days", "Theil–Sen", "p", "train again after [days]")
    return table("ageing", ("model", *columns), table_rows, title=title, per=PER_DAYS)
