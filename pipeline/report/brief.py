"""The results in a few lines: each method on the first and last day, and what it accepts."""

from collections.abc import Mapping, Sequence
from io import StringIO

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pipeline.evaluation.doubts import VOID
from pipeline.report.result import Scores, day, ranked, read_scores
from pipeline.report.strategies import (
    PROTOCOL,
    by_order,
    by_strategy,
    read_strategies,
)
from pipeline.report.table import MISSING, average, fixed
from pipeline.studies.colours import method_of
from pipeline.studies.study import CellSize, Study

LINES = 30
WIDEST = 78
AROUND = 5
"""Lines of a study besides its methods; the last line of all says where the rest is."""
SHORT = 7  # strategies of a study of learning further days
NARROW = 72
NARROWEST = 64
"""Below these widths the columns that matter less are left out."""


def brief(table: pd.DataFrame, studies: Mapping[str, Study], width: int) -> str:
    """A few lines on each study of a table of results, recorded studies first.

    At most LINES lines of at most `width` columns (WIDEST if that is less).
    """
    study_grids = [(study, grid) for study in studies.values() for grid in study.grids]
    study_grids.sort(key=lambda pair: pair[0].simulated)
    row_limit = max((LINES - 1) // max(len(study_grids), 1) - AROUND, 2)
    with StringIO() as file:
        console = Console(
            file=file,
            width=min(width, WIDEST),
            color_system=None,
            highlight=False,
            emoji=False,
            markup=False,
        )
        for study, grid in study_grids:
            rows = table[(table["study"] == study.name) & (table["grid"] == grid.name)]
            if study.learns_further_days:
                _print_learning(console, study, grid, rows, row_limit)
            else:
                _print(console, study, grid, read_scores(rows, study.tests), row_limit)
        return "\n".join(line.rstrip() for line in file.getvalue().splitlines())


def _print_learning(
    console: Console, study: Study, grid: CellSize, rows: pd.DataFrame, row_limit: int
) -> None:
    """One study of learning further days: recall and forgetting after the last step of each order.

    Entries are means over the seeds.
    """
    strategies = read_strategies(rows)
    orders = by_order(strategies)
    by_model_and_strategy = by_strategy(strategies)
    numbers = ("recall_of_all", "forgetting")[: 1 if console.width < NARROW else 2]
    name = f"{study.name}, {'simulated' if study.simulated else 'recorded'}"
    correct_m = rows.loc[rows["number"] == "correct_m", "value"].max()
    title = (
        f"{name}: learned further days, cells of {grid.cell_m:g} m, right within {correct_m:g} m"
    )
    console.print(title, overflow="ellipsis", no_wrap=True)
    heads = [
        head for order in orders for head in (f"{order}:\nof all", "for-\ngetting")[: len(numbers)]
    ]
    rows = []
    for (model, strategy), numbers_in in by_model_and_strategy.items():
        cells = [
            average(numbers_in[order].last(key, PROTOCOL)) if order in numbers_in else np.nan
            for order in orders
            for key in numbers
        ]
        rows.append([f"{model} {strategy}", *(fixed(cell, 3) for cell in cells)])
    _print_table(console, heads, rows, min(row_limit, SHORT))


def _print(
    console: Console, study: Study, grid: CellSize, scores: Sequence[Scores], row_limit: int
) -> None:
    """One study at one cell size."""
    name = f"{study.name}, {'simulated' if study.simulated else 'recorded'}"
    if not scores:
        return console.print(
            f"{name}: judged by viewpoints alone; `yearloc results --full`\n",
            overflow="ellipsis",
            no_wrap=True,
        )
    models = ranked(scores)
    first, *later = tests = next(iter(models.values()))
    days = "1 test day" if not later else f"{len(tests)} test days"
    title = f"{name}: learned {day(study.train[0])}, {days}, cells of {grid.cell_m:g} m"
    console.print(title, overflow="ellipsis", no_wrap=True)
    within = f"within {first.number('distance', 'correct_m'):g} m"
    heads = [f"{within}\n{day(first.sequence)}", *[f"\n{day(tests[-1].sequence)}"] * bool(later)]
    heads += ["\naccepted", "wrong\nof those", "wrong ones\nrefused"] * (console.width >= NARROWEST)
    timed = any(np.isfinite(score.number("", "query_ms")) for score in scores)
    heads += ["ms a\nquery"] * (console.width >= NARROW and timed)
    rows = [[model, *_cells(group)[: len(heads)]] for model, group in _one_a_method(models).items()]
    _print_table(console, heads, rows, row_limit)
    return None


def _print_table(
    console: Console, heads: Sequence[str], rows: Sequence[Sequence[str]], most: int
) -> None:
    """Print at most so many rows, a name and numbers each, and how many are left."""
    lines = Table("", box=None, pad_edge=False, expand=True, padding=(0, 2, 0, 0))
    lines.columns[0].ratio = 1
    lines.columns[0].no_wrap = True
    for head in heads:
        lines.add_column(Text(head), justify="right", no_wrap=True)
    for name, *cells in rows[:most]:
        lines.add_row(Text(name), *cells)
    console.print(lines)
    left = len(rows) - most
    console.print(f"  … and {left} more\n" if left > 0 else "")


def _one_a_method(models: Mapping[str, Sequence[Scores]]) -> dict[str, Sequence[Scores]]:
    """The model of each method that has poses, or else its best one; the best first."""
    posed_first = sorted(models, key=lambda model: not models[model][0].posed)
    chosen = {method_of(model): model for model in reversed(posed_first)}
    return {model: group for model, group in models.items() if model in chosen.values()}


def _cells(group: Sequence[Scores]) -> list[str]:
    ends = [group[0], *group[1:][-1:]]
    right = [
        VOID if score.void("distance") else fixed(score.number("distance", "recall_at_1"), 3)
        for score in ends
    ]
    accepted, accepted_wrong, refused_wrong = (
        sum(score.number("distance", name) for score in group)
        for name in ("accepted", "accepted_wrong", "refused_wrong")
    )
    wrong = accepted_wrong + refused_wrong
    refused = f"{refused_wrong:.0f} of {wrong:.0f}" if wrong > 0 else MISSING
    ms = group[-1].number("", "query_ms")
    counts = (fixed(accepted, 0), fixed(accepted_wrong, 0), refused)
    return [*right, *counts, fixed(ms, 0 if ms >= 10 else 1)]
