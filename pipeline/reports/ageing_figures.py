"""Each method's numbers over the days since training with the line through them, and the slopes of those lines."""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.reports.ageing_lines import DRAWN, ORACLE, PER_DAYS, Aged, Measure
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, VEIL, colour, figure
from pipeline.reports.table import signed

ROOM = 2.5
"""A panel of slopes reaches so many times as far as the steepest line; longer intervals are cut by it."""
LONG = 12
"""Letters of a name that fit beside a panel."""
MARGIN, HEAD_IN = 0.02, 0.17
"""Beside names that are drawn a little wider than they are measured, and above the panels."""
ABOVE = 0.74
"""Where the slope stands in a panel whose points are in the lower half: under the oracle."""


@matplotlib.rc_context(STYLE)
def lines(every: Sequence[Aged], simulated: bool) -> Figure:
    """A row a method and a column a number: a point a sequence with its 95 % interval, the line and its own interval.

    The oracle is grey; the slope stands in the panel, bold where its interval leaves 0 out.
    """
    methods = list(dict.fromkeys(one.method for one in every if one.method != ORACLE))
    fig = figure(TEXT_WIDTH_IN, 0.75 + 0.88 * len(methods), simulated, f"What {PER_DAYS} days do to each method")
    axes = fig.subplots(len(methods), len(DRAWN), squeeze=False, sharex=True, sharey="col")
    for column, measure in zip(axes.T, DRAWN, strict=True):
        found = {one.method: one for one in every if one.measure == measure}
        column[0].set_title(measure.title.replace(", ", "\n", 1), pad=5)
        column[0].set_ylim(*_scale(measure))
        for axis, method in zip(column, methods, strict=True):
            if ORACLE in found and (line := found[ORACLE].line):
                ends = np.array([found[ORACLE].days.min(), found[ORACLE].days.max()])
                axis.plot(ends, line.at(ends)[0], color="0.7", lw=0.8, zorder=2)
            _draw(axis, found[method])
            axis.grid(axis="y", lw=0.4, color="0.9")
            axis.set_axisbelow(True)
    for row, method in zip(axes, methods, strict=True):
        row[0].set_ylabel(folded(method), color=colour(method), size=7.5)
    axes[0, 0].set_xlim(0, 1.04 * max(1.0, *(float(one.days.max()) for one in every)))
    fig.supxlabel("days since training; dots: test sequences; grey: the oracle; shade: 95 % interval of the line", size=8)
    return fig


@matplotlib.rc_context(STYLE)
def slopes(every: Sequence[Aged], simulated: bool) -> Figure:
    """A panel a number, a row a method: the slope with its interval, filled where that leaves 0 out."""
    methods = list(dict.fromkeys(one.method for one in every))
    fig = figure(TEXT_WIDTH_IN, 0.95 + 0.21 * len(methods), simulated, f"Change per {PER_DAYS} days since training")
    fig.set_layout_engine("constrained", rect=(MARGIN, 0.0, 1.0 - MARGIN, 1.0 - HEAD_IN / fig.get_figheight()), h_pad=0.03)
    axes = fig.subplots(1, len(DRAWN), sharey=True)
    for axis, measure in zip(axes, DRAWN, strict=True):
        group = [one for one in every if one.measure == measure and one.line is not None]
        for one in group:
            _slope(axis, one, methods.index(one.method))
        far = ROOM * PER_DAYS * max((abs(one.line.slope) for one in group if one.line), default=0.0)
        axis.set_xlim(-far or -1.0, far or 1.0)
        axis.axvline(0, color=QUIET, lw=0.7, zorder=1)
        axis.set_title(measure.title.replace(", ", "\n", 1), pad=5)
        axis.grid(axis="x", lw=0.4, color="0.9")
        axis.set_axisbelow(True)
    axes[0].set_yticks(range(len(methods)), [folded(method) for method in methods])
    for tick, method in zip(axes[0].get_yticklabels(), methods, strict=True):
        tick.set_color(QUIET if method == ORACLE else colour(method))
    axes[0].set_ylim(len(methods) - 0.4, -0.6)
    return fig


def folded(method: str) -> str:
    """A method's name, a long one in two lines."""
    return "\n_".join(method.rsplit("_", 1)) if len(method) > LONG else method


def _scale(measure: Measure) -> tuple[float, float]:
    return (-4.0, 104.0) if measure.rises else (0.0, 1.04)


def _draw(axis: Axes, one: Aged) -> None:
    """Points with their intervals, the line from the first to the last with its own, and the slope away from all that."""
    tint, line = colour(one.method), one.line
    axis.vlines(one.days, one.values[:, 1], one.values[:, 2], color=tint, lw=0.8, alpha=0.7, zorder=3)
    axis.plot(one.days, one.values[:, 0], "o", ms=3.2, color=tint, mec="white", mew=0.4, zorder=4, clip_on=False)
    if line is None:
        return
    days = np.linspace(one.days.min(), one.days.max(), 40)
    value, low, high = line.at(days)
    axis.fill_between(days, low, high, color=tint, alpha=0.15, lw=0, zorder=1)
    axis.plot(days, value, color=tint, lw=1.0, zorder=2)
    above = np.nanmean(one.values[:, 0]) < np.mean(axis.get_ylim())
    place: Any = {"va": "center", "ha": "right", "transform": axis.transAxes, "bbox": VEIL, "size": 7, "zorder": 5}
    if line.trend:
        place["weight"] = "bold"
    text = signed(line.slope * PER_DAYS, 1 if one.measure.rises else 3)
    axis.text(0.97, ABOVE if above else 1 - ABOVE, text, color="0.1" if line.trend else QUIET, **place)


def _slope(axis: Axes, one: Aged, row: int) -> None:
    line, tint = one.line, QUIET if one.method == ORACLE else colour(one.method)
    if line is None:
        return
    if line.interval:
        low, high = (PER_DAYS * bound for bound in line.interval)
        axis.hlines(row, low, high, color=tint, lw=1.1, alpha=0.8, zorder=2)
    axis.plot(PER_DAYS * line.slope, row, "o", ms=4, color=tint, mfc=tint if line.trend else "white", mew=0.9, zorder=3)
