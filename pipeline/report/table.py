"""A table of a report: how numbers become cells, and cells markdown or plain text.

`number`, `count`, `difference` and `spread` make cells, `table` makes the table of rows of them. A
cell keeps the number itself, by which the page sorts its column.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.evaluation.numbers import average, deviation

MISSING = "–"
WIDEST = 160  # characters that a terminal shows in a line


@dataclass(frozen=True)
class Cell:
    """One entry of a table."""

    text: str
    key: float | None = None  # what the column is sorted by; None for a word or a missing number
    small: str = (
        ""  # beside the number: its interval or standard deviation, `[.76, .83]` or `± .025`
    )
    mark: str = ""  # `+` or `−`: clearly better or worse than the reference
    result: tuple[str, str] = ("", "")  # model and sequence, if the page's map can show them

    def __str__(self) -> str:
        return " ".join(part for part in (self.text, self.small, self.mark) if part)


@dataclass(frozen=True)
class Table:
    """A header and rows of cells.

    The first `text_columns` columns are text, flush left; the others are numbers, flush right.
    """

    kind: str  # the key of its caption in templates/words.yaml
    header: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    text_columns: int = 1
    values: Mapping[str, object] = field(default_factory=dict)  # what fills the caption
    has_footer: bool = False  # whether the last row stays below when the page sorts the others

    def markdown(self) -> str:
        """A GitHub table, padded so that it can be read as it stands."""
        header, *rows = self._padded(range(len(self.header)), min_width=3)
        rule = []
        for i, heading in enumerate(header):
            dashes = "-" * (len(heading) - 1)
            rule.append(f":{dashes}" if i < self.text_columns else f"{dashes}:")
        return "".join(f"| {' | '.join(cells)} |\n" for cells in (header, rule, *rows))

    def text(self) -> str:
        """Plain text for a terminal, two blanks between columns.

        A table that is too wide goes on below, with its columns of text repeated.
        """
        texts = []
        for columns in self._parts():
            header, *rows = self._padded(columns, min_width=1)
            rule = ["─" * len(cell) for cell in header]
            lines = ["  ".join(cells).rstrip() + "\n" for cells in (header, rule, *rows)]
            texts.append("".join(lines))
        return "\n".join(texts)

    def _parts(self) -> list[list[int]]:
        """The columns of each part that a terminal has room for, the columns of text first."""
        header, *_ = self._padded(range(len(self.header)), min_width=1)
        widths = [len(heading) + 2 for heading in header]  # with the two blanks that follow
        text_columns = list(range(self.text_columns))
        parts = [text_columns]
        for column in range(self.text_columns, len(widths)):
            is_full = sum(widths[c] for c in [*parts[-1], column]) > WIDEST + 2
            if is_full and parts[-1] != text_columns:
                parts.append(text_columns)
            parts[-1] = [*parts[-1], column]
        return parts

    def _padded(self, columns: Iterable[int], min_width: int) -> list[list[str]]:
        """Texts of the header and the rows in the chosen columns, padded to one width a column."""
        padded_columns = []
        for i in columns:
            texts = [self.header[i], *(str(row[i]) for row in self.rows)]
            width = max(min_width, *map(len, texts))
            is_text = i < self.text_columns
            padded_columns.append(
                [text.ljust(width) if is_text else text.rjust(width) for text in texts]
            )
        return [list(line) for line in zip(*padded_columns, strict=True)]


def table(
    kind: str,
    header: Iterable[str],
    rows: Iterable[Iterable[object]],
    /,
    text_columns: int = 1,
    has_footer: bool = False,
    **values: object,
) -> Table:
    """Build a table whose caption `values` fill; entries that are no Cell become cells of text."""
    cells = tuple(
        tuple(entry if isinstance(entry, Cell) else Cell(str(entry)) for entry in row)
        for row in rows
    )
    return Table(kind, tuple(header), cells, text_columns, values, has_footer)


def number(
    value: float, digits: int, interval: Sequence[float] | None = None, mark: str = ""
) -> Cell:
    """A cell with a number and its interval; a dash for NaN."""
    return (
        Cell(fixed(value, digits), float(value), bracket(interval, digits), mark)
        if np.isfinite(value)
        else Cell(MISSING)
    )


def validation_precision(precision: float, target: float) -> Cell:
    """A cell with the validation precision; `0.731 of 0.9` if it misses the target precision."""
    return replace(number(precision, 3), small=f"of {target:g}" if precision < target else "")


def count(value: float) -> Cell:
    """A cell with a whole number."""
    return number(value, 0)


def difference(value: float, digits: int, interval: Sequence[float] = (np.nan, np.nan)) -> Cell:
    """A cell with a signed difference and its interval: `+0.031 [−0.010, +0.080]`."""
    low, high = (signed(bound, digits) for bound in interval)
    small = f"[{low}, {high}]" if np.isfinite(interval[0]) else ""
    return Cell(signed(value, digits), float(value), small) if np.isfinite(value) else Cell(MISSING)


def spread(values: Iterable[float], digits: int) -> Cell:
    """A cell with mean and standard deviation of the finite numbers: `0.772 ± .025`.

    The number alone if there is one; a dash if there is none.
    """
    values = [*values]
    over = deviation(values)
    small = f"± {short(over, digits)}" if np.isfinite(over) else ""
    return replace(number(average(values), digits), small=small)


def fixed(value: float, digits: int, sign: str = "-") -> str:
    """A number with `digits` decimals and a true minus sign; a dash for NaN."""
    return f"{value:{sign}z.{digits}f}".replace("-", "−") if np.isfinite(value) else MISSING


def signed(value: float, digits: int) -> str:
    """A difference with its sign: `+0.031`, `−0.120`."""
    return fixed(value, digits, "+")


def short(value: float, digits: int) -> str:
    """A number whose two or more decimals have no 0 before their point: `.025`, `−.02`."""
    text = fixed(value, digits)
    is_fraction = abs(value) < 1 and text.lstrip("−").startswith("0.")
    return text.replace("0.", ".", 1) if digits > 1 and is_fraction else text


def bracket(interval: Sequence[float] | None, digits: int) -> str:
    """An interval: `[.76, .83]` of a share, `[2.1, 3.4]` of metres; empty where there is none."""
    if interval is None or not np.isfinite(interval[0]):
        return ""
    bounds = (
        "1.0" if digits > 1 and 0.995 < value <= 1 else short(value, min(digits, 2))
        for value in interval
    )
    return f"[{', '.join(bounds)}]"
