"""The results in a few lines: how often each method is right on the first and last day, and how often it dares to answer."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from pipeline.evaluation.doubts import VOID
from pipeline.report.result import day
from pipeline.report.table import MISSING
from pipeline.studies.expansion import TOLERANCE

LINES, WIDEST = 30, 78
WIDTHS, LEAST_NAME = (0, 11, 11, 12, 10, 12), 20
AROUND = 4
"""Lines of a study besides its methods; the last line of all says where the rest is."""
NUMBERS = ("recall_at_1", "answered", "precision_at_threshold", "query_ms", VOID)


def brief(table: pd.DataFrame, studies: Mapping[str, Mapping[str, Any]], width: int) -> str:
    """At most LINES lines of at most `width` columns, WIDEST if that is more, for the studies whose table of results this is."""
    own = table[(table["change"] == "") & (table["kind"] == "") & (table["stress"] == "") & (table["seed"] == 0)]
    own = own[own["number"].isin(NUMBERS) & own["protocol"].isin(("distance", ""))]
    each = [(name, grid) for name, study in studies.items() for grid in study["grids"]]
    most = max((LINES - 1) // max(len(each), 1) - AROUND, 3)
    width = min(width, WIDEST)
    lines: list[str] = []
    for name, grid in each:
        lines += _study(name, own[(own["study"] == name) & (own["grid"] == grid)], studies[name], most, width)
    return "\n".join(lines)


def _study(name: str, own: pd.DataFrame, study: Mapping[str, Any], most: int, width: int) -> list[str]:
    """The lines of one study at one cell size."""
    name += ", simulated" if study["source"] == "world" else ", recorded"
    driven = own[own["sequence"] != ""]
    if driven.empty:
        return [f"{name}: judged by viewpoints alone; `yearloc results --full`"[:width], ""]
    days = [one for one in driven.sort_values("days")["sequence"].unique() if one in study["tests"]]
    first, last = days[0], days[-1]
    values = driven.set_index(["method", "variant", "number", "sequence"])["value"].to_dict()
    cost = own[own["number"] == "query_ms"].set_index(["method", "variant"])["value"].to_dict()
    rows = []
    for method, variant in driven[["method", "variant"]].drop_duplicates().itertuples(index=False):
        of = {number: [values.get((method, variant, number, when), np.nan) for when in (first, last)] for number in NUMBERS}
        right = [_share(value) if np.isnan(dead) else VOID for value, dead in zip(of["recall_at_1"], of[VOID], strict=True)]
        dares = [_share(of[number][1]) for number in ("answered", "precision_at_threshold")]
        ms = cost.get((method, variant), np.nan)
        told = MISSING if np.isnan(ms) else f"{ms:.0f}" if ms >= 10 else f"{ms:.1f}"
        rows.append((of["recall_at_1"][1], ("-".join(filter(None, (method, variant))), *right, *dares, told)))
    rows.sort(key=lambda row: -row[0])
    heads = ("", day(first), day(last), "answers", "right", "ms a query")
    shown = next(count for count in (6, 5, 3) if width - sum(WIDTHS[1:count]) >= LEAST_NAME or count == 3)
    widths = [width - sum(WIDTHS[1:shown]), *WIDTHS[1:shown]]
    cells = f"cells of {own['grid'].iloc[0].removesuffix('m')} m"
    title = f"{name}: learned {day(study['train'].split()[0])}, {len(days)} test days, {cells}"
    within = f"right within {study.get('tolerance', TOLERANCE).removesuffix('m')} m"
    over = within.rjust(sum(widths[:3])) + ("at its own threshold".rjust(sum(WIDTHS[3:5])) if shown > 3 else "")
    found = [title[:width], over, _row(heads, widths)]
    found += [_row(values, widths) for _, values in rows[:most]]
    return [*found, f"  … and {len(rows) - most} more" if len(rows) > most else ""]


def _share(value: float) -> str:
    return MISSING if np.isnan(value) else f"{value:.3f}"


def _row(cells: Sequence[str], widths: Sequence[int]) -> str:
    name, *others = cells
    name = name if len(name) <= widths[0] else name[: widths[0] - 1] + "…"
    return (name.ljust(widths[0]) + "".join(cell.rjust(width) for cell, width in zip(others, widths[1:], strict=False))).rstrip()
