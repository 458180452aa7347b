"""Fig. 9 to 11 of the SCI paper (Kim, Park and Kim, RA-L 2019): metrics of perturbed queries.

A measure is a metric by one protocol, absolute or relative to unperturbed queries. A measurement
holds its values for one model and one kind of queries, such as `turned`, over the seeds, sequences
and repeats. Each function below returns one figure. `kinds` compares kinds of queries and
`sequences` stress sequences; `levels` draws over the level of a change, `ways` over N of N-way
training (N rotated copies of each training scan), and `cells` over the side of a grid cell.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.report.comparison import (
    AUC,
    AUC_BY_DISTANCE,
    AUC_SHARE,
    AUROC,
    HEADING_ERROR,
    RECALL,
    RECALL_BY_DISTANCE,
    UNPERTURBED_KIND,
    Comparison,
    Kind,
    Measure,
    Measurement,
)
from pipeline.report.figures.panels import (
    LINE_IN,
    Line,
    draw_dots,
    draw_lines,
    name_ends,
    name_rows,
    oracle,
    scale_shares,
    share_limits,
)
from pipeline.report.figures.style import (
    DASHES,
    MARK,
    WIDTH_IN,
    below,
    dot,
    figure,
    line_styles,
    styled,
    tints,
)
from pipeline.studies.colours import colour, marker, method_of

MARKERS = "osD^vP"  # one for each kind of queries
MEASURES = (AUC, AUC_SHARE, RECALL_BY_DISTANCE)  # the panels of `levels` and `ways`
# The width around a tick over which the points of all models are spread; ticks are 1 apart.
SPREAD = 0.24
OFFSETS = (-0.33, 0.33)  # rows from a model's row to its first and its last marker, downward
WAYS_NAME_GAP = 0.07  # between names of lines in `ways`, as a fraction of the y axis


@styled
def kinds(
    comparison: Comparison, measures: Sequence[Measure], order_by: Kind, heading: str
) -> Figure:
    """A panel per measure, a row per model, a marker per kind of queries.

    Models are sorted by their AUC on queries of the kind `order_by`, the best on top. Bars are
    standard deviations over the sequences. The first kind must be the unperturbed one: its markers
    are hollow, and panels of relative measures leave it out, since it is their reference.
    """
    models = comparison.ordered(order_by, AUC)
    shown_kinds = comparison.kinds
    # one or two markers fit into the middle of a row, more are spread over its height
    number = len(shown_kinds)
    offsets = np.linspace(*OFFSETS, number) if number > 2 else np.zeros(number)
    fig = figure(WIDTH_IN, 0.95 + 0.17 * max(1.0, number / 3) * len(models), heading)
    axes = fig.subplots(1, len(measures), squeeze=False, sharey=True)[0]
    for axis, measure in zip(axes, measures, strict=True):
        for i, kind in enumerate(shown_kinds):
            if measure.relative and i == 0:
                continue  # relative to themselves, unperturbed queries lose nothing
            measurements = [comparison.measurement(model, kind, measure) for model in models]
            shape = MARKERS[i % len(MARKERS)]
            _draw_rows(axis, models, measurements, shape, i > 0, offsets[i])
        # a line joins the two markers of a row
        if number == 2 and not measure.relative:
            ends = [
                [comparison.measurement(model, kind, measure).mean for model in models]
                for kind in shown_kinds
            ]
            axis.hlines(range(len(models)), *ends, color="0.75", lw=1.0, zorder=1)
        _scale_x(axis, measure)
    name_rows(axes[0], tints(models))
    entries = [
        dot(kind.label, marker=MARKERS[i % len(MARKERS)], is_filled=i > 0)
        for i, kind in enumerate(shown_kinds)
    ]
    below(fig, entries)
    return fig


@styled
def sequences(comparison: Comparison, titles: Mapping[str, str], heading: str) -> Figure:
    """Unperturbed queries: a row of panels per sequence under its title, in it a row per model.

    Models are sorted by their recall@1, the best on top. Bars are standard deviations over the
    seeds.
    """
    models = comparison.ordered(UNPERTURBED_KIND, RECALL)
    measures = (RECALL, AUC, AUROC, RECALL_BY_DISTANCE)
    fig = figure(WIDTH_IN, 0.4 + (0.42 + 0.145 * len(models)) * len(comparison.sequences), heading)
    grid = fig.subplots(
        len(comparison.sequences), len(measures), squeeze=False, sharex="col", sharey=True
    )
    for i, (row, sequence) in enumerate(zip(grid, comparison.sequences, strict=True)):
        for axis, measure in zip(row, measures, strict=True):
            measurements = [
                comparison.measurement(model, UNPERTURBED_KIND, measure).on(i) for model in models
            ]
            _draw_rows(axis, models, measurements, over="over_seeds")
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

    A second row is of new walls with a shadow, which hide what is behind them.
    """
    shadows = sorted({kind.shadow for kind in comparison.changes})  # whether walls have shadows
    panel_in = 0.5 + 0.12 * max(len(comparison.models), 8)
    fig = figure(WIDTH_IN, 0.3 + (0.6 + panel_in) * len(shadows), heading)
    grid = fig.subplots(len(shadows), len(MEASURES), squeeze=False, sharex=True, sharey="col")
    by_level = sorted(comparison.changes, key=lambda kind: kind.level)
    kinds_by_shadow = {
        shadow: [UNPERTURBED_KIND, *(kind for kind in by_level if kind.shadow == shadow)]
        for shadow in shadows
    }
    for column, measure in zip(grid.T, MEASURES, strict=True):
        drawn_by_shadow = {}
        for axis, (shadow, shown_kinds) in zip(column, kinds_by_shadow.items(), strict=True):
            measurements = {
                model: [comparison.measurement(model, kind, measure) for kind in shown_kinds]
                for model in comparison.models
            }
            drawn_by_shadow[shadow] = _lines_over_ticks(measurements)
            draw_lines(axis, drawn_by_shadow[shadow])
            axis.tick_params(labelbottom=True)
            axis.set_xlabel(unit)
        # the y scale is shared, so panels are finished when all their lines are drawn
        for axis, (shadow, drawn) in zip(column, drawn_by_shadow.items(), strict=True):
            ticks = [f"{kind.level:g}" for kind in kinds_by_shadow[shadow]]
            _finish_panel(axis, measure, drawn, ticks, LINE_IN / panel_in)
    if any(shadows):
        for axis, shadow in zip(grid[:, 0], shadows, strict=True):
            label = "what is behind is hidden" if shadow else "what is behind stays in view"
            axis.set_ylabel(label)
    return fig


