"""Panels of a figure: how many stand beside each other, what is drawn in them, and names beside it.

`facets` makes a figure with a panel per item. `points`, `course`, `calibration`, `model_lines` and
`oracle_line` draw in one panel; `name_ends` and `name_rows` name lines and rows of models.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.evaluation.calibration import Reliability
from pipeline.report.comparison import Measurement
from pipeline.report.figures.style import MARK, QUIET, VEIL, WIDTH_IN, figure, folded, look
from pipeline.studies.colours import marker

WRONG_RED = "#B2182B"  # red, of what is wrong
SMALLEST_AREA = 4.0  # square points of the marker of a bin that few queries are in
EVEN_AREA = 12.0  # square points of markers that are all alike
LINE_IN = 0.125  # height of a line of text
SLANTED: Any = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"}  # names below an axis
Item = TypeVar("Item")


class Line(NamedTuple):
    """A line whose end is named."""

    name: str
    tint: str
    xy: NDArray[np.float64]  # (n, 2)


def facets(
    items: Sequence[Item],
    most_columns: int,
    heading: str,
    around_in: float,
    row_in: float,
    width_in: float = WIDTH_IN,
    shared: bool = True,
    x_label: str = "",
    y_label: str = "",
) -> tuple[Figure, list[tuple[Axes, Item]]]:
    """A figure with a panel per item, at most `most_columns` in a row, on one scale if `shared`.

    It is `around_in` inches high, and `row_in` more for each row of panels. `x_label` stands below
    the lowest panels, `y_label` beside the leftmost ones.
    """
    rows, columns = balanced(len(items), most_columns)
    fig = figure(width_in, around_in + row_in * rows, heading)
    axes = panels(fig, len(items), columns, shared, x_label, y_label)
    return fig, list(zip(axes, items, strict=True))


def balanced(number: int, most_columns: int) -> tuple[int, int]:
    """Rows and columns for `number` panels, with few empty cells."""
    rows = math.ceil(number / most_columns)
    return rows, math.ceil(number / rows)


def panels(
    fig: Figure,
    number: int,
    columns: int,
    shared: bool = True,
    x_label: str = "",
    y_label: str = "",
) -> list[Axes]:
    """The first `number` axes of a grid with so many columns; see `facets`."""
    columns = min(columns, number)
    rows = math.ceil(number / columns)
    axes = list(fig.subplots(rows, columns, squeeze=False, sharex=shared, sharey=shared).flat)
    for axis in axes[number:]:
        axis.remove()
    for axis in axes[number - columns : number]:
        axis.tick_params(labelbottom=True)
        axis.set_xlabel(x_label)
    for axis in axes[:number:columns]:
        axis.set_ylabel(y_label)
    return axes[:number]


def precision_axes(axis: Axes, title: str) -> None:
    """Set the scales of a small panel of precision over recall."""
    ticks: Any = {"ticks": (0.0, 0.5, 1.0), "labels": ("0", ".5", "1")}
    axis.set(xlim=(0, 1), ylim=(0, 1.02))
    axis.set_xticks(**ticks)
    axis.set_yticks(**ticks)
    axis.set_title(title, pad=5)


def in_corner(
    axis: Axes, text: str, tint: str, lines_away: int = 0, is_upper: bool = False
) -> None:
    """Write in the lower left corner of a panel, or in the upper right one if `is_upper`.

    The text stands `lines_away` lines of text away from the corner.
    """
    if is_upper:
        corner = (0.97, 0.9)
        line_pt = -8.5
        side = "right"
    else:
        corner = (0.04, 0.03)
        line_pt = 8.5
        side = "left"
    note = axis.annotate(
        text,
        corner,
        (0, line_pt * lines_away),
        xycoords="axes fraction",
        textcoords="offset points",
        ha=side,
    )
    note.set(color=tint, size=7, zorder=5, bbox=VEIL)


def share_limits(*values: Any) -> tuple[float, float]:
    """Limits of an axis of shares, with a margin.

    They go from the tenth below all finite values to 1 or the largest value.
    """
    shares = np.concatenate([[0.9, 1.0], *(np.ravel(np.asarray(v, np.float64)) for v in values)])
    finite = shares[np.isfinite(shares)]
    low = max(0.0, float(np.floor(finite.min() * 10) / 10))
    high = float(finite.max())
    return low - 0.02 * (high - low), high + 0.03 * (high - low)


def points(
    axis: Axes,
    x: Any,
    values: NDArray[np.float64],
    tint: str,
    marker: str = "o",
    alpha: float = 1.0,
    **options: Any,
) -> None:
    """Draw markers at `x` with bars: value, low and high end of each interval (n, 3)."""
    value, low, high = values.T
    axis.vlines(x, low, high, color=tint, lw=0.9, alpha=0.7 * alpha, zorder=2)
    usual: Any = {"ls": "", "ms": 3.6, "mec": "white", "mew": 0.4, "zorder": 3, "clip_on": False}
    axis.plot(x, value, marker=marker, color=tint, alpha=alpha, **(usual | options))


def course(
    axis: Axes, x: Any, members: NDArray[np.float64], tint: str, dots: bool = False, **line: Any
) -> NDArray[np.float64]:
    """Draw a line through the means of the finite `members` (member, x), and return them (x,).

    The members themselves are faint dots if `dots`, else faint lines where there are several.
    """
    finite = np.ma.masked_invalid(members)
    if dots:
        axis.scatter(
            np.broadcast_to(x, finite.shape), finite, 6, tint, alpha=0.35, linewidths=0, zorder=2
        )
    elif len(members) > 1:
        axis.plot(x, members.T, color=tint, lw=0.5, alpha=0.45, zorder=2)
    means = np.asarray(finite.mean(axis=0).filled(np.nan))
    axis.plot(x, means, color=tint, mec="white", mew=0.5, zorder=3, **line)
    return means


def calibration(axis: Axes, bins: Reliability, tint: str, whole_area: float = 0.0) -> None:
    """Draw the share of right answers over their chance, and by how much each bin is off, in red.

    The area of a marker is `whole_area`, in square points, times the bin's share of the queries; if
    that is 0, all markers are alike.
    """
    has_queries = bins.count > 0
    chance = bins.confidence[has_queries]
    right = bins.right[has_queries]
    axis.plot([0, 1], [0, 1], **MARK)
    axis.vlines(chance, chance, right, color=WRONG_RED, lw=0.9, alpha=0.7, zorder=2)
    axis.plot(chance, right, color=tint, lw=0.8, zorder=2)
    shares = bins.count[has_queries] / bins.count.sum()
    area = np.maximum(whole_area * shares, SMALLEST_AREA) if whole_area else EVEN_AREA
    axis.scatter(chance, right, area, tint, linewidths=0, alpha=0.8, zorder=3, clip_on=False)
    axis.set(xlim=(0, 1), ylim=(0, 1))


def model_lines(axis: Axes, rows: Mapping[str, Sequence[Measurement]]) -> list[Line]:
    """Draw a line per model through the means of its measurements, and return the lines.

    Lines stand slightly beside each other; bars are deviations over the test sequences.
    """
    ends = []
    for i, (model, line) in enumerate(look(rows).items()):
        x = np.arange(len(rows[model])) + 0.24 * ((i + 0.5) / len(rows) - 0.5)
        means, deviations = means_of(rows[model])
        axis.vlines(
            x,
            means - deviations,
            means + deviations,
            color=line["color"],
            lw=0.7,
            alpha=0.45,
            zorder=1,
        )
        axis.plot(
            x,
            means,
            lw=1.1,
            zorder=3,
            label=model,
            marker=marker(model),
            ms=3.4,
            mec="white",
            mew=0.4,
            **line,
        )
        ends.append(Line(model, line["color"], np.stack([x, means], axis=1)))
    return ends


def means_of(measurements: Sequence[Measurement]) -> NDArray[np.float64]:
    """Means and deviations over the test sequences (2, k) of k measurements."""
    return np.array([[m.mean for m in measurements], [m.over_sequences for m in measurements]])


def oracle_line(
    axis: Axes, x: Sequence[float], shares: Sequence[float], name: str = "oracle"
) -> Line:
    """Draw the recall@1 (n,) of answering with the nearest training pose, in grey."""
    line = np.stack([x, shares], axis=1).astype(np.float64)
    axis.plot(*line.T, color="0.6", lw=0.8, marker="." if len(line) == 1 else "", zorder=2)
    return Line(name, QUIET, line)


def name_ends(axis: Axes, lines: Sequence[Line], gap: float) -> None:
    """Write the names of lines right of their last finite values.

    Names are at least `gap`, a share of the y axis, apart.
    """
    low, high = axis.get_ylim()
    gap *= high - low
    ends = []
    for name, tint, xy in lines:
        y = xy[np.isfinite(xy[:, 1]), 1]
        if len(y):
            ends.append((float(y[-1]), name, tint))
    ends.sort()
    right = max((xy[-1, 0] for _, _, xy in lines), default=0.0)
    places = _apart([y for y, _, _ in ends], gap, high)
    for place, (_, name, tint) in zip(reversed(places), reversed(ends), strict=True):
        axis.annotate(
            name,
            (right, place),
            (7, 0),
            color=tint,
            textcoords="offset points",
            va="center",
            annotation_clip=False,
        )


def _apart(values: Sequence[float], gap: float, highest: float) -> list[float]:
    """Move ascending values until they are at least `gap` apart and none is above `highest`."""
    places = list(values)
    for i in range(1, len(places)):
        places[i] = max(places[i], places[i - 1] + gap)
    for i in reversed(range(len(places))):
        places[i] = min(places[i], highest)
        highest = places[i] - gap
    return places


def name_rows(axis: Axes, tints: Mapping[str, str]) -> None:
    """Write names of models in their colours along the y axis, the first on top."""
    axis.set_yticks(range(len(tints)), [folded(model) for model in tints], size=7)
    axis.set_ylim(len(tints) - 0.4, -0.6)
    for tick, tint in zip(axis.get_yticklabels(), tints.values(), strict=True):
        tick.set_color(tint)
