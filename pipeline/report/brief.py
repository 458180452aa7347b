"""The results in a few lines: each method on the first and last day, and what it accepts.

In: the table of results. Out: at most 30 lines of text, which `yearloc results` prints and the
README quotes.
"""

from collections.abc import Mapping, Sequence
from io import StringIO
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pipeline.core.precisions import JUDGED_PRECISION, shown
from pipeline.evaluation.caveats import DEGENERATE
from pipeline.evaluation.numbers import average
from pipeline.evaluation.rows import pick
from pipeline.report.result import Scores, day, grouped, ranked, read_scores
from pipeline.report.strategies import PROTOCOL, read_strategies
from pipeline.report.table import MISSING, fixed
from pipeline.studies.colours import method_of
from pipeline.studies.study import CellSize, Study

LINES = 30  # of all studies together; the last one says where all numbers are
WIDEST = 78  # columns of a line
OTHER_LINES = 5  # lines of a study besides those of its methods
MOST_STRATEGY_LINES = 7  # of a study of learning further days
BETWEEN = 2  # blanks between two columns
# Above the rows of models with poses and of those without, where a study has both
WITH_POSES = "with poses"
WITHOUT_POSES = "without poses"
# A terminal of fewer columns than these lacks the columns that matter less.
NARROW = 72
NARROWEST = 64