@styled
def ways(
    comparison: Comparison, kind: Kind, reference_models: Sequence[str], heading: str
) -> Figure:
    """A method over the N of its N-way training, on unperturbed queries and those of `kind`.

    `reference_models` are level lines, on queries of `kind`.
    """
    models_by_n = comparison.ways()  # N to the model of N-way training
    shades = tints(comparison.models)
    method = method_of(next(iter(models_by_n.values())))
    last = len(models_by_n) - 1
    fig = figure(WIDTH_IN, 2.7, heading)
    for axis, measure in zip(fig.subplots(1, len(MEASURES)), MEASURES, strict=True):
        drawn = []
        for drawn_kind in (kind,) if measure.relative else (UNPERTURBED_KIND, kind):
            style = {"color": colour(method), "marker": "o"}
            if drawn_kind != kind:
                style |= {"ls": DASHES[1], "mfc": "white", "mec": colour(method)}
            measurements = [
                comparison.measurement(model, drawn_kind, measure) for model in models_by_n.values()
            ]
            name = f"{method} {drawn_kind.label}"
            drawn.append(_line_of_means(name, range(last + 1), measurements, style))
        for model in reference_models:
            mean = comparison.measurement(model, kind, measure).mean
            style = {"color": shades[model], "ls": DASHES[2]}
            drawn.append(Line(model, (-0.3, last), (mean, mean), style))
        draw_lines(axis, drawn)
        axis.set(xlim=(-0.3, last + 0.3), xlabel="N of N-way")
        _finish_panel(axis, measure, drawn, [str(n) for n in models_by_n], WAYS_NAME_GAP)
    return fig


