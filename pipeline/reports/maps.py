"""Where in the world queries were placed right, placed wrong, or turned away, by cells: the papers' protocol."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.reports.result import Result, by_method, by_sequence, some
from pipeline.reports.style import STYLE, TEXT_WIDTH_IN, balanced, colour, figure, panels

OUTCOMES = (  # name, colour, marker; blues are right and warm colours wrong, light ones seen and dark ones mostly unseen
    ("hit", "#6BB6E8", "o"),
    ("miss", "#EFA31D", "^"),
    ("false alarm", "#B2182B", "X"),
    ("correct rejection", "#1B3C73", "s"),
)
"""In the order of the codes of `Judgement.outcome`; by cells every query is judged."""
DRAWN = (0, 3, 1, 2)
"""The many first, what went wrong on top."""
COLUMNS = 5
HEADING = "Outcomes by cells"


@matplotlib.rc_context(STYLE)
def outcome_map(result: Result, train_xy_m: NDArray[np.float64], simulated: bool) -> Figure:
    """The queries of one test sequence, coloured by outcome at the model's threshold, over the training path (n, 2)."""
    box = _box([result], train_xy_m)
    width_m, height_m = box[1] - box[0]
    height_in = float(np.clip(TEXT_WIDTH_IN * height_m / width_m, 2.2, 5.6))
    width_in = float(np.clip(height_in * width_m / height_m, 4.6, TEXT_WIDTH_IN))
    fig = figure(width_in, height_in + 0.6, simulated, f"{result.method} on {result.label}, by cells")
    axis = fig.subplots()
    _draw(axis, result, train_xy_m, box, size=6.0)
    _legend(fig, result)
    return fig


@matplotlib.rc_context(STYLE)
def montage(results: Sequence[Result], train_xy_m: NDArray[np.float64], simulated: bool) -> Figure:
    """All the maps at a glance on one scale, of several methods a row each; the counts under each are in the legend's order."""
    box = _box(some(results), train_xy_m)
    width_m, height_m = box[1] - box[0]
    methods = by_method(results)
    rows, columns = (len(methods), len(by_sequence(results))) if len(methods) > 1 else balanced(len(results), COLUMNS)
    panel_in, title_in = TEXT_WIDTH_IN / max(columns, 4 if len(methods) > 1 else 3), 0.24 if len(methods) > 1 else 0.42
    fig = figure(panel_in * max(columns, 2), rows * (panel_in * height_m / width_m + title_in) + 0.7, simulated, HEADING)
    ordered = [result for group in methods.values() for result in group]
    for number, (axis, result) in enumerate(zip(panels(fig, len(ordered), columns, shared=False), ordered, strict=True)):
        _draw(axis, result, train_xy_m, box, size=1.6, bar=number == 0)
        if len(methods) == 1 or number < columns:
            axis.set_title(result.label, pad=2)
        if len(methods) > 1 and number % columns == 0:
            name = axis.text(-0.04, 0.5, result.method, rotation=90, ha="right", va="center", transform=axis.transAxes)
            name.set(color=colour(result.method), weight="bold")
        for place, (share, (_, tint, _)) in enumerate(zip(_counts(result), OUTCOMES, strict=True)):
            axis.text(0.2 + 0.2 * place, -0.02, str(share), color=tint, size=7, ha="center", va="top", transform=axis.transAxes)
    _legend(fig)
    return fig


def _draw(
    axis: Axes, result: Result, train_xy_m: NDArray[np.float64], box: NDArray[np.float64], size: float, bar: bool = True
) -> None:
    """The training path, the queries at `size` square points, and a scale bar; dense points become pixels in an SVG."""
    axis.plot(*train_xy_m.T, color="0.85", lw=1.6 if size > 5 else 1.0, zorder=1)
    for code in DRAWN:
        _, tint, marker = OUTCOMES[code]
        chosen = result.evaluation.xy_m[result.evaluation.cells.outcome == code]
        order = 2 + DRAWN.index(code)
        axis.scatter(chosen[:, 0], chosen[:, 1], size, tint, marker=marker, linewidths=0, zorder=order, rasterized=True)
    axis.set(xlim=box[:, 0], ylim=box[:, 1], aspect="equal")
    axis.set_axis_off()
    if bar:
        _scale_bar(axis, box)


def _box(results: Sequence[Result], train_xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lowest and highest x and y (2, 2) in metres of all that is drawn, with a margin, and room below for the scale bar."""
    everything = np.concatenate([train_xy_m, *(result.evaluation.xy_m for result in results)])
    if not len(everything):
        raise InputError("a map needs at least one training pose or query")
    low, high = everything.min(axis=0), everything.max(axis=0)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 0.2 * (high - low).max() + 1.0) * 1.03
    return np.stack([middle - half - (0.0, 0.24 * half[1]), middle + half])


def _scale_bar(axis: Axes, box: NDArray[np.float64]) -> None:
    """A bar of 1, 2 or 5 × 10ᵏ metres, up to three tenths of the panel's width, in its lower left corner."""
    wanted_m = 0.3 * (box[1, 0] - box[0, 0])
    power = 10.0 ** np.floor(np.log10(wanted_m))
    length_m = max(step * power for step in (1, 2, 5) if step * power <= wanted_m)
    left, bottom = box[0] + 0.03 * (box[1] - box[0])
    axis.plot([left, left + length_m], [bottom, bottom], color="0.25", lw=1.2, solid_capstyle="butt")
    axis.annotate(f"{length_m:g} m", (left, bottom), xytext=(0, 2.5), textcoords="offset points", size=7, color="0.25")


def _counts(result: Result) -> list[int]:
    """Queries of each outcome, in the order of `OUTCOMES`."""
    return [int(number) for number in np.bincount(result.evaluation.cells.outcome, minlength=len(OUTCOMES))]


def _legend(fig: Figure, result: Result | None = None) -> None:
    """Name the outcomes below the panels, with their counts where there is one result, and the training path."""
    counts = [""] * len(OUTCOMES) if result is None else [f" {number}" for number in _counts(result)]
    handles = [
        Line2D([], [], ls="", marker=marker, ms=4, color=tint, mew=0, label=name + number)
        for (name, tint, marker), number in zip(OUTCOMES, counts, strict=True)
    ]
    handles.append(Line2D([], [], color="0.8", lw=1.6, label="training path"))
    columns = 5 if fig.get_figwidth() > 6.5 else 3
    fig.legend(handles=handles, loc="outside lower left", ncols=columns, frameon=False, handlelength=1.2, columnspacing=1.2)