def brief(table: pd.DataFrame, studies: Mapping[str, Study], width: int) -> str:
    """A few lines on each study of a table of results, recorded studies first.

    There are at most LINES lines, as wide as `width` or WIDEST columns, whichever is less.
    """
    pairs = [(study, grid) for study in studies.values() for grid in study.grids]
    row_limit = max((LINES - 1) // max(len(pairs), 1) - OTHER_LINES, 2)
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
        rows = pick(table, study=study.name, grid=grid.name)
        summarize = _learning if study.learns_further_days else _year
        summary = summarize(study, grid, rows, console.width)
        data = "simulated" if study.simulated else "recorded"
        title = f"{study.name}, {data}: {summary.title}"
        console.print(title, overflow="ellipsis", no_wrap=True)
        if summary.heads:
            most_rows = (
                min(row_limit, MOST_STRATEGY_LINES) if study.learns_further_days else row_limit
            )
            _print_table(console, summary, most_rows)
    return "\n".join(line.rstrip() for line in file.getvalue().splitlines())


class Summary(NamedTuple):
    """One study at one cell size."""

    title: str
    heads: Sequence[str] = ()  # of the columns of numbers
    rows: Sequence[Sequence[str]] = ()  # a name and numbers each


def _learning(study: Study, grid: CellSize, rows: pd.DataFrame, width: int) -> Summary:
    """Summarise a study of learning further days: recall and forgetting after the last step.

    There is one row per model and strategy, with columns for each order of days; entries are means
    over the seeds.
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
            line = [f"{model} {name}"]
            for order, number in product(orders, numbers):
                has_number = order in by_order
                mean = average(by_order[order].last(number, PROTOCOL)) if has_number else np.nan
                line.append(fixed(mean, 3))
            lines.append(line)
    correct_m = pick(rows, number="correct_m")["value"].max()
    title = f"learned further days, cells of {grid.cell_m:g} m, right within {correct_m:g} m"
    heads = [head.format(order) for order in orders for head in numbers.values()]
    return Summary(title, heads, lines)


def _year(study: Study, grid: CellSize, rows: pd.DataFrame, width: int) -> Summary:
    """Summarise a study of the year: each method's best row with poses, and its best without.

    The two kinds stand apart, each best first. Where every method has poses, rows without are left
    out.
    """
    scores = read_scores(rows, study.tests)
    if not scores:
        return Summary("judged by viewpoints alone; `yearloc results --full`\n")
    models = ranked(scores)
    first, *later = tests = next(iter(models.values()))
    days = f"{len(tests)} test days" if later else "1 test day"
    within = f"within {first.number('distance', 'correct_m'):g} m"
    is_timed = any(np.isfinite(score.number("", "query_ms")) for score in scores)
    heads = [f"{within}\n{day(first.sequence)}"]
    if later:
        heads.append(f"\n{day(tests[-1].sequence)}")
    if width >= NARROWEST:
        heads += ["\naccepted", "wrong\nof those", "wrong ones\nrefused"]
    if width >= NARROW and is_timed:
        heads.append("ms a\nquery")
    posed = _best_of_methods(models, posed=True)
    unposed = _best_of_methods(models, posed=False)
    if len(posed) == len({method_of(model) for model in models}):
        unposed = []
    lines = []
    for kind, names in ((WITH_POSES, posed), (WITHOUT_POSES, unposed)):
        lines += [[kind]] if posed and unposed else []
        # cells without a heading are those that the terminal has no room for
        lines += [[name, *_cells(models[name])[: len(heads)]] for name in names]
    title = f"learned {day(study.train[0])}, {days}, cells of {grid.cell_m:g} m"
    return Summary(title, heads, lines)


def _best_of_methods(models: Mapping[str, Sequence[Scores]], posed: bool) -> list[str]:
    """Of `models`, best first, the first one of each method with poses, or without."""
    best: dict[str, str] = {}
    for model, group in models.items():
        if group[0].posed == posed:
            best.setdefault(method_of(model), model)
    return list(best.values())


def _print_table(console: Console, summary: Summary, most_rows: int) -> None:
    """Print the first `most_rows` rows of a summary, and the number of further ones.

    The last columns are left out where they would cut a name short.
    """
    rows = summary.rows[:most_rows]
    heads = summary.heads[: _columns_that_fit(summary.heads, rows, console.width)]
    lines = Table(box=None, pad_edge=False, expand=True, padding=(0, BETWEEN, 0, 0))
    lines.add_column("", ratio=1, no_wrap=True)
    for head in heads:
        lines.add_column(Text(head), justify="right", no_wrap=True)
    for name, *cells in rows:
        lines.add_row(Text(name), *cells[: len(heads)])
    console.print(lines)
    further = sum(len(row) > 1 for row in summary.rows[most_rows:])
    console.print(f"  … and {further} more\n" if further > 0 else "")


def _columns_that_fit(heads: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> int:
    """How many columns of numbers fit beside whole names into `width` characters, 1 at least."""
    used = max((len(name) for name, *_ in rows), default=0)
    for column, head in enumerate(heads):
        texts = [*head.split("\n"), *(cells[column] for _, *cells in rows if column < len(cells))]
        used += BETWEEN + max(map(len, texts))
        if used > width:
            return max(column, 1)
    return len(heads)


def _cells(group: Sequence[Scores]) -> list[str]:
    """Texts of one model: recall on the first and last day, what is accepted, a query's time."""
    right = [
        DEGENERATE
        if score.degenerate("distance")
        else fixed(score.number("distance", "recall_at_1"), 3)
        for score in (group[0], *group[1:][-1:])
    ]
    accepted, accepted_wrong, refused_wrong = (
        sum(score.number("distance", name) for score in group)
        for name in ("accepted", "accepted_wrong", "refused_wrong")
    )
    wrong = accepted_wrong + refused_wrong
    refused = f"{refused_wrong:.0f} of {wrong:.0f}" if wrong > 0 else MISSING
    ms = group[-1].number("", "query_ms")
    counts = (fixed(accepted, 0) + _kept(group), fixed(accepted_wrong, 0), refused)
    return [*right, *counts, fixed(ms, 0 if ms >= 10 else 1)]


def _kept(group: Sequence[Scores]) -> str:
    """What stands beside the count of accepted poses if they do not keep JUDGED_PRECISION."""
    if any(score.keeps_nothing for score in group):
        return " (keeps none)"
    kept = [score.kept_precision for score in group if score.kept_precision is not None]
    return f" (at {shown(min(kept))})" if kept and min(kept) != JUDGED_PRECISION else ""
