"""Fig. 9 to 11 of the SCI paper: numbers of unperturbed and perturbed queries.

`kinds` draws kinds of query beside each other and `sequences` stress sequences; `levels` draws over
the level of a change, `ways` over the number of headings that training turned scans to (N-way), and
`cells` over the side of a cell.
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
    Comparison,
    Kind,
    Measure,
    Measurement,
)
from pipeline.report.figures.panels import (
    LINE_IN,
    Line,
    dots,
    lines,
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
    look,
    styled,
    tints,
)
from pipeline.studies.colours import colour, marker, method_of

MARKERS = "osD^vP"  # of kinds of query
MEASURES = (AUC, AUC_SHARE, RECALL_BY_DISTANCE)  # the panels of `levels` and `ways`
SPREAD = 0.24  # lines of models stand so far beside each other; ticks are 1 apart


@styled
def kinds(
    comparison: Comparison, measures: Sequence[Measure], order_by: Kind, heading: str
) -> Figure:
    """A panel per measure, a row per model, a marker per kind of query.

    The best AUC in the kind `order_by` stands first. Bars are deviations over the sequences. The
    marker of unperturbed queries is hollow.
    """
    models = comparison.ordered(order_by, AUC)
    drawn = comparison.kinds
    lifts = np.linspace(-0.33, 0.33, len(drawn)) if len(drawn) > 2 else np.zeros(len(drawn))
    fig = figure(WIDTH_IN, 0.95 + 0.17 * max(1.0, len(drawn) / 3) * len(models), heading)
    axes = fig.subplots(1, len(measures), squeeze=False, sharey=True)[0]
    for axis, measure in zip(axes, measures, strict=True):
        for i, kind in enumerate(drawn):
            if measure.relative and not i:
                continue  # relative to themselves, unperturbed queries lose nothing
            numbers = [comparison.measurement(model, kind, measure) for model in models]
            _rows(axis, models, numbers, MARKERS[i % len(MARKERS)], i > 0, lifts[i])
        if len(drawn) == 2 and not measure.relative:
            ends = [
                [comparison.measurement(model, kind, measure).mean for model in models]
                for kind in drawn
            ]
            axis.hlines(range(len(models)), *ends, color="0.75", lw=1.0, zorder=1)
        _scale_x(axis, measure)
    name_rows(axes[0], tints(models))
    entries = [
        dot(kind.label, marker=MARKERS[i % len(MARKERS)], is_filled=i > 0)
        for i, kind in enumerate(drawn)
    ]
    below(fig, entries)
    return fig


@styled
def sequences(comparison: Comparison, titles: Mapping[str, str], heading: str) -> Figure:
    """Unperturbed queries: a row of panels per sequence under its title, in it a row per model.

    The best model is on top. Bars are deviations over the seeds.
    """
    models = comparison.ordered(Kind(), RECALL)
    measures = (RECALL, AUC, AUROC, RECALL_BY_DISTANCE)
    fig = figure(WIDTH_IN, 0.4 + (0.42 + 0.145 * len(models)) * len(comparison.sequences), heading)
    grid = fig.subplots(
        len(comparison.sequences), len(measures), squeeze=False, sharex="col", sharey=True
    )
    for i, (row, sequence) in enumerate(zip(grid, comparison.sequences, strict=True)):
        for axis, measure in zip(row, measures, strict=True):
            numbers = [comparison.measurement(model, Kind(), measure).on(i) for model in models]
            _rows(axis, models, numbers, over="over_seeds")
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
    shadows = sorted({kind.shadow for kind in comparison.changes})
    panel_in = 0.5 + 0.12 * max(len(comparison.models), 8)
    fig = figure(WIDTH_IN, 0.3 + (0.6 + panel_in) * len(shadows), heading)
    grid = fig.subplots(len(shadows), len(MEASURES), squeeze=False, sharex=True, sharey="col")
    for column, measure in zip(grid.T, MEASURES, strict=True):
        drawn = []
        for axis, shadow in zip(column, shadows, strict=True):
            changed = [kind for kind in comparison.changes if kind.shadow == shadow]
            kinds = [Kind(), *sorted(changed, key=lambda kind: kind.level)]
            numbers = {
                model: [comparison.measurement(model, kind, measure) for kind in kinds]
                for model in comparison.models
            }
            drawn.append(_over(numbers))
            lines(axis, drawn[-1])
            axis.tick_params(labelbottom=True)
            axis.set_xlabel(unit)
        for axis, models in zip(column, drawn, strict=True):
            _name(axis, measure, models, [f"{kind.level:g}" for kind in kinds], LINE_IN / panel_in)
    if any(shadows):
        for axis, shadow in zip(grid[:, 0], shadows, strict=True):
            label = "what is behind is hidden" if shadow else "what is behind stays in view"
            axis.set_ylabel(label)
    return fig


@styled
def ways(
    comparison: Comparison, kind: Kind, reference_models: Sequence[str], heading: str
) -> Figure:
    """A method over the N of its N-way training, on unperturbed queries and of one other kind.

    `reference_models` are level lines, on queries of that kind.
    """
    models_by_n = comparison.ways()
    shades = tints(comparison.models)
    method = method_of(next(iter(models_by_n.values())))
    last = len(models_by_n) - 1
    fig = figure(WIDTH_IN, 2.7, heading)
    for axis, measure in zip(fig.subplots(1, len(MEASURES)), MEASURES, strict=True):
        drawn = []
        for drawn_kind in (kind,) if measure.relative else (Kind(), kind):
            look = {"color": colour(method), "marker": "o"}
            if drawn_kind != kind:
                look |= {"ls": DASHES[1], "mfc": "white", "mec": colour(method)}
            numbers = [
                comparison.measurement(model, drawn_kind, measure) for model in models_by_n.values()
            ]
            drawn.append(_line(f"{method} {drawn_kind.label}", range(last + 1), numbers, look))
        for model in reference_models:
            mean = comparison.measurement(model, kind, measure).mean
            look = {"color": shades[model], "ls": DASHES[2]}
            drawn.append(Line(model, (-0.3, last), (mean, mean), look))
        lines(axis, drawn)
        axis.set(xlim=(-0.3, last + 0.3), xlabel="N of N-way")
        _name(axis, measure, drawn, [str(n) for n in models_by_n], gap=0.07)
    return fig


@styled
def cells(
    values: Mapping[tuple[str, str, str], Sequence[NDArray[np.float64]]],
    sizes_m: Sequence[float],
    oracles: Mapping[str, Sequence[float]],
    heading: str,
) -> Figure:
    """A panel per number, a line per model over the cell sizes, and the oracle's mean recall@1.

    `values` maps a model, protocol and number to the values (sequence,) at each size; `oracles`
    maps a protocol to the mean at each size. Lines are means over the sequences, bars deviations.
    """
    models = list(dict.fromkeys(model for model, _, _ in values))
    panel_in = 0.6 + LINE_IN * max(len(models) + 1, 9)
    fig = figure(WIDTH_IN, 0.3 + 2 * (0.45 + panel_in), heading)
    for axis, measure in zip(
        fig.subplots(2, 2).flat, (AUC, RECALL, AUC_BY_DISTANCE, RECALL_BY_DISTANCE), strict=True
    ):
        # a measurement is of values (seed, sequence, repeat)
        drawn = _over(
            {
                model: [Measurement(np.reshape(numbers, (1, -1, 1))) for numbers in by_size]
                for (model, *number), by_size in values.items()
                if number == [measure.protocol, measure.name]
            }
        )
        if measure.name == "recall_at_1":
            drawn.append(oracle(range(len(sizes_m)), oracles[measure.protocol]))
        lines(axis, drawn)
        _name(axis, measure, drawn, [f"{side_m:g} m" for side_m in sizes_m], LINE_IN / panel_in)
    return fig


def _over(numbers: Mapping[str, Sequence[Measurement]]) -> list[Line]:
    """A line per model over its measurements, slightly beside those of other models."""
    drawn = []
    for i, (model, model_look) in enumerate(look(numbers).items()):
        x = np.arange(len(numbers[model])) + SPREAD * ((i + 0.5) / len(numbers) - 0.5)
        drawn.append(_line(model, x, numbers[model], model_look | {"marker": marker(model)}))
    return drawn


def _line(name: str, x: object, numbers: Sequence[Measurement], look: Mapping[str, object]) -> Line:
    """A line through means, with deviations over the test sequences as bars."""
    mean, low, high = _intervals(numbers).T
    return Line(name, x, mean, look, (low, high))


def _name(
    axis: Axes, measure: Measure, drawn: Sequence[Line], ticks: Sequence[str], gap: float
) -> None:
    """Scale a panel of a measure over ticks, whose y axis others may share, and name its lines."""
    axis.set_xticks(range(len(ticks)), ticks)
    axis.set_title(measure.title, loc="left", pad=8)
    scale_shares(axis.get_shared_y_axes().get_siblings(axis), measure.relative)
    name_ends(axis, drawn, gap)


def _intervals(numbers: Sequence[Measurement], over: str = "over_sequences") -> NDArray[np.float64]:
    """The mean of each measurement, and a deviation below and above it (n, 3)."""
    means = np.array([number.mean for number in numbers])
    deviations = np.array([getattr(number, over) for number in numbers])
    return np.stack([means, means - deviations, means + deviations], axis=1)


def _rows(
    axis: Axes,
    models: Sequence[str],
    numbers: Sequence[Measurement],
    marker: str = "o",
    is_filled: bool = True,
    lift: float = 0.0,
    over: str = "over_sequences",
) -> None:
    """Draw a marker in the row of each model, `lift` rows below its middle."""
    shades = tints(models).values()
    for row, (tint, values) in enumerate(zip(shades, _intervals(numbers, over), strict=True)):
        dots(axis, [row + lift], values, tint, across=True, is_filled=is_filled, marker=marker)


def _scale_x(axis: Axes, measure: Measure) -> None:
    """Scale x to shares up to 1, or to degrees from 0; a line marks where nothing is lost."""
    limits = share_limits(axis.dataLim.intervalx)
    axis.set_xlim(*((0.0, max(limits[1], 5.5)) if measure is HEADING_ERROR else limits))
    if measure.relative:
        axis.axvline(1.0, **MARK)
    axis.set_xlabel(measure.title)
    axis.grid(axis="both")
    axis.tick_params(axis="y", left=False)
