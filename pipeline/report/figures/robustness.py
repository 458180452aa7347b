"""Fig. 9 to 11 of the SCI paper: numbers of queries as driven and altered.

`dots` draws kinds of query beside each other and `sequences` those of stress; `levels` draws over
the level of a change, `ways` over the number of headings that training turned scans to (N-way), and
`cells` over the side of a cell.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.report.comparison import (
    AUC,
    AUROC,
    FAR,
    FAR_AUC,
    KEPT,
    OFF,
    RECALL,
    Comparison,
    Kind,
    Measure,
    Measurement,
)
from pipeline.report.figures.panels import (
    LINE_IN,
    Line,
    means_of,
    model_lines,
    name_ends,
    name_rows,
    oracle_line,
    share_limits,
)
from pipeline.report.figures.style import (
    DASHES,
    MARK,
    WIDTH_IN,
    below,
    dot,
    figure,
    styled,
    tints,
)
from pipeline.studies.colours import colour, method_of

MARKERS = "osD^vP"  # of kinds of query
MEASURES = (AUC, KEPT, FAR)  # the panels of `levels` and `ways`


@styled
def dots(
    comparison: Comparison, measures: Sequence[Measure], order_by: Kind, heading: str
) -> Figure:
    """A panel per measure, a row per model, a marker per kind of query.

    The best AUC in the kind `order_by` stands first. Bars are deviations over the sequences. The
    marker of queries as driven is hollow.
    """
    models = comparison.ordered(order_by, AUC)
    kinds = comparison.kinds
    marks = [MARKERS[i % len(MARKERS)] for i in range(len(kinds))]
    lifts = np.linspace(-0.33, 0.33, len(kinds)) if len(kinds) > 2 else np.zeros(len(kinds))
    fig = figure(WIDTH_IN, 0.95 + 0.17 * max(1.0, len(kinds) / 3) * len(models), heading)
    axes = fig.subplots(1, len(measures), squeeze=False, sharey=True)[0]
    for axis, measure in zip(axes, measures, strict=True):
        values = [
            means_of([comparison.measurement(model, kind, measure) for model in models])
            for kind in kinds
        ]
        first = 1 if measure.relative else 0  # as driven nothing is lost
        for i in range(first, len(kinds)):
            is_altered = i > 0
            _row(axis, models, values[i], marks[i], is_filled=is_altered, lift=lifts[i])
        if len(kinds) == 2 and not measure.relative:
            means = values[0][0], values[1][0]
            axis.hlines(range(len(models)), *means, color="0.75", lw=1.0, zorder=1)
        _scale_x(axis, measure)
    name_rows(axes[0], tints(models))
    entries = [dot(kinds[i].label, marker=marks[i], is_filled=i > 0) for i in range(len(kinds))]
    below(fig, entries)
    return fig


@styled
def sequences(comparison: Comparison, titles: Mapping[str, str], heading: str) -> Figure:
    """Queries as driven: a row of panels per sequence under its title, in it a row per model.

    The best model is on top. Bars are deviations over the seeds.
    """
    models = comparison.ordered(Kind(), RECALL)
    measures = (RECALL, AUC, AUROC, FAR)
    fig = figure(WIDTH_IN, 0.4 + (0.42 + 0.145 * len(models)) * len(comparison.sequences), heading)
    grid = fig.subplots(
        len(comparison.sequences), len(measures), squeeze=False, sharex="col", sharey=True
    )
    for i, (row, sequence) in enumerate(zip(grid, comparison.sequences, strict=True)):
        for axis, measure in zip(row, measures, strict=True):
            numbers = [comparison.measurement(model, Kind(), measure).on(i) for model in models]
            # (2, model)
            means_and_deviations = np.array([(n.mean, n.over_seeds) for n in numbers]).T
            _row(axis, models, means_and_deviations)
            _scale_x(axis, measure)
        row[0].set_title(titles[sequence], loc="left", pad=4)
        name_rows(row[0], tints(models))
    for axis in grid[:-1].flat:
        axis.set_xlabel("")
    for column in grid.T:
        column[0].set_xlim(*share_limits(*(axis.dataLim.intervalx for axis in column)))
    return fig


@styled
def levels(comparison: Comparison, heading: str, unit: str) -> Figure:
    """A panel per measure, a line per model, over the level of the change in `unit`.

    New walls that hide what is behind them are in a second row.
    """
    models = comparison.models
    shadows = sorted({kind.shadow for kind in comparison.changes})
    panel_in = 0.5 + 0.12 * max(len(models), 8)
    fig = figure(WIDTH_IN, 0.3 + (0.6 + panel_in) * len(shadows), heading)
    grid = fig.subplots(len(shadows), len(MEASURES), squeeze=False, sharex=True, sharey="col")
    for column, measure in zip(grid.T, MEASURES, strict=True):
        ends = []
        for axis, shadow in zip(column, shadows, strict=True):
            changed = [kind for kind in comparison.changes if kind.shadow == shadow]
            kinds = [Kind(), *sorted(changed, key=lambda kind: kind.level)]
            rows = {
                model: [comparison.measurement(model, kind, measure) for kind in kinds]
                for model in models
            }
            ends.append(model_lines(axis, rows))
            axis.set_xticks(range(len(kinds)), [f"{kind.level:g}" for kind in kinds])
            axis.tick_params(labelbottom=True)
            axis.set_title(measure.title, loc="left", pad=9)
            axis.set_xlabel(unit)
        _scale_y(column, measure)
        for axis, lines in zip(column, ends, strict=True):
            name_ends(axis, lines, gap=LINE_IN / panel_in)
    if any(shadows):
        for axis, shadow in zip(grid[:, 0], shadows, strict=True):
            label = "what is behind is hidden" if shadow else "what is behind stays in view"
            axis.set_ylabel(label)
    return fig


@styled
def ways(
    comparison: Comparison, kind: Kind, reference_models: Sequence[str], heading: str
) -> Figure:
    """A method over the N of its N-way training, on queries as driven and of one other kind.

    `reference_models` are level lines, on queries of that kind.
    """
    models_by_n = comparison.ways()
    shades = tints(comparison.models)
    method = method_of(next(iter(models_by_n.values())))
    positions = np.arange(len(models_by_n))
    tint = colour(method)
    fig = figure(WIDTH_IN, 2.7, heading)
    for axis, measure in zip(fig.subplots(1, len(MEASURES)), MEASURES, strict=True):
        ends: list[Line] = []
        drawn_kinds = (kind,) if measure.relative else (Kind(), kind)
        for drawn in drawn_kinds:
            dash, fill = ("-", tint) if drawn == kind else (DASHES[1], "white")
            numbers = [
                comparison.measurement(name, drawn, measure) for name in models_by_n.values()
            ]
            means, deviations = means_of(numbers)
            axis.errorbar(
                positions,
                means,
                deviations,
                color=tint,
                elinewidth=0.6,
                zorder=3,
                marker="o",
                ms=4,
                mfc=fill,
                mew=0.8,
                lw=1.3,
                ls=dash,
            )
            xy = np.stack([positions, means], axis=1)
            ends.append(Line(f"{method} {drawn.label}", tint, xy))
        for model in reference_models:
            mean = comparison.measurement(model, kind, measure).mean
            level = np.array([[-0.3, positions[-1]], [mean, mean]])
            axis.plot(*level, color=shades[model], lw=1.0, ls=DASHES[2])
            ends.append(Line(model, shades[model], level.T))
        axis.set_xticks(positions, [str(n) for n in models_by_n])
        axis.set(xlim=(-0.3, len(models_by_n) - 0.7), xlabel="N of N-way")
        axis.set_title(measure.title, loc="left", pad=5)
        _scale_y([axis], measure)
        name_ends(axis, ends, gap=0.07)
    return fig


@styled
def cells(
    values: Mapping[tuple[str, str, str], Sequence[NDArray[np.float64]]],
    sizes_m: Sequence[float],
    oracle: Mapping[str, Sequence[float]],
    heading: str,
) -> Figure:
    """A panel per number, a line per model over the cell sizes, and the oracle's mean recall@1.

    `values` maps a model, protocol and number to the values (sequence,) at each size; `oracle` maps
    a protocol to the mean at each size. Lines are means over the sequences, bars deviations.
    """
    models = list(dict.fromkeys(model for model, _, _ in values))
    panel_in = 0.6 + LINE_IN * max(len(models) + 1, 9)
    fig = figure(WIDTH_IN, 0.3 + 2 * (0.45 + panel_in), heading)
    for axis, measure in zip(fig.subplots(2, 2).flat, (AUC, RECALL, FAR_AUC, FAR), strict=True):
        rows = {}
        for (model, protocol, name), by_size in values.items():
            if (protocol, name) == (measure.protocol, measure.name):
                # a measurement is of values (seed, sequence, repeat)
                rows[model] = [Measurement(np.reshape(numbers, (1, -1, 1))) for numbers in by_size]
        ends = model_lines(axis, rows)
        if measure.name == "recall_at_1":
            ends.append(oracle_line(axis, range(len(sizes_m)), oracle[measure.protocol]))
        axis.set_xticks(range(len(sizes_m)), [f"{side_m:g} m" for side_m in sizes_m])
        axis.set_title(measure.title, loc="left", pad=8)
        _scale_y([axis], measure)
        name_ends(axis, ends, gap=LINE_IN / panel_in)
    return fig


def _row(
    axis: Axes,
    models: Sequence[str],
    values: NDArray[np.float64],
    marker: str = "o",
    is_filled: bool = True,
    lift: float = 0.0,
) -> None:
    """Draw a marker in the row of each model, from means and deviations (2, model).

    The marker is filled if `is_filled`, and stands `lift` rows below the middle of its row.
    """
    rows = np.arange(len(models)) + lift
    shades = tints(models).values()
    for y, tint, mean, deviation in zip(rows, shades, *values, strict=True):
        axis.hlines(y, mean - deviation, mean + deviation, color=tint, lw=0.8, alpha=0.6, zorder=2)
        fill = tint if is_filled else "white"
        axis.plot(mean, y, marker, ms=4.5, mfc=fill, mec=tint, mew=0.9, zorder=3)


def _scale_x(axis: Axes, measure: Measure) -> None:
    """Scale x to shares up to 1, or to degrees from 0; a line marks where nothing is lost."""
    limits = share_limits(axis.dataLim.intervalx)
    axis.set_xlim(*((0.0, max(limits[1], 5.5)) if measure is OFF else limits))
    if measure.relative:
        axis.axvline(1.0, **MARK)
    axis.set_xlabel(measure.title)
    axis.grid(axis="both")
    axis.tick_params(axis="y", left=False)


def _scale_y(axes: Iterable[Axes], measure: Measure) -> None:
    """Give the panels one y scale of shares; a line marks where nothing is lost."""
    limits = share_limits(*(axis.dataLim.intervaly for axis in axes))
    for axis in axes:
        axis.set_ylim(*limits)
        axis.grid(axis="y")
        if measure.relative:
            axis.axhline(1.0, **MARK)
