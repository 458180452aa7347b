"""Numbers over the days since training with a fitted line, and the slopes of those lines."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS
from pipeline.report.figures.panels import name_rows, points
from pipeline.report.figures.style import QUIET, VEIL, WIDTH_IN, figure, folded, styled, tints
from pipeline.report.table import signed

# a panel of slopes reaches so many times as far as the steepest slope; it cuts longer intervals
ROOM = 2.5


@dataclass(frozen=True, eq=False)
class AgeingLine:
    """One number of one model, or of the oracle, over the days since training.

    NaN where there is none.
    """

    model: str
    title: str  # of the number, and so of its column
    rises: bool  # with age, from 0 to 100; other numbers fall, from 1 to 0
    days: NDArray[np.float64]  # (sequence,) rising
    values: NDArray[np.float64]  # (sequence, 3) value and its 95 % interval
    fitted: NDArray[np.float64]  # (sequence, 3) value of the line on those days and its interval
    slope: NDArray[np.float64]  # (3,) change in PER_DAYS days and its interval

    @property
    def clear(self) -> bool:
        """Whether the interval of the slope does not contain 0."""
        return bool(self.slope[1] > 0 or self.slope[2] < 0)


@styled
def lines(rows: Sequence[AgeingLine]) -> Figure:
    """A row a model, a column a number: points and fitted line with their 95 % intervals.

    The slope is bold where it is clear.
    """
    models, columns = _grid(rows)
    shades = tints(model for model in models if model != ORACLE)
    fig = figure(WIDTH_IN, 0.75 + 0.88 * len(shades), f"Change per {PER_DAYS} days, of each model")
    axes = fig.subplots(len(shades), len(columns), squeeze=False, sharex=True, sharey="col")
    for column, (title, by_model) in zip(axes.T, columns.items(), strict=True):
        column[0].set_title(title.replace(", ", "\n", 1), pad=5)
        column[0].set_ylim(
            *((-4.0, 104.0) if any(row.rises for row in by_model.values()) else (0.0, 1.04))
        )
        for axis, (model, tint) in zip(column, shades.items(), strict=True):
            if oracle := by_model.get(ORACLE):
                axis.plot(oracle.days, oracle.fitted[:, 0], color="0.7", lw=0.8, zorder=2)
            if row := by_model.get(model):
                _panel(axis, row, tint)
            axis.grid(axis="y")
    for axis, (model, tint) in zip(axes[:, 0], shades.items(), strict=True):
        axis.set_ylabel(folded(model), color=tint, size=7.5)
    axes[0, 0].set_xlim(0, 1.04 * max([1.0, *(float(day) for row in rows for day in row.days)]))
    fig.supxlabel(
        "days since training; dots: test sequences; grey: the oracle; shade: 95 % interval of "
        "the line",
        size=8,
    )
    return fig


@styled
def slopes(rows: Sequence[AgeingLine]) -> Figure:
    """A panel a number, a row a model: the slope with its interval, filled where it is clear."""
    models, columns = _grid(rows)
    shades = tints(models) | ({ORACLE: QUIET} if ORACLE in models else {})
    fig = figure(WIDTH_IN, 0.95 + 0.21 * len(models), f"Change per {PER_DAYS} days since training")
    axes = fig.subplots(1, len(columns), squeeze=False, sharey=True)[0]
    for axis, (title, by_model) in zip(axes, columns.items(), strict=True):
        for model, row in by_model.items():
            y = models.index(model)
            tint = shades[model]
            (value, low, high) = row.slope
            axis.hlines(y, low, high, color=tint, lw=1.1, alpha=0.8, zorder=2)
            axis.plot(
                value,
                y,
                "o",
                ms=4,
                color=tint,
                mfc=tint if row.clear else "white",
                mew=0.9,
                zorder=3,
            )
        far = (
            ROOM * float(np.nanmax([0.0, *(abs(row.slope[0]) for row in by_model.values())])) or 1.0
        )
        axis.set_xlim(-far, far)
        axis.axvline(0, color=QUIET, lw=0.7, zorder=1)
        axis.set_title(title.replace(", ", "\n", 1), pad=5)
        axis.grid(axis="x")
    name_rows(axes[0], shades)
    return fig


def _grid(rows: Sequence[AgeingLine]) -> tuple[list[str], dict[str, dict[str, AgeingLine]]]:
    """The models, and the rows by title and model."""
    if all(row.model == ORACLE for row in rows):
        raise InputError("a figure of ageing needs at least one model")
    columns: dict[str, dict[str, AgeingLine]] = {}
    for row in rows:
        columns.setdefault(row.title, {})[row.model] = row
    return list(dict.fromkeys(row.model for row in rows)), columns


def _panel(axis: Axes, row: AgeingLine, tint: str) -> None:
    """Draw points with their intervals, the line with its own, and the slope where it is free."""
    points(axis, row.days, row.values, tint)
    value, low, high = row.fitted.T
    axis.fill_between(row.days, low, high, color=tint, alpha=0.15, lw=0, zorder=1)
    axis.plot(row.days, value, color=tint, lw=1.0, zorder=2)
    if np.isfinite(row.slope[0]):
        # 0.74: below the oracle
        y = 0.74 if np.nanmean(row.values[:, 0]) < np.mean(axis.get_ylim()) else 0.26
        place: Any = {
            "va": "center",
            "ha": "right",
            "transform": axis.transAxes,
            "bbox": VEIL,
            "size": 7,
            "zorder": 5,
        }
        weight, shade = ("bold", "0.1") if row.clear else ("normal", QUIET)
        axis.text(
            0.97,
            y,
            signed(row.slope[0], 1 if row.rises else 3),
            color=shade,
            weight=weight,
            **place,
        )
