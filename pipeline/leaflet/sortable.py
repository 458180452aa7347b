"""Tables of the page: a header sorts them, and each number leads to the artifact that it is from."""

import re
from collections.abc import Callable, Sequence

from pipeline.leaflet.markup import Html, inline, tag
from pipeline.reports.table import MISSING, Table

Where = Callable[[Sequence[str], str, int], str]
"""A row's cells, its column's heading and the column to the id of what the cell is from; empty for none."""
NUMBER = re.compile(r"([+−-]?\d[\d,]*\.?\d*)( ± [\d.]+)?( \[[^]]*\])?( +[+−])?\s*")
"""A number as `reports.table` writes it: its deviation, interval and mark are set smaller."""
MEAN = "mean"
"""A row of it stays below the sorted ones."""
DENSE = 7
"""Columns of numbers from which on intervals stand below their numbers."""
LONG = 40
"""Letters from which on a cell of words is given room."""


def sortable(table: Table, caption: str, where: Where) -> Html:
    """A table in a box of its own that scrolls where the page is too narrow."""
    heads = [
        tag("th", tag("button", heading, type="button"), scope="col", class_="words" if column < table.words else None)
        for column, heading in enumerate(table.header)
    ]
    rows = [(row, tag("tr", *_cells(table, row, where))) for row in table.rows]
    body = [shown for row, shown in rows if row[0] != MEAN]
    foot = [shown for row, shown in rows if row[0] == MEAN]
    parts = [tag("thead", tag("tr", *heads)), tag("tbody", *body), *([tag("tfoot", *foot)] if foot else [])]
    dense = " dense" if len(table.header) - table.words >= DENSE else ""
    shown = tag("table", *parts, class_=f"sortable{dense}", aria_label=caption)
    box = tag("div", shown, class_="scroll", tabindex="0", role="region", aria_label=caption)
    return tag("div", tag("p", inline(caption), class_="caption"), box, class_="tabled")


def _cells(table: Table, row: Sequence[str], where: Where) -> list[Html]:
    cells = []
    for column, (heading, cell) in enumerate(zip(table.header, row, strict=True)):
        target = where(row, heading, column) if cell.strip() != MISSING else ""
        shown = inline(cell) if column < table.words else _number(cell)
        if target:
            shown = tag("a", shown, href=f"#{target}")
        if column >= table.words:
            cells.append(tag("td", shown, data_key=key(cell)))
            continue
        kind = "words long" if len(cell) > LONG else "words"
        cells.append(tag("th" if column == 0 else "td", shown, scope="row" if column == 0 else None, class_=kind))
    return cells


def key(cell: str) -> str:
    """What a cell of numbers is sorted by: its first number; empty for none, which comes last either way."""
    found = NUMBER.match(cell.strip())
    return found[1].replace("−", "-").replace(",", "").replace("+", "") if found else ""


def _number(cell: str) -> Html:
    found = NUMBER.fullmatch(cell.strip())
    if not found:
        return inline(cell)
    value, *small, mark = found.groups()
    marks = [tag("b", mark.strip() if mark else "", class_="mark")] if mark or cell[-1].isspace() else []
    return tag("span", tag("span", value), *marks, *(tag("small", part.strip()) for part in small if part), class_="number")
