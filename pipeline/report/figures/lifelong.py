"""Learning further days: recall after each step, forgetting, and since when places are known."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipeline.report.figures.maps import bounds_m, scale_bar
from pipeline.report.figures.panels import SLANTED, course, facets, share_limits
from pipeline.report.figures.style import MARK, QUIET, THICK, WIDTH_IN, below, dot, figure, styled
from pipeline.report.result import day
from pipeline.report.table import MISSING, short
from pipeline.studies.colours import MARKERS, PALETTE

DARK = 0.6
"""From this share of the colours on, a number in a cell is white."""
ALONE_IN = 4.2  # width of a single matrix
LEAST = 0.1  # a scale of recall or forgetting spans at least so much
PATH = "0.15"  # of the training path, above the queries
NEVER = "0.75"  # grey of queries whose place is never known


FirstKnown = tuple[NDArray[np.float64], NDArray[np.int64], Sequence[str]]
"""Of one order: where queries were taken (query, 2), the step from which the place of each is known
(query,), −1 for never, and the names of the steps."""
Points = tuple[NDArray[np.float64], NDArray[np.int64], Sequence[tuple[str, str]]]
"""Where points lie (n, 2), their kind (n,), and the name and colour of each kind."""


@styled
def matrices(
    recalls: Mapping[str, NDArray[np.float64]],
    steps: Sequence[str],
    groups: Sequence[str],
    heading: str,
) -> Figure:
    """Recall (step, group) of each strategy, with a number in each cell.

    NaN where no place of the group is known yet.
    """
    fig, panels = facets(
        [*recalls.items()],
        3,
        heading,
        lambda rows, _: rows * (0.85 + 0.24 * len(steps)) + 0.35,
        WIDTH_IN if len(recalls) > 1 else ALONE_IN,
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
    """A column an order over its steps, a row a number by its title.

    Numbers (seed, step) go by order and strategy. A line joins the means, thin lines are single
    seeds; each panel has its own scale.
    """
    strategies = dict.fromkeys(strategy for values in numbers.values() for _, strategy in values)
    looks: dict[str, Any] = {
        strategy: {"color": PALETTE[i % len(PALETTE)], "marker": MARKERS[i % len(MARKERS)]}
        for i, strategy in enumerate(strategies)
    }
    fig = figure(WIDTH_IN, 0.9 + 1.6 * len(numbers), heading)
    wide: Any = {"width_ratios": [len(steps) + 1 for steps in orders.values()]}
    axes = fig.subplots(len(numbers), len(orders), squeeze=False, sharex="col", gridspec_kw=wide)
    for row, (title, values) in zip(axes, numbers.items(), strict=True):
        row[0].set_ylabel(title)
        for axis, order in zip(row, orders, strict=True):
            for (line_order, strategy), seeds in values.items():
                if line_order == order:
                    tint, shape = looks[strategy].values()
                    x = np.arange(seeds.shape[1])
                    course(axis, x, seeds, tint, lw=1.3, marker=shape, ms=4)
            axis.grid(axis="y")
    for column, (order, steps) in zip(axes.T, orders.items(), strict=True):
        column[0].set_title(order, pad=4)
        column[-1].set_xticks(
            range(len(steps)), _short_names(steps), **(SLANTED | {"rotation": 30})
        )
        column[-1].set_xlim(-0.3, len(steps) - 0.7)
    for axis in axes.flat:
        low, high = axis.get_ylim()
        spare = max(LEAST - (high - low), 0.0) / 2
        axis.set_ylim(low - spare, high + spare)
    for axis in axes[-1]:
        axis.axhline(0.0, **MARK)
    below(fig, [Line2D([], [], label=name, **THICK, **line) for name, line in looks.items()])
    return fig


@styled
def known_places(
    queries_by_order: Mapping[str, FirstKnown], train_xy_m: NDArray[np.float64]
) -> Figure:
    """Queries of all asked days by the step from which their place is known, a panel an order.

    They are drawn over the training path (n, 2).
    """
    points = {}
    for order, (xy_m, known_from, steps) in queries_by_order.items():
        shades = [NEVER, *(PALETTE[i % len(PALETTE)] for i in range(len(steps)))]
        kinds = list(zip(["never", *_short_names(steps)], shades, strict=True))
        points[order] = xy_m, known_from + 1, kinds
    return _maps(points, train_xy_m, "From which step each place is known")


@styled
def ages(
    places_by_order: Mapping[str, tuple[NDArray[np.float64], NDArray[np.int64]]],
    train_xy_m: NDArray[np.float64],
) -> Figure:
    """Places by the age in days of their newest view, a panel an order.

    Takes where places lie (n, 2), and their age (n,).
    """
    points = {}
    for order, (xy_m, days) in places_by_order.items():
        distinct_days, kind = np.unique(days, return_inverse=True)
        shades = matplotlib.colormaps["viridis_r"](np.linspace(0.1, 0.95, len(distinct_days)))
        names = [f"{age} days" for age in distinct_days]
        points[order] = xy_m, kind, list(zip(names, map(to_hex, shades), strict=True))
    return _maps(points, train_xy_m, "The age of each place's newest view")


def _maps(
    points_by_title: Mapping[str, Points], train_xy_m: NDArray[np.float64], heading: str
) -> Figure:
    """Draw a map a panel, later kinds on top, with the number of points of each kind."""
    around = bounds_m(train_xy_m, *(xy_m for xy_m, *_ in points_by_title.values()))
    slope = float(np.divide(*(around[1] - around[0])[::-1]))
    columns = len(points_by_title)
    panel_in = min(WIDTH_IN / max(columns, 2), 4.5)
    most_kinds = max(len(looks) for *_, looks in points_by_title.values())
    height_in = panel_in * slope + 0.35 + 0.16 * (-(-(most_kinds + 1) // 2))
    fig = figure(panel_in * max(columns, 2), height_in, heading)
    axes = fig.subplots(1, columns, squeeze=False)[0]
    for axis, (title, (xy_m, kind, looks)) in zip(axes, points_by_title.items(), strict=True):
        axis.plot(*train_xy_m.T, color=PATH, lw=0.5, zorder=90)
        entries = [Line2D([], [], color=PATH, lw=0.5, label="training path")]
        for place, (name, tint) in enumerate(looks):
            kind_xy_m = xy_m[kind == place]
            if len(kind_xy_m):
                axis.scatter(
                    *kind_xy_m.T, 5.0, tint, linewidths=0, zorder=2 + place, rasterized=True
                )
                entries.insert(-1, dot(f"{name}: {len(kind_xy_m)}", tint))
        axis.set(xlim=around[:, 0], ylim=around[:, 1], aspect="equal")
        axis.set_axis_off()
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
    """Short names: for a part of a day the part alone, for a day its date."""
    return [day(name.rpartition(" ")[2]) for name in names]
