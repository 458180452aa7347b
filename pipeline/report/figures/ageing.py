"""Metrics over the days since training with a fitted line, and the slopes of those lines.

In: rows of the table of results, of models on unperturbed queries and of the oracle, which answers
each query with the place of the nearest training anchor. The lines were fitted where the table was
made.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.core.errors import InputError
from pipeline.evaluation.bootstrap import NONE, Estimate
from pipeline.evaluation.rows import indexed, pick, values
from pipeline.evaluation.study_rows import ORACLE, PER_DAYS, PERCENTILE
from pipeline.report.figures.panels import Line, draw_dots, draw_lines, name_rows
from pipeline.report.figures.style import QUIET, VEIL, WIDTH_IN, figure, folded, styled, tints
from pipeline.report.table import signed

ROOM = 2.5  # half the width of a panel of slopes, in steepest slopes; longer bars are cut


class FollowedNumber(NamedTuple):
    """A metric that is drawn over the days."""

    protocol: str
    number: str  # its name in the table of results
    title: str


@styled
def lines(rows: pd.DataFrame, followed: Sequence[FollowedNumber]) -> Figure:
    """A row per model, a column per metric: points and fitted line with their 95 % intervals.

    The slope is written in the panel, bold if its interval does not contain 0.
    """
    shades = tints(model for model in _models(rows, followed) if model != ORACLE)
    fig = figure(WIDTH_IN, 0.75 + 0.88 * len(shades), f"Change per {PER_DAYS} days, of each model")
    axes = fig.subplots(len(shades), len(followed), squeeze=False, sharex=True, sharey="col")
    for column, (protocol, number, title) in zip(axes.T, followed, strict=True):
        column[0].set_title(title.replace(", ", "\n", 1), pad=5)
        # the percentile of novelty rises with age from 0 to 100, other metrics fall from 1 to 0
        column[0].set_ylim(*((-4.0, 104.0) if number == PERCENTILE else (0.0, 1.04)))
        protocol_rows = pick(rows, protocol=protocol).sort_values("days")
        oracle = pick(protocol_rows, method=ORACLE, number=f"{number}_line")
        grey = {"color": "0.7", "lw": 0.8, "zorder": 2}
        for axis, (model, tint) in zip(column, shades.items(), strict=True):
            draw_lines(axis, [Line(ORACLE, oracle["days"], oracle["value"], grey)])
            _panel(axis, pick(protocol_rows, method=model), number, tint)
            axis.grid(axis="y")
    for axis, (model, tint) in zip(axes[:, 0], shades.items(), strict=True):
        axis.set_ylabel(folded(model), color=tint, size=7.5)
    fitted = rows[rows["number"].isin([f"{drawn.number}_line" for drawn in followed])]
    axes[0, 0].set_xlim(0, 1.04 * max(1.0, fitted["days"].max()))
    legend = (
        "days since training; dots: test sequences; grey: the oracle; shade: 95 % interval of "
        "the line"
    )
    fig.supxlabel(legend, size=8)
    return fig


@styled
def slopes(rows: pd.DataFrame, followed: Sequence[FollowedNumber]) -> Figure:
    """A panel per metric, a row per model: the slope with its interval, filled if it is clear."""
    models = _models(rows, followed)
    shades = tints(models) | ({ORACLE: QUIET} if ORACLE in models else {})
    fig = figure(WIDTH_IN, 0.95 + 0.21 * len(models), f"Change per {PER_DAYS} days since training")
    axes = fig.subplots(1, len(followed), squeeze=False, sharey=True)[0]
    for axis, (protocol, number, title) in zip(axes, followed, strict=True):
        by_model = indexed(pick(rows, protocol=protocol, number=_slope_name(number)), "method")
        for y, (model, tint) in enumerate(shades.items()):
            slope = by_model.get(model, NONE)
            draw_dots(axis, [y], slope, tint, across=True, is_filled=_is_clear(slope))
        steepest = np.nanmax([0.0, *(abs(value) for value, _, _ in by_model.values())])
        reach = ROOM * float(steepest) or 1.0
        axis.set_xlim(-reach, reach)
        axis.axvline(0, color=QUIET, lw=0.7, zorder=1)
        axis.set_title(title.replace(", ", "\n", 1), pad=5)
        axis.grid(axis="x")
    name_rows(axes[0], shades)
    return fig


def _models(rows: pd.DataFrame, followed: Sequence[FollowedNumber]) -> list[str]:
    """The models for which any of the metrics has a line, the oracle among them."""
    fitted = [
        pick(rows, protocol=drawn.protocol, number=f"{drawn.number}_line") for drawn in followed
    ]
    models = [*pd.concat(fitted)["method"].unique()]
    if set(models) <= {ORACLE}:
        raise InputError("a figure of ageing needs at least one model")
    return models


def _slope_name(number: str) -> str:
    """The name in the table of results of the slope of a metric."""
    return f"{number}_per_{PER_DAYS}_days"


def _is_clear(slope: Estimate) -> bool:
    """Whether the interval of a slope does not contain 0."""
    _, low, high = slope
    return low > 0 or high < 0


def _panel(axis: Axes, rows: pd.DataFrame, number: str, tint: str) -> None:
    """Draw one model's points and line with their intervals, and its slope where there is room."""
    line = pick(rows, number=f"{number}_line")
    if line.empty:
        return
    measured = pick(rows, number=number)
    measured = measured[measured["sequence"].isin(line["sequence"])]
    draw_dots(axis, measured["days"], values(measured), tint)
    fitted, low, high = values(line).T
    style = {"color": tint, "lw": 1.0, "zorder": 2}
    draw_lines(axis, [Line(number, line["days"], fitted, style, (low, high))], band=True)
    slope = indexed(pick(rows, number=_slope_name(number)), "number").get(_slope_name(number), NONE)
    if np.isfinite(slope[0]):
        # above points that lie low, but below the oracle; else below the points
        y = 0.74 if np.nanmean(measured["value"]) < np.mean(axis.get_ylim()) else 0.26
        weight, shade = ("bold", "0.1") if _is_clear(slope) else ("normal", QUIET)
        axis.text(
            0.97,
            y,
            signed(slope[0], 1 if number == PERCENTILE else 3),
            va="center",
            ha="right",
            transform=axis.transAxes,
            bbox=VEIL,
            size=7,
            color=shade,
            weight=weight,
            zorder=5,
        )
