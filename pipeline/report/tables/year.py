"""The main tables of a study of the year: one number of each model over the test days."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from pipeline.evaluation.doubts import VOID
from pipeline.evaluation.paired import LEVEL
from pipeline.report.result import TITLES, Scores, by_model, by_sequence, dates
from pipeline.report.selection import indexed, is_posed
from pipeline.report.study import Study, against
from pipeline.report.table import Cell, Table, kept_precision, number, spread, table
from pipeline.report.tables.columns import Column, bounded, headings_of, plain_cells


class MainNumber(NamedTuple):
    """What `main_number` shows beside one of the numbers that a study is about."""

    oracle: Column  # of the oracle, which answers every query with its nearest training pose
    tested: str  # the number whose paired test decides the marks + and −


# The numbers that a study is about. The paired test has the exact area only, which differs little
# from the SCI paper's AUC.
MAIN_NUMBERS = {
    "recall_at_1": MainNumber(Column("oracle", "oracle", 3), "recall_at_1"),
    "auc_top1": MainNumber(Column("oracle, exact", "oracle_auc_exact_top1", 3), "auc_exact_top1"),
}
# The columns of the last test day in `scorecard`: how many queries are answered, and rightly.
ANSWERED = (
    Column("answers", "answered", 3),
    Column("right of those", "precision_at_threshold", 3),
)
# The columns of `believed`: what the verdict accepted, and what it got wrong.
BELIEVED = (
    Column("believed", "accepted", 0),
    Column("wrong", "accepted_wrong", 0),
    Column("wrong refused", "refused_wrong", 0),
)


def scorecard(scores: Sequence[Scores]) -> Table:
    """Recall@1 by distance: one row per model, one column per test day, and more of the last day.

    The last columns are the share answered, the share of those right, the precision that the
    threshold kept on held-out blocks, and the time of a query where any was measured.
    """
    recall = over_days("scorecard", scores, "distance", "recall_at_1", shows_void=True)
    is_timed = any(np.isfinite(score.number("", "query_ms")) for score in scores)
    rows = []
    for recall_cells, group in zip(recall.rows, by_model(scores).values(), strict=True):
        last = group[-1]
        answered_cells = plain_cells(last, ANSWERED, "distance")
        row = [*recall_cells, *answered_cells, kept_precision(last.kept, last.wanted_precision)]
        if is_timed:
            row.append(number(last.number("", "query_ms"), 1))
        rows.append(row)
    header = [*recall.header, *headings_of(ANSWERED), "keeps"]
    if is_timed:
        header.append("ms a query")
    return table("scorecard", header, rows, last_day=recall.header[-1])


def over_days(
    table_kind: str,
    scores: Sequence[Scores],
    protocol: str,
    name: str,
    *,
    shows_void: bool = False,
) -> Table:
    """One number by one protocol: one row per model, one column per test day, with intervals.

    Each cell says which result it is of, so that the page's map can show it. If `shows_void`, a
    cell says "void" where the numbers of that day mean nothing.
    """
    rows = []
    for model, group in by_model(scores).items():
        row: list[Cell | str] = [model]
        for score in group:
            cell = bounded(score.values(protocol, name), 3)
            if shows_void and score.void(protocol):
                cell = Cell(VOID)
            row.append(replace(cell, result=(score.model, score.sequence)))
        rows.append(row)
    return table(table_kind, ("method", *dates(scores).values()), rows)


def believed(scores: Sequence[Scores]) -> Table:
    """How many answers of a model were believed on each day, and what the verdict got wrong."""
    days = dates(scores)
    rows = []
    for score in scores:
        date = Cell(days[score.sequence], result=(score.model, score.sequence))
        rows.append((date, *plain_cells(score, BELIEVED, "distance")))
    return table("believed", ("day", *headings_of(BELIEVED)), rows)


def main_number(study: Study, protocol: str, name: str) -> Table:
    """One of MAIN_NUMBERS: one row per model, one column per test day, the oracle last.

    Cells have 95 % intervals, and a mark where the paired test against the study's first method is
    clear. A mean over several days follows.
    """
    oracle, tested = MAIN_NUMBERS[name]
    days = dates(study.results)
    marks, references = _marks(study, protocol, tested)
    groups = by_model(study.results)
    rows: list[list[Cell | str]] = []
    for model in study.ranked:
        row: list[Cell | str] = [model]
        for result in groups[model]:
            mark = marks.get((model, result.sequence), "")
            cell = bounded(result.values(protocol, name), 3, mark)
            row.append(Cell(VOID) if result.void(protocol) else cell)
        rows.append(row)
    first_of_day = [group[0] for group in by_sequence(study.results).values()]
    oracle_shares = [result.number(protocol, oracle.number) for result in first_of_day]
    rows.append([oracle.heading, *(number(share, 3) for share in oracle_shares)])
    header = [TITLES[name], *days.values()]
    if len(days) > 1:
        header.append("mean")
        shares = [[r.number(protocol, name) for r in groups[model]] for model in study.ranked]
        for row, shares_of_days in zip(rows, [*shares, oracle_shares], strict=True):
            row.append(spread(shares_of_days, 3))
    caption: Any = {"protocol": protocol, "references": references, "marked": bool(marks)}
    return table(f"main_{name}", header, rows, has_footer=True, **caption)


def _marks(
    study: Study, protocol: str, name: str
) -> tuple[dict[tuple[str, str], str], dict[str, bool]]:
    """Map model and sequence to `+` or `−` where the paired test of a number is clear.

    Returns also the references, with whether models with poses are compared with one without.
    """
    rows = against(study.rows, protocol)
    tested = indexed(rows, "number", "model", "sequence")
    references: dict[str, bool] = {}
    for model, reference in rows[["model", "of"]].drop_duplicates().itertuples(index=False):
        unlike = is_posed(model) and not is_posed(reference)
        references[reference] = references.get(reference, False) or unlike
    marks = {}
    for (number_name, model, sequence), (difference, *_) in tested.items():
        if number_name != f"{name}_difference":
            continue
        p, *_ = tested[f"{number_name}_p", model, sequence]
        if p < LEVEL:
            marks[model, sequence] = "+" if difference > 0 else "−"
    return marks, references
