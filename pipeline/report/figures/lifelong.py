"""Draws the learning of further days: recall after each step, and since when places are known.

A model learns one day (or one part of a day) in each step. A strategy says how it learns, such as
`incremental`, and an order which day comes when; after each step the same days are queried.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipeline.report.figures.maps import (
    Layer,
    bounds_m,
    draw_layers,
    height_per_width,
    scale_bar,
)
from pipeline.report.figures.panels import SLANTED, Line, draw_lines, facets, share_limits
from pipeline.report.figures.style import MARK, QUIET, THICK, WIDTH_IN, below, dot, figure, styled
from pipeline.report.result import day
from pipeline.report.table import MISSING, short
from pipeline.studies.colours import MARKERS, PALETTE

DARK = 0.6  # from this fraction of the colour scale on, the number in a cell is white
ALONE_IN = 4.2  # width of a single matrix
LEAST_SPAN = 0.1  # a scale of recall or forgetting spans at least this
PATH: Any = {"color": "0.15", "lw": 0.5}  # the training path, above the queries
NEVER = "0.75"  # grey of queries whose place is never known


class FirstKnown(NamedTuple):
    """The queries of all queried days, in one order of learning."""

    xy_m: NDArray[np.float64]  # (query, 2) where each was taken
    step: NDArray[np.int64]  # (query,) from which its place is known; −1 for never
    names: Sequence[str]  # of the steps


@styled
def matrices(
    recalls: Mapping[str, NDArray[np.float64]],
    steps: Sequence[str],
    groups: Sequence[str],
    heading: str,
) -> Figure:
    """Recall (step, group) of each strategy, with a number in each cell.

    A group is a queried day or a part of the site. Recall is NaN where no place of the group is
    known yet.
    """
    fig, panels = facets(
        [*recalls.items()],
        most_columns=3,
        heading=heading,
        margin_in=0.35,
        row_in=0.85 + 0.24 * len(steps),
        width_in=WIDTH_IN if len(recalls) > 1 else ALONE_IN,
    )
    low, high = share_limits(*recalls.values())
    for axis, (strategy, values) in panels:
        axis.pcolormesh(
            values, cmap="Blues", vmin=low, vmax=high, edgecolors="white", linewidth=1.2
        )
        for (step, group), value in np.ndenumerate(values):
            tint = "white" if value > low + DARK * (high - low) else "0.15"
            text = short(value, 2) if np.isfinite(value) else MISSING
            axis.text(group + 0.5, step + 0.5, text, ha="center", va="center", size=7, color=tint)
        axis.set_title(strategy, pad=4)
        axis.set_xticks(np.arange(len(groups)) + 0.5, _short_names(groups), **SLANTED)
        axis.set_yticks(np.arange(len(steps)) + 0.5, _short_names(steps))
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
    fig.axes[0].set_ylim(len(steps), 0)  # the first step above; the panels share it
    fig.supylabel("step learned", size=8)
    return fig


@styled
def over_steps(
    orders: Mapping[str, Sequence[str]],
    numbers: Mapping[str, Mapping[tuple[str, str], NDArray[np.float64]]],
    heading: str,
) -> Figure:
    """Metrics over the steps: a column of panels per order, a row per metric.

    `orders` maps an order to its steps; `numbers` maps a title to the values (seed, step) of each
    order and strategy. A line joins the means, thin lines are single seeds; each panel has its own
    scale.
    """
    strategies = dict.fromkeys(strategy for values in numbers.values() for _, strategy in values)
    styles: dict[str, Any] = {
        strategy: {"color": PALETTE[i % len(PALETTE)], "marker": MARKERS[i % len(MARKERS)]}
        for i, strategy in enumerate(strategies)
    }
    fig = figure(WIDTH_IN, 0.9 + 1.6 * len(numbers), heading)
    wide: Any = {"width_ratios": [len(steps) + 1 for steps in orders.values()]}
    axes = fig.subplots(len(numbers), len(orders), squeeze=False, sharex="col", gridspec_kw=wide)
    for row, (title, values) in zip(axes, numbers.items(), strict=True):
        row[0].set_ylabel(title)
        for axis, order in zip(row, orders, strict=True):
            drawn = [
                Line.mean(strategy, np.arange(seeds.shape[1]), seeds, styles[strategy])
                for (line_order, strategy), seeds in values.items()
                if line_order == order
            ]
            draw_lines(axis, drawn)
            axis.grid(axis="y")
    for column, (order, steps) in zip(axes.T, orders.items(), strict=True):
        column[0].set_title(order, pad=4)
        column[-1].set_xticks(
            range(len(steps)), _short_names(steps), **(SLANTED | {"rotation": 30})
        )
        column[-1].set_xlim(-0.3, len(steps) - 0.7)
    for axis in axes.flat:
        low, high = axis.get_ylim()
        spare = max(LEAST_SPAN - (high - low), 0.0) / 2
        axis.set_ylim(low - spare, high + spare)
    for axis in axes[-1]:
        axis.axhline(0.0, **MARK)
    entries = [Line2D([], [], label=name, **style, **THICK) for name, style in styles.items()]
    below(fig, entries)
    return fig


@styled
def known_places(
    queries_by_order: Mapping[str, FirstKnown], train_xy_m: NDArray[np.float64]
) -> Figure:
    """Queries of all queried days by the step from which their place is known, a panel per order.

    They are drawn over the training path (n, 2).
    """
    maps = {}
    for order, (xy_m, step, names) in queries_by_order.items():
        maps[order] = [Layer(xy_m[step < 0], "never", NEVER)]
        for i, name in enumerate(_short_names(names)):
            maps[order].append(Layer(xy_m[step == i], name, PALETTE[i % len(PALETTE)]))
    return _maps(maps, train_xy_m, "From which step each place is known")


@styled
def ages(
    places_by_order: Mapping[str, tuple[NDArray[np.float64], NDArray[np.int64]]],
    train_xy_m: NDArray[np.float64],
) -> Figure:
    """Places by the age in days of their newest view, a panel per order.

    `places_by_order` maps an order to the positions of places (n, 2) and their ages (n,).
    """
    maps = {}
    for order, (xy_m, days) in places_by_order.items():
        ages = np.unique(days)
        shades = matplotlib.colormaps["viridis_r"](np.linspace(0.1, 0.95, len(ages)))
        maps[order] = [
            Layer(xy_m[days == age], f"{age} days", to_hex(shade))
            for age, shade in zip(ages, shades, strict=True)
        ]
    return _maps(maps, train_xy_m, "The age of each place's newest view")


def _maps(
    maps: Mapping[str, Sequence[Layer]], train_xy_m: NDArray[np.float64], heading: str
) -> Figure:
    """Draw a map per title, later layers on top, with the number of points of each layer."""
    around = bounds_m(train_xy_m, *(layer.xy_m for layers in maps.values() for layer in layers))
    columns = len(maps)
    panel_in = min(WIDTH_IN / max(columns, 2), 4.5)
    most_layers = max(map(len, maps.values()))
    height_in = panel_in * height_per_width(around) + 0.35 + 0.16 * math.ceil((most_layers + 1) / 2)
    fig = figure(panel_in * max(columns, 2), height_in, heading)
    axes = fig.subplots(1, columns, squeeze=False)[0]
    for axis, (title, layers) in zip(axes, maps.items(), strict=True):
        shown = [layer for layer in layers if len(layer.xy_m)]
        draw_layers(axis, shown, train_xy_m, around, 5.0, PATH | {"zorder": 90})
        entries = [dot(f"{layer.name}: {len(layer.xy_m)}", layer.tint) for layer in shown]
        entries.append(Line2D([], [], label="training path", **PATH))
        axis.set_title(title, pad=3)
        axis.legend(
            handles=entries,
            loc="upper center",
            bbox_to_anchor=(0.5, 0.0),
            ncols=2,
            fontsize=7,
            labelcolor=QUIET,
        )
    scale_bar(fig.axes[0], around)
    return fig


def _short_names(names: Sequence[str]) -> list[str]:
    """Names of steps or groups: of a part of a day the part alone, of a day its date."""
    return [day(name.rpartition(" ")[2]) for name in names]