@styled
def cells(
    values: Mapping[tuple[str, str, str], Sequence[NDArray[np.float64]]],
    sizes_m: Sequence[float],
    oracles: Mapping[str, Sequence[float]],
    heading: str,
) -> Figure:
    """A panel per metric, a line per model over the cell sizes, and the oracle's mean recall@1.

    The oracle answers with the place of the nearest training anchor. `values` maps a model,
    protocol and metric to the values (sequence,) at each size; `oracles` maps a protocol to the
    oracle's mean at each size. Lines are means and bars standard deviations over the sequences.
    """
    models = list(dict.fromkeys(model for model, _, _ in values))
    panel_in = 0.6 + LINE_IN * max(len(models) + 1, 9)
    fig = figure(WIDTH_IN, 0.3 + 2 * (0.45 + panel_in), heading)
    for axis, measure in zip(
        fig.subplots(2, 2).flat, (AUC, RECALL, AUC_BY_DISTANCE, RECALL_BY_DISTANCE), strict=True
    ):
        # a measurement is of values (seed, sequence, repeat)
        drawn = _lines_over_ticks(
            {
                model: [Measurement(np.reshape(of_size, (1, -1, 1))) for of_size in by_size]
                for (model, protocol, metric), by_size in values.items()
                if (protocol, metric) == (measure.protocol, measure.name)
            }
        )
        if measure.name == "recall_at_1":
            drawn.append(oracle(range(len(sizes_m)), oracles[measure.protocol]))
        draw_lines(axis, drawn)
        ticks = [f"{side_m:g} m" for side_m in sizes_m]
        _finish_panel(axis, measure, drawn, ticks, LINE_IN / panel_in)
    return fig


def _lines_over_ticks(measurements: Mapping[str, Sequence[Measurement]]) -> list[Line]:
    """A line per model over its measurements, one a tick, slightly beside other models' lines."""
    drawn = []
    for i, (model, style) in enumerate(line_styles(measurements).items()):
        offset = SPREAD * ((i + 0.5) / len(measurements) - 0.5)
        x = np.arange(len(measurements[model])) + offset
        style_with_marker = style | {"marker": marker(model)}
        drawn.append(_line_of_means(model, x, measurements[model], style_with_marker))
    return drawn


def _line_of_means(
    name: str, x: object, measurements: Sequence[Measurement], style: Mapping[str, object]
) -> Line:
    """A line through means; bars are standard deviations over the test sequences."""
    mean, low, high = _intervals(measurements).T
    return Line(name, x, mean, style, (low, high))


def _finish_panel(
    axis: Axes, measure: Measure, drawn: Sequence[Line], ticks: Sequence[str], name_gap: float
) -> None:
    """Label a panel's ticks, scale it together with panels that share its y axis, name its lines.

    The names stand at least `name_gap` apart, as a fraction of the y axis.
    """
    axis.set_xticks(range(len(ticks)), ticks)
    axis.set_title(measure.title, loc="left", pad=8)
    scale_shares(axis.get_shared_y_axes().get_siblings(axis), measure.relative)
    name_ends(axis, drawn, name_gap)


def _intervals(
    measurements: Sequence[Measurement], over: str = "over_sequences"
) -> NDArray[np.float64]:
    """The mean of each measurement, and a standard deviation below and above it (n, 3).

    `over` names the attribute of a measurement that holds the standard deviation.
    """
    means = np.array([measurement.mean for measurement in measurements])
    deviations = np.array([getattr(measurement, over) for measurement in measurements])
    return np.stack([means, means - deviations, means + deviations], axis=1)


def _draw_rows(
    axis: Axes,
    models: Sequence[str],
    measurements: Sequence[Measurement],
    marker: str = "o",
    is_filled: bool = True,
    offset_rows: float = 0.0,
    over: str = "over_sequences",
) -> None:
    """Draw a marker with its bar in the row of each model, `offset_rows` rows downward."""
    shades = tints(models).values()
    intervals = _intervals(measurements, over)
    for row, (tint, interval) in enumerate(zip(shades, intervals, strict=True)):
        place = [row + offset_rows]
        draw_dots(axis, place, interval, tint, across=True, is_filled=is_filled, marker=marker)


def _scale_x(axis: Axes, measure: Measure) -> None:
    """Scale x to fractions up to 1, or to degrees from 0; a line marks where nothing is lost."""
    limits = share_limits(axis.dataLim.intervalx)
    axis.set_xlim(*((0.0, max(limits[1], 5.5)) if measure is HEADING_ERROR else limits))
    if measure.relative:
        axis.axvline(1.0, **MARK)
    axis.set_xlabel(measure.title)
    axis.grid(axis="both")
    axis.tick_params(axis="y", left=False)
