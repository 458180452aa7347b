"""The results in a few lines: each method on the first and last day, and what it accepts."""

from collections.abc import Mapping, Sequence
from io import StringIO

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pipeline.evaluation.doubts import VOID
from pipeline.report.result import day
from pipeline.report.sections.lifelong_numbers import (
    PROTOCOL,
    by_order,
    by_strategy,
    read_strategies,
)
from pipeline.report.summary import Row, Summary
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
                _print(console, study, grid, Summary.of(rows, study), row_limit)
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
    lines = Table("", box=None, pad_edge=False, expand=True, padding=(0, 2, 0, 0))
    lines.columns[0].ratio = 1
    lines.columns[0].no_wrap = True
    for order in orders:
        for heading in (f"{order}:\nof all", "for-\ngetting")[: len(numbers)]:
            lines.add_column(Text(heading), justify="right", no_wrap=True)
    shown_count = min(row_limit, SHORT)
    for (model, strategy), numbers_in in [*by_model_and_strategy.items()][:shown_count]:
        cells = [
            average(numbers_in[order].last(key, PROTOCOL)) if order in numbers_in else np.nan
            for order in orders
            for key in numbers
        ]
        lines.add_row(Text(f"{model} {strategy}"), *(fixed(cell, 3) for cell in cells))
    console.print(lines)
    left = len(by_model_and_strategy) - shown_count
    return console.print(f"  … and {left} more\n" if left > 0 else "")


def _print(
    console: Console, study: Study, grid: CellSize, summary: Summary, row_limit: int
) -> None:
    """One study at one cell size."""
    name = f"{study.name}, {'simulated' if study.simulated else 'recorded'}"
    if not summary.rows:
        return console.print(
            f"{name}: judged by viewpoints alone; `yearloc results --full`\n",
            overflow="ellipsis",
            no_wrap=True,
        )
    days = "1 test day" if len(summary.tests) == 1 else f"{len(summary.tests)} test days"
    title = f"{name}: learned {day(study.train[0])}, {days}, cells of {grid.cell_m:g} m"
    console.print(title, overflow="ellipsis", no_wrap=True)
    ends = [0, -1] if len(summary.tests) > 1 else [0]
    heads = [
        f"{'' if n else f'within {summary.within_m:g} m'}\n{day(summary.tests[test])}"
        for n, test in enumerate(ends)
    ]
    heads += ["\naccepted", "wrong\nof those", "wrong ones\nrefused"] * (console.width >= NARROWEST)
    heads += ["ms a\nquery"] * (console.width >= NARROW and summary.is_timed)
    lines = Table("", box=None, pad_edge=False, expand=True, padding=(0, 2, 0, 0))
    lines.columns[0].ratio = 1
    lines.columns[0].no_wrap = True
    for head in heads:
        lines.add_column(Text(head), justify="right", no_wrap=True)
    rows = _one_a_method(summary.rows)
    for row in rows[:row_limit]:
        lines.add_row(Text(row.model), *_cells(row, ends)[: len(heads)])
    console.print(lines)
    left = len(rows) - row_limit
    console.print(f"  … and {left} more\n" if left > 0 else "")
    return None


def _one_a_method(rows: Sequence[Row]) -> list[Row]:
    """The row of each method's model that has poses, or else of its best one; the best first."""
    posed_first = sorted(rows, key=lambda row: not row.posed)
    chosen = {method_of(row.model): row for row in reversed(posed_first)}
    return [row for row in rows if row in chosen.values()]


def _cells(row: Row, ends: Sequence[int]) -> list[str]:
    right = [VOID if row.void[test] else fixed(row.right[test], 3) for test in ends]
    ms = MISSING if np.isnan(row.query_ms) else fixed(row.query_ms, 0 if row.query_ms >= 10 else 1)
    wrong = row.accepted_wrong + row.refused_wrong
    refused = MISSING if not wrong > 0 else f"{row.refused_wrong:.0f} of {wrong:.0f}"
    return [*right, fixed(row.accepted, 0), fixed(row.accepted_wrong, 0), refused, ms]
