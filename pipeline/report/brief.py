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
from pipeline.report.strategies import PROTOCOL, grouped, read_strategies
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
    pairs = [(study, grid) for study in studies.values() for grid in study.grids]
    row_limit = max((LINES - 1) // max(len(pairs), 1) - AROUND, 2)
    file = StringIO()
    console = Console(
        file=file,
        width=min(width, WIDEST),
        color_system=None,
        highlight=False,
        emoji=False,
        markup=False,
    )
    for study, grid in sorted(pairs, key=lambda pair: pair[0].simulated):
        rows = table[(table["study"] == study.name) & (table["grid"] == grid.name)]
        write = _learning if study.learns_further_days else _year
        title, heads, lines = write(study, grid, rows, console.width)
        name = f"{study.name}, {'simulated' if study.simulated else 'recorded'}: "
        console.print(name + title, overflow="ellipsis", no_wrap=True)
        if heads:
            most = min(row_limit, SHORT) if study.learns_further_days else row_limit
            _print_table(console, heads, lines, most)
    return "\n".join(line.rstrip() for line in file.getvalue().splitlines())


Lines = tuple[str, Sequence[str], Sequence[Sequence[str]]]
"""A title, the heads of the columns of numbers, and rows: a name and numbers."""


def _learning(study: Study, grid: CellSize, rows: pd.DataFrame, width: int) -> Lines:
    """One study of learning further days: recall and forgetting after the last step of each order.

    Entries are means over the seeds.
    """
    strategies = read_strategies(rows)
    orders = [*grouped(strategies, "order")]
    numbers = {"recall_of_all": "{}:\nof all", "forgetting": "for-\ngetting"}
    if width < NARROW:
        del numbers["forgetting"]
    lines = []
    for model, group in grouped(strategies, "model").items():
        for name, of_orders in grouped(group, "name").items():
            by_order = {strategy.order: strategy for strategy in of_orders}
            cells = [
                fixed(average(by_order[order].last(number, PROTOCOL)), 3)
                if order in by_order
                else MISSING
                for order in orders
                for number in numbers
            ]
            lines.append([f"{model} {name}", *cells])
    correct_m = rows.loc[rows["number"] == "correct_m", "value"].max()
    title = f"learned further days, cells of {grid.cell_m:g} m, right within {correct_m:g} m"
    return title, [head.format(order) for order in orders for head in numbers.values()], lines


def _year(study: Study, grid: CellSize, rows: pd.DataFrame, width: int) -> Lines:
    """One study at one cell size."""
    scores = read_scores(rows, study.tests)
    if not scores:
        return "judged by viewpoints alone; `yearloc results --full`\n", (), ()
    models = ranked(scores)
    first, *later = tests = next(iter(models.values()))
    days = f"{len(tests)} test days" if later else "1 test day"
    within = f"within {first.number('distance', 'correct_m'):g} m"
    heads = [f"{within}\n{day(first.sequence)}", *[f"\n{day(tests[-1].sequence)}"] * bool(later)]
    heads += ["\naccepted", "wrong\nof those", "wrong ones\nrefused"] * (width >= NARROWEST)
    timed = any(np.isfinite(score.number("", "query_ms")) for score in scores)
    heads += ["ms a\nquery"] * (width >= NARROW and timed)
    # of each method the model that has poses, or else its best one
    posed_first = sorted(models, key=lambda model: not models[model][0].posed)
    chosen = {method_of(model): model for model in reversed(posed_first)}.values()
    lines = [[model, *_cells(models[model])[: len(heads)]] for model in models if model in chosen]
    return (
        f"learned {day(study.train[0])}, {days}, cells of {grid.cell_m:g} m",
        heads,
        lines,
    )


def _print_table(
    console: Console, heads: Sequence[str], rows: Sequence[Sequence[str]], most: int
) -> None:
    """Print at most so many rows, a name and numbers each, and how many are left."""
    lines = Table(box=None, pad_edge=False, expand=True, padding=(0, 2, 0, 0))
    lines.add_column("", ratio=1, no_wrap=True)
    for head in heads:
        lines.add_column(Text(head), justify="right", no_wrap=True)
    for name, *cells in rows[:most]:
        lines.add_row(Text(name), *cells)
    console.print(lines)
    left = len(rows) - most
    console.print(f"  … and {left} more\n" if left > 0 else "")


def _cells(group: Sequence[Scores]) -> list[str]:
    right = [
        VOID if score.void("distance") else fixed(score.number("distance", "recall_at_1"), 3)
        for score in (group[0], *group[1:][-1:])
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
