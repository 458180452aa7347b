"""Panels of a figure, and what stands in them: lines over something, dots with bars, and names.

`facets` makes a figure with a panel per item. `draw_lines` draws the lines of models over something
with the spread of their values, `draw_dots` values with bars beside or below each other;
`name_ends` and `name_rows` name them. `calibration` draws how often answers are right over their
probability. A share is a fraction between 0 and 1.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.evaluation.calibration import Reliability
from pipeline.report.figures.style import MARK, QUIET, VEIL, WIDTH_IN, figure, folded

WRONG_RED = "#B2182B"  # red, of what is wrong
SMALLEST_AREA = 4.0  # square points of the marker of a bin that few queries are in
EVEN_AREA = 12.0  # square points of markers that all have one size
LINE_IN = 0.125  # height of a line of text
SLANTED: Any = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"}  # names below an axis
BAND = 0.4  # opacity of the bands of all lines together
CURVE: Any = {
    "lw": 1.2,
    "ms": 4,
    "mec": "white",
    "mew": 0.5,
    "zorder": 3,
}  # the style of a line where it has none of its own
DOT: Any = {"ls": "", "ms": 4.6, "zorder": 3}
EDGE: Any = {"mec": "white", "mew": 0.4, "clip_on": False}  # of a filled dot
Item = TypeVar("Item")


class Line(NamedTuple):
    """A line over something, and the spread of its values."""

    name: str
    x: Any  # (n,)
    y: Any  # (n,) NaN where there is no value
    style: Mapping[str, Any]  # its colour, and what else is not as in CURVE
    ends: Any = None  # (2, n) the ends of each value's interval
    # (member, n) the values whose mean each y is, such as one row per sequence; drawn as thin lines
    members: Any = None

    @classmethod
    def mean(
        cls, name: str, x: Any, members: NDArray[np.float64], style: Mapping[str, Any]
    ) -> Self:
        """The line through the means of the finite members (member, n)."""
        finite = np.ma.masked_invalid(members)
        return cls(name, x, finite.mean(axis=0).filled(np.nan), style, members=finite)


def facets(
    items: Sequence[Item],
    most_columns: int,
    heading: str,
    margin_in: float,
    row_in: float,
    width_in: float = WIDTH_IN,
    shared: bool = True,
    x_label: str = "",
    y_label: str = "",
) -> tuple[Figure, list[tuple[Axes, Item]]]:
    """A figure with a panel per item, at most `most_columns` in a row, on one scale if `shared`.

    It is `margin_in` inches high, and `row_in` more for each row of panels. `x_label` stands below
    the lowest panels, `y_label` beside the leftmost ones.
    """
    rows, columns = balanced(len(items), most_columns)
    fig = figure(width_in, margin_in + row_in * rows, heading)
    axes = panel_axes(fig, len(items), columns, shared, x_label, y_label)
    return fig, list(zip(axes, items, strict=True))


def balanced(number: int, most_columns: int) -> tuple[int, int]:
    """Rows and columns for `number` panels, with few empty cells."""
    rows = math.ceil(number / most_columns)
    return rows, math.ceil(number / rows)


def panel_axes(
    fig: Figure,
    number: int,
    columns: int,
    shared: bool = True,
    x_label: str = "",
    y_label: str = "",
) -> list[Axes]:
    """The first `number` axes of a grid with `columns` columns; see `facets`."""
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


def draw_lines(axis: Axes, drawn: Sequence[Line], band: bool = False) -> None:
    """Draw lines over something: their values, intervals and members.

    Intervals are bars, or bands if `band`; members are thin lines.
    """
    for line in drawn:
        tint = line.style["color"]
        if line.members is not None and len(line.members) > 1:
            axis.plot(line.x, line.members.T, color=tint, lw=0.5, alpha=0.45, zorder=2)
        if line.ends is not None and band and len(line.x) > 1:
            alpha = BAND / max(len(drawn), 3)
            axis.fill_between(line.x, *line.ends, color=tint, alpha=alpha, lw=0, zorder=1)
        elif line.ends is not None:
            axis.vlines(line.x, *line.ends, color=tint, lw=0.8, alpha=0.5, zorder=1)
        axis.plot(line.x, line.y, **({"label": line.name} | CURVE | dict(line.style)))


def oracle(x: Sequence[float], shares: Sequence[float], name: str = "oracle") -> Line:
    """The recall@1 (n,) of answering with the place of the nearest training anchor, in grey."""
    style = {"color": QUIET, "lw": 0.8, "marker": "o" if len(x) == 1 else "", "zorder": 2}
    return Line(name, x, np.asarray(shares, np.float64), style)


def draw_dots(
    axis: Axes,
    at: Any,
    values: Any,
    tint: str,
    across: bool = False,
    is_filled: bool = True,
    alpha: float = 1.0,
    **style: Any,
) -> None:
    """Draw dots with bars: value, low and high end of each interval (n, 3).

    They stand at `at` on the x axis or, if `across`, in the rows `at` of a panel.
    """
    value, low, high = np.reshape(values, (-1, 3)).T
    bars = axis.hlines if across else axis.vlines
    bars(at, low, high, color=tint, lw=0.9, alpha=0.7 * alpha, zorder=2)
    xy = (value, at) if across else (at, value)
    edge = EDGE if is_filled else {"mfc": "white", "mec": tint, "mew": 0.9}
    axis.plot(*xy, **({"marker": "o", "color": tint, "alpha": alpha} | DOT | edge | style))


def share_limits(*values: Any) -> tuple[float, float]:
    """Limits of an axis of shares, with a margin.

    They go from the tenth below all finite values to 1 or the largest value.
    """
    shares = np.concatenate([[0.9, 1.0], *(np.ravel(np.asarray(v, np.float64)) for v in values)])
    finite = shares[np.isfinite(shares)]
    low = max(0.0, float(np.floor(finite.min() * 10) / 10))
    high = float(finite.max())
    return low - 0.02 * (high - low), high + 0.03 * (high - low)


def scale_shares(axes: Iterable[Axes], is_relative: bool = False) -> None:
    """Give panels one y scale of shares; a line marks where nothing is lost if `is_relative`."""
    axes = list(axes)
    limits = share_limits(*(axis.dataLim.intervaly for axis in axes))
    for axis in axes:
        axis.set_ylim(*limits)
        axis.grid(axis="y")
        if is_relative:
            axis.axhline(1.0, **MARK)


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
    note = axis.annotate(
        text,
        (0.97, 0.9) if is_upper else (0.04, 0.03),
        (0, (-8.5 if is_upper else 8.5) * lines_away),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="right" if is_upper else "left",
    )
    note.set(color=tint, size=7, zorder=5, bbox=VEIL)


def calibration(axis: Axes, bins: Reliability, tint: str, whole_area: float = 0.0) -> None:
    """Draw the fraction of right answers over their probability, with each bin's error in red.

    The area of a marker is `whole_area`, in square points, times the bin's fraction of the queries;
    if `whole_area` is 0, all markers have one size.
    """
    has_queries = bins.count > 0
    probability = bins.confidence[has_queries]
    right = bins.right[has_queries]
    axis.plot([0, 1], [0, 1], **MARK)
    axis.vlines(probability, probability, right, color=WRONG_RED, lw=0.9, alpha=0.7, zorder=2)
    axis.plot(probability, right, color=tint, lw=0.8, zorder=2)
    shares = bins.count[has_queries] / bins.count.sum()
    area = np.maximum(whole_area * shares, SMALLEST_AREA) if whole_area else EVEN_AREA
    axis.scatter(probability, right, area, tint, linewidths=0, alpha=0.8, zorder=3, clip_on=False)
    axis.set(xlim=(0, 1), ylim=(0, 1))


def name_ends(axis: Axes, drawn: Sequence[Line], gap: float) -> None:
    """Write the names of lines right of their last finite values, at least `gap` apart.

    `gap` is a fraction of the y axis.
    """
    low, high = axis.get_ylim()
    gap *= high - low
    ends = []
    for line in drawn:
        y = np.asarray(line.y, np.float64)
        y = y[np.isfinite(y)]
        if len(y):
            ends.append((float(y[-1]), line.name, line.style["color"]))
    ends.sort()
    right = max((line.x[-1] for line in drawn), default=0.0)
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
