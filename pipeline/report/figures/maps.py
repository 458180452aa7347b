"""Maps of queries placed right, placed wrong or rejected, by cells or by their poses.

In: the results of models, and the training path (n, 2) in metres. Out: `outcome_map` and `fix_map`
of one result, and `montage` of all. `bounds_m` and `scale_bar` serve other maps too.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.evaluation.evaluations import FALSE_POSITIVE, TRUE_POSITIVE, Judgement
from pipeline.report.figures.panels import balanced, panel_axes
from pipeline.report.figures.style import WIDTH_IN, dot, figure, folded, styled
from pipeline.report.result import Result, by_model, by_sequence
from pipeline.studies.colours import colour

# Name, colour and marker of the three kinds of first answers: right; wrong though training was
# there; and given where training never was. RIGHT, WRONG and UNSEEN are their indices.
ANSWERS = (("right", "#0072B2", "o"), ("wrong", "#C8400A", "X"), ("unseen", "#3A3A3A", "s"))
RIGHT, WRONG, UNSEEN = range(3)
REJECTED = 0.25  # opacity of what the model rejects at its own threshold


class Layer(NamedTuple):
    """Points on a map that are drawn alike."""

    xy_m: NDArray[np.float64]  # (n, 2)
    name: str
    tint: str
    marker: str = "o"
    accepted: bool = True  # else they are faint


def outcome_map(result: Result, train_xy_m: NDArray[np.float64]) -> Figure:
    """The queries of one test sequence by their outcome, over the training path (n, 2).

    Outcomes are by cells, at the model's threshold.
    """
    heading = f"{result.model} on {result.label}, by cells"
    kinds, accepted = answers(result.evaluation.cells)
    return _single(result, kinds, accepted, train_xy_m, heading, kind_count=len(ANSWERS))


def fix_map(result: Result, train_xy_m: NDArray[np.float64]) -> Figure:
    """The queries of one test sequence by whether their poses are right.

    A pose that is not accepted is faint.
    """
    accepted = result.evaluation.pose_accepted
    right = result.evaluation.pose_right
    far_m, far_deg = result.evaluation.right_within
    heading = f"{result.model} on {result.label}: poses, right within {far_m:g} m and {far_deg:g}°"
    kinds = np.where(right, RIGHT, WRONG)
    return _single(result, kinds, accepted, train_xy_m, heading, kind_count=2)


def answers(judgement: Judgement) -> tuple[NDArray[np.integer], NDArray[np.bool_]]:
    """Which of ANSWERS the first answer to each query (q,) is, and whether it is accepted."""
    of_seen = np.where(judgement.true_rank == 0, RIGHT, WRONG)
    kinds = np.where(judgement.seen, of_seen, UNSEEN)
    return kinds, np.isin(judgement.outcome, (TRUE_POSITIVE, FALSE_POSITIVE))


@styled
def _single(
    result: Result,
    kinds: NDArray[np.integer],
    accepted: NDArray[np.bool_],
    train_xy_m: NDArray[np.float64],
    heading: str,
    kind_count: int,
) -> Figure:
    """One map of queries, each of one of the `kinds` (q,) of ANSWERS."""
    box = bounds_m(train_xy_m, result.evaluation.xy_m)
    slope = height_per_width(box)
    height_in = min(max(WIDTH_IN * slope, 2.2), 5.6)
    width_in = min(max(height_in / slope, 4.6), WIDTH_IN)
    fig = figure(width_in, height_in + 0.6, heading)
    axis = fig.subplots()
    _map(axis, result.evaluation.xy_m, kinds, accepted, train_xy_m, box, size=6.0)
    scale_bar(axis, box)
    counts = [
        f" {np.sum(kinds == code)}, {np.sum(accepted & (kinds == code))} accepted"
        for code in range(kind_count)
    ]
    _legend(fig, counts)
    return fig


@styled
def montage(results: Sequence[Result], train_xy_m: NDArray[np.float64]) -> Figure:
    """All maps on one scale, in a row per model if there are several.

    The counts below each map are in the order of the legend.
    """
    box = bounds_m(train_xy_m, *(result.evaluation.xy_m for result in results))
    models = by_model(results)
    has_several = len(models) > 1
    if has_several:
        rows = len(models)
        columns = len(by_sequence(results))
        panel_in = WIDTH_IN / max(columns, 4)
        title_in = 0.24
    else:
        rows, columns = balanced(len(results), 5)
        panel_in = WIDTH_IN / max(columns, 3)
        title_in = 0.42
    height_in = rows * (panel_in * height_per_width(box) + title_in) + 0.7
    fig = figure(panel_in * max(columns, 2), height_in, "First answers by cells")
    ordered = [result for group in models.values() for result in group]
    axes = panel_axes(fig, len(ordered), columns, shared=False)
    for number, (axis, result) in enumerate(zip(axes, ordered, strict=True)):
        kinds, accepted = answers(result.evaluation.cells)
        _map(axis, result.evaluation.xy_m, kinds, accepted, train_xy_m, box, size=1.6)
        if not has_several or number < columns:
            axis.set_title(result.label, pad=2)
        if has_several and number % columns == 0:
            name = axis.text(-0.04, 0.5, folded(result.model), transform=axis.transAxes, size=7)
            name.set(rotation=90, ha="right", va="center", multialignment="center")
            name.set(color=colour(result.model), weight="bold")
        for code, (_, tint, _) in enumerate(ANSWERS):
            count = str(np.sum(kinds == code))
            axis.text(
                0.25 + 0.25 * code,
                -0.02,
                count,
                color=tint,
                size=7,
                ha="center",
                va="top",
                transform=axis.transAxes,
            )
    scale_bar(axes[0], box)
    _legend(fig, [""] * len(ANSWERS))
    return fig


def _map(
    axis: Axes,
    xy_m: NDArray[np.float64],
    kinds: NDArray[np.integer],
    accepted: NDArray[np.bool_],
    train_xy_m: NDArray[np.float64],
    box: NDArray[np.float64],
    size: float,
) -> None:
    """Draw queries (q, 2), rejected ones faint below accepted ones, wrong ones above right ones."""
    layers = [
        Layer(xy_m[(kinds == code) & (accepted == is_accepted)], *ANSWERS[code], is_accepted)
        for is_accepted, code in product((False, True), (RIGHT, UNSEEN, WRONG))
    ]
    path = {"color": "0.85", "lw": 1.6 if size > 5 else 1.0, "zorder": 1}
    draw_layers(axis, layers, train_xy_m, box, size, path)


def draw_layers(
    axis: Axes,
    layers: Sequence[Layer],
    train_xy_m: NDArray[np.float64],
    box: NDArray[np.float64],
    size: float,
    path: Mapping[str, Any],
) -> None:
    """Draw the training path (n, 2), and layers of points of `size` square points.

    Later layers lie above others; `path` is the style of its line. Points become pixels in an SVG,
    which is smaller so.
    """
    axis.plot(*train_xy_m.T, **path)
    for order, layer in enumerate(layers, start=2):
        style: Any = {"marker": layer.marker, "zorder": order}
        if not layer.accepted:
            style["alpha"] = REJECTED
        x_m, y_m = layer.xy_m.T
        axis.scatter(x_m, y_m, size, layer.tint, linewidths=0, rasterized=True, **style)
    axis.set(xlim=box[:, 0], ylim=box[:, 1], aspect="equal")
    axis.set_axis_off()


def bounds_m(*xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lowest and highest x and y (2, 2) of all positions (n, 2) in metres, with a margin.

    There is room below for the scale bar. Raises InputError if there are no positions.
    """
    everything = np.concatenate(xy_m)
    if not len(everything):
        raise InputError("a map needs at least one training pose or query")
    low = everything.min(axis=0)
    high = everything.max(axis=0)
    middle = (low + high) / 2
    # a straight path has some width too
    half = np.maximum((high - low) / 2, 0.2 * (high - low).max() + 1.0) * 1.03
    return np.stack([middle - half - (0.0, 0.24 * half[1]), middle + half])


