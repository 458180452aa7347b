"""Tables: what a number looks like, what a column is sorted by, and how wide a table may be."""

import numpy as np
import pytest

from pipeline.report.table import (
    MISSING,
    WIDEST,
    Cell,
    Table,
    bracket,
    count,
    difference,
    fixed,
    number,
    short,
    signed,
    spread,
)
from pipeline.report.table import table as of_rows


@pytest.mark.parametrize(
    ("interval", "digits", "text"),
    [
        ((-0.02, 0.01), 3, "[−.02, .01]"),  # once printed as 0.02
        ((0.761, 0.834), 3, "[.76, .83]"),
        ((0.0, 1.0), 3, "[.00, 1.0]"),
        ((0.9949, 0.9951), 3, "[.99, 1.0]"),  # and not 1.00
        ((-1.0, -0.999), 3, "[−1.00, −1.00]"),
        ((2.06, 13.44), 1, "[2.1, 13.4]"),
        ((40.0, 150.0), 0, "[40, 150]"),
        ((np.nan, np.nan), 3, ""),
        (None, 3, ""),
    ],
)
def test_an_interval_is_short(interval: tuple[float, float] | None, digits: int, text: str) -> None:
    assert bracket(interval, digits) == text


def test_numbers_have_a_true_minus_and_a_dash_where_there_is_none() -> None:
    assert [short(value, 2) for value in (-0.02, 0.025, 0.0, 1.25, -1.5)] == [
        "−.02",
        ".03",
        ".00",
        "1.25",
        "−1.50",
    ]
    assert [signed(value, 3) for value in (0.0312, -0.12, -1e-9, np.nan)] == [
        "+0.031",
        "−0.120",
        "+0.000",
        MISSING,
    ]
    assert fixed(-1e-9, 3) == "0.000"
    assert str(number(-0.5, 3, (-0.6, -0.4), "−")) == "−0.500 [−.60, −.40] −"
    assert str(difference(-0.12, 3, (-0.2, 0.01))) == "−0.120 [−0.200, +0.010]"
    assert str(difference(0.1, 3, (np.nan, np.nan))) == "+0.100"
    assert {
        str(one) for one in (number(np.nan, 3), difference(np.nan, 3), spread([np.nan], 3))
    } == {MISSING}
    assert str(count(7.0)) == "7"
    assert str(spread([0.7, 0.8, np.nan, 0.9], 3)) == "0.800 ± .100"
    assert str(spread([0.7], 3)) == "0.700"


def test_a_column_is_sorted_by_numbers_and_not_by_their_text() -> None:
    cells = (
        number(0.31249, 3),
        difference(-2.0, 1),
        spread([1.0, 3.0], 1),
        count(12),
        Cell("sci"),
        number(np.nan, 3),
    )
    assert [cell.key for cell in cells] == [0.31249, -2.0, 2.0, 12.0, None, None]


def table(columns: int = 2) -> Table:
    start = {"sci": 0.5, "m2dp": 0.25}
    rows = [
        (name, *(number(value + i, 3, (0, 1)) for i in range(columns - 1)))
        for name, value in start.items()
    ]
    return of_rows("auc", ("model", *(f"AUC {i}" for i in range(columns - 1))), rows)


def test_markdown_can_be_read_as_it_stands() -> None:
    assert table().markdown() == (
        "| model |            AUC 0 |\n| :---- | ---------------: |\n| sci   | 0.500 [.00, 1.0] "
        "|\n| m2dp  | 0.250 [.00, 1.0] |\n"
    )
    assert (
        Table("auc", ("n", "p"), ((Cell("1"), Cell("2")),)).markdown()
        == "| n   |   p |\n| :-- | --: |\n| 1   |   2 |\n"
    )


def test_a_table_that_is_too_wide_for_a_terminal_goes_on_below_with_its_words() -> None:
    assert table().text() == (
        "model             AUC 0\n─────  ────────────────\nsci    0.500 [.00, 1.0]\nm2dp   0.250 "
        "[.00, 1.0]\n"
    )
    first, second = (part.splitlines() for part in table(14).text().split("\n\n"))
    assert (len(first), len(second)) == (4, 4)
    assert max(map(len, (*first, *second))) <= WIDEST
    assert [line.split()[0] for line in second] == ["model", "─────", "sci", "m2dp"]
    assert (first[0].split()[-1], second[0].split()[2], second[0].split()[-1]) == ("7", "8", "12")
