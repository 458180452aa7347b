"""Panels of a figure: how many beside each other, their scales, names beside lines and rows."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.evaluation.calibration import Reliability
from pipeline.report.comparison import Measurement
from pipeline.report.figures.style import MARK, QUIET, VEIL, WIDTH_IN, figure, folded, look
from pipeline.studies.colours import marker

OFF = "#B2182B"  # of what is off
SMALLEST = 4.0
EVEN = 12.0
"""Square points of the marker of a bin that few queries are in, and of any where all are alike."""
LINE_IN = 0.125  # height of a line of text
SLANTED: Any = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"}  # names below an axis
Line = tuple[str, str, NDArray[np.float64]]  # name, colour and points (n, 2)
Item = TypeVar("Item")


def facets(
    items: Sequence[Item],
    most: int,
    heading: str,
    height_in: Callable[[int, int], float],
    width_in: float = WIDTH_IN,
    shared: bool = True,
    x: str = "",
    y: str = "",
) -> tuple[Figure, list[tuple[Axes, Item]]]:
    """A figure with a panel an item, at most `most` in a row, on one scale if `shared`.

    `height_in` is of the figure, from its rows and columns. `x` and `y` label the lowest and the
    leftmost panels.
    """
    rows, columns = balanced(len(items), most)
    fig = figure(width_in, height_in(rows, columns), heading)
    return fig, list(zip(panels(fig, len(items), columns, shared, x, y), items, strict=True))


def balanced(number: int, most: int) -> tuple[int, int]:
    """Rows and columns for `number` panels, at most `most` in a row, with few empty cells."""
    rows = -(-number // most)
    return rows, -(-number // rows)


def panels(
    fig: Figure, number: int, columns: int, shared: bool = True, x: str = "", y: str = ""
) -> list[Axes]:
    """`number` axes in rows of `columns`; see `facets`."""
    columns = min(columns, number)
    rows = -(-number // columns)
    axes = list(fig.subplots(rows, columns, squeeze=False, sharex=shared, sharey=shared).flat)
    for axis in axes[number:]:
        axis.remove()
    for axis in axes[number - columns : number]:
        axis.tick_params(labelbottom=True)
        axis.set_xlabel(x)
    for axis in axes[:number:columns]:
        axis.set_ylabel(y)
    return axes[:number]


def precision_axes(axis: Axes, title: str) -> None:
    """Set the scales of a small panel of precision over recall."""
    ticks: Any = {"ticks": (0.0, 0.5, 1.0), "labels": ("0", ".5", "1")}
    axis.set(xlim=(0, 1), ylim=(0, 1.02))
    axis.set_xticks(**ticks)
    axis.set_yticks(**ticks)
    axis.set_title(title, pad=5)


def in_corner(axis: Axes, line: int, text: str, tint: str, upper: bool = False) -> None:
    """Write a number in the lower left corner of a panel, or in the upper right one.

    It stands `line` lines away from the corner.
    """
    corner, step, side = ((0.97, 0.9), -8.5, "right") if upper else ((0.04, 0.03), 8.5, "left")
    note = axis.annotate(
        text,
        corner,
        (0, step * line),
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
    """Draw markers of values (n, 3) with their intervals as bars."""
    value, low, high = values.T
    axis.vlines(x, low, high, color=tint, lw=0.9, alpha=0.7 * alpha, zorder=2)
    look: Any = {"ls": "", "ms": 3.6, "mec": "white", "mew": 0.4, "zorder": 3, "clip_on": False}
    axis.plot(x, value, marker=marker, color=tint, alpha=alpha, **(look | options))


def course(
    axis: Axes, x: Any, members: NDArray[np.float64], tint: str, dots: bool = False, **line: Any
) -> NDArray[np.float64]:
    """Draw a line through the means of the finite members (member, x), and return them (x,).

    Members, where there are several, are faint lines, or faint dots.
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


def calibration(axis: Axes, bins: Reliability, tint: str, largest: float = 0.0) -> None:
    """Draw the share that is right over the chance, and by how much each bin is off, in red.

    With `largest`, the area in square points of a marker is its share of the queries.
    """
    full = bins.count > 0
    chance = bins.confidence[full]
    right = bins.right[full]
    axis.plot([0, 1], [0, 1], **MARK)
    axis.vlines(chance, chance, right, color=OFF, lw=0.9, alpha=0.7, zorder=2)
    axis.plot(chance, right, color=tint, lw=0.8, zorder=2)
    shares = bins.count[full] / bins.count.sum()
    area = np.maximum(largest * shares, SMALLEST) if largest else EVEN
    axis.scatter(chance, right, area, tint, linewidths=0, alpha=0.8, zorder=3, clip_on=False)
    axis.set(xlim=(0, 1), ylim=(0, 1))


def model_lines(axis: Axes, rows: Mapping[str, Sequence[Measurement]]) -> list[Line]:
    """Draw a line a model through its means, slightly beside the other lines.

    Bars are deviations over the test sequences.
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
        ends.append((model, line["color"], np.stack([x, means], axis=1)))
    return ends


def means_of(measurements: Sequence[Measurement]) -> NDArray[np.float64]:
    """Means and deviations over the test sequences (2, k) of k measurements."""
    return np.array([[m.mean for m in measurements], [m.over_sequences for m in measurements]])


def oracle_line(
    axis: Axes, x: Sequence[float], shares: Sequence[float], name: str = "oracle"
) -> Line:
    """Draw the oracle's recall@1 (n,) in grey."""
    line = np.stack([x, shares], axis=1).astype(np.float64)
    axis.plot(*line.T, color="0.6", lw=0.8, marker="." if len(line) == 1 else "", zorder=2)
    return name, QUIET, line


def name_ends(axis: Axes, lines: Sequence[Line], gap: float) -> None:
    """Write names right of the last finite values of lines.

    They are at least `gap`, a share of the y axis, apart.
    """
    low, high = axis.get_ylim()
    gap *= high - low
    finite = [(name, tint, points[np.isfinite(points[:, 1])]) for name, tint, points in lines]
    ends = sorted(
        (float(points[-1, 1]), name, tint) for name, tint, points in finite if len(points)
    )
    right = max((points[-1, 0] for _, _, points in lines), default=0.0)
    y = -np.inf
    places = [y := max(end, y + gap) for end, _, _ in ends]
    y = high + gap
    places = [y := min(place, y - gap) for place in reversed(places)]
    for place, (_, name, tint) in zip(places, reversed(ends), strict=True):
        axis.annotate(
            name,
            (right, place),
            (7, 0),
            color=tint,
            textcoords="offset points",
            va="center",
            annotation_clip=False,
        )


def name_rows(axis: Axes, tints: Mapping[str, str]) -> None:
    """Write names of models in their colours along the y axis, the first on top."""
    axis.set_yticks(range(len(tints)), [folded(model) for model in tints], size=7)
    axis.set_ylim(len(tints) - 0.4, -0.6)
    for tick, tint in zip(axis.get_yticklabels(), tints.values(), strict=True):
        tick.set_color(tint)