def height_per_width(box: NDArray[np.float64]) -> float:
    """The height of a box of `bounds_m` divided by its width."""
    width_m, height_m = box[1] - box[0]
    return float(height_m / width_m)


def scale_bar(axis: Axes, box: NDArray[np.float64], size: float = 7.0) -> None:
    """Draw a scale bar of 1, 2 or 5 × 10ᵏ metres in the lower left corner of a panel.

    It takes at most three tenths of the panel's width; `size` is the size of its text.
    """
    longest_m = 0.3 * (box[1, 0] - box[0, 0])
    power = 10.0 ** np.floor(np.log10(longest_m))
    length_m = max(step * power for step in (1, 2, 5) if step * power <= longest_m)
    left, bottom = box[0] + 0.03 * (box[1] - box[0])
    ends = [left, left + length_m]
    axis.plot(ends, [bottom, bottom], color="0.25", lw=1.2, solid_capstyle="butt")
    axis.annotate(
        f"{length_m:g} m",
        (left, bottom),
        size=size,
        xytext=(0, 2.5),
        textcoords="offset points",
        color="0.25",
    )


def _legend(fig: Figure, counts: Sequence[str]) -> None:
    """Name the first of ANSWERS, as many as there are counts, each with its count behind it."""
    entries = [
        dot(name + count, tint, marker)
        for count, (name, tint, marker) in zip(counts, ANSWERS, strict=False)
    ]
    entries.append(dot("faint: rejected", alpha=REJECTED))
    entries.append(Line2D([], [], color="0.8", lw=1.6, label="training path"))
    columns = 5 if fig.get_figwidth() > 6.5 else 3
    fig.legend(
        handles=entries,
        loc="outside lower left",
        ncols=columns,
        handlelength=1.2,
        columnspacing=1.2,
    )
