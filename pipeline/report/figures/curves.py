"""Curves: metrics over days since training, precision over recall, recall@n, and training.

In: results, each of one model on one test sequence, or the training curves of one model. Out:
figures with a line per model in its own colour, as in the SCI paper (Kim, Park and Kim, RA-L 2019).
A measure is a metric by one protocol, with the title of its panel.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.report.comparison import AUC, AUC_5, AUC_25, RECALL, RECALL_BY_DISTANCE, Measure
from pipeline.report.figures.panels import (
    SLANTED,
    Line,
    balanced,
    draw_lines,
    facets,
    name_ends,
    oracle,
    precision_axes,
    scale_shares,
    share_limits,
)
from pipeline.report.figures.style import (
    MARK,
    WIDTH_IN,
    below,
    figure,
    handles,
    line_styles,
    styled,
)
from pipeline.report.result import PRECISIONS, Result, by_model, by_sequence, day
from pipeline.studies.colours import colour, marker

# The style of a marker on a line.
DOT: Any = {"ls": "", "ms": 4, "mec": "white", "mew": 0.6, "zorder": 4}
PAGE_IN = (5.2, 3.6)  # width and height of a figure on the first screen of the page
YEAR_HEIGHT_IN = 6.2  # of the figure of `year` with its panels OVER_THE_YEAR
# Height that a model's name takes beside a panel of `year`: 0.088 of a panel where three share
# YEAR_HEIGHT_IN keeps names from touching.
NAME_IN = 0.088 * YEAR_HEIGHT_IN / 3
RECALL_NAME_GAP = 0.08  # between models' names in `recall_at`, as a fraction of the y axis
MANY_MODELS = 3  # from this many models on, a row has fewer and larger panels
VALIDATION = "validation_"  # how the name of a training curve on validation blocks begins
FRACTION_ENDINGS = ("accuracy", "recall")  # curves whose names end so lie between 0 and 1
# The panels of `year`, unless it is given others.
OVER_THE_YEAR = (AUC, RECALL, RECALL_BY_DISTANCE)
FIGURE_8 = (AUC, AUC_5, AUC_25)  # the panels of Fig. 8 of the SCI paper


@styled
def year(
    results: Sequence[Result],
    training_sequence: str,
    measures: Sequence[Measure] = OVER_THE_YEAR,
    size_in: tuple[float, float] = (WIDTH_IN, YEAR_HEIGHT_IN),
) -> Figure:
    """Metrics over the days since training, a panel per measure, as in Fig. 8 of the SCI paper.

    Bands are 95 % intervals. Grey is the recall@1 of the oracle, which answers with the place of
    the nearest training anchor. A marker is tagged with its result's id as its SVG id (gid).
    """
    groups = by_model(results)
    label_by_day = {result.days: day(result.sequence) for result in results}
    # the oracle's recall is the same in the results of all models
    first_of_day = [group[0] for group in by_sequence(results).values()]
    fig = figure(*size_in, f"The year after training on {day(training_sequence)}")
    axes = fig.subplots(len(measures), 1, squeeze=False, sharex=True)[:, 0]
    for axis, measure in zip(axes, measures, strict=True):
        drawn = []
        for model, model_style in line_styles(groups).items():
            group = groups[model]
            rows = [result.values(measure.protocol, measure.name) for result in group]
            value, low, high = np.array(rows).T
            days_since_training = [result.days for result in group]
            drawn.append(Line(model, days_since_training, value, model_style, (low, high)))
            for result, y in zip(group, value, strict=True):
                _mark(axis, result, result.days, y, model_style["color"])
        recalls = [result.number(measure.protocol, "oracle") for result in first_of_day]
        drawn.append(oracle([result.days for result in first_of_day], recalls, "oracle recall@1"))
        draw_lines(axis, drawn, band=True)
        axis.set_ylabel(measure.title)
        scale_shares([axis])
        name_ends(axis, drawn, gap=NAME_IN * len(measures) / size_in[1])
    axes[-1].set_xticks([*label_by_day], [*label_by_day.values()], **SLANTED)
    axes[-1].set_xlabel("test sequence, spaced by days since training; bands: 95 % intervals")
    return fig


def _mark(axis: Axes, result: Result, x: float, y: float, tint: str) -> None:
    """Draw the marker of a result, tagged with the result's id as its SVG id (gid)."""
    axis.plot(x, y, marker(result.model), gid=result.id, color=tint, **DOT)


@styled
def coverage(results: Sequence[Result]) -> Figure:
    """The fraction of one test sequence's queries that can be answered at each target precision.

    Answers are judged by distance. The marker of a model is at its own threshold, and is tagged
    with its result's id as its SVG id (gid).
    """
    styles = line_styles(by_model(results))
    fig = figure(*PAGE_IN, f"What can be answered on {day(results[0].sequence)}")
    axis = fig.subplots()
    backwards = results[::-1]  # the first model is drawn last, on top
    draw_lines(axis, [Line(r.model, PRECISIONS, r.coverage, styles[r.model]) for r in backwards])
    for result in backwards:
        precision = max(result.number("distance", "precision_at_threshold"), PRECISIONS[0])
        answered = result.number("distance", "answered")  # as a fraction of the judged queries
        _mark(axis, result, precision, answered, styles[result.model]["color"])
    axis.set(xlim=(PRECISIONS[0], 1.0), ylim=(0, 1.02), ylabel="of the judged queries answered")
    axis.set_xlabel("of its answers, so many are right, by distance")
    axis.grid(axis="y")
    below(fig, handles(styles), 4)
    return fig


@styled
def precision_recall(results: Sequence[Result], protocol: str) -> Figure:
    """Fig. 6 of the SCI paper: precision over recall, a panel per test sequence.

    The curve has a point for every novelty threshold. The marker is at the model's own threshold
    (absent if it accepts nothing).
    """
    styles = line_styles(by_model(results))
    groups = [*by_sequence(results).values()]
    is_wide = len(groups) > 1
    most_columns = 5 if len(styles) < MANY_MODELS else 3
    _, columns = balanced(len(groups), most_columns)
    fig, panels = facets(
        groups,
        most_columns,
        heading=f"Precision over recall, by {protocol}",
        margin_in=0.85,
        row_in=1.5 if columns > 3 else 2.0,
        width_in=WIDTH_IN if is_wide else 3.5,
        x_label="recall",
        y_label="precision",
    )
    for axis, group in panels:
        for result in reversed(group):
            model_style = styles[result.model]
            precision, recall = result.evaluation.curve(protocol)
            draw_lines(axis, [Line(result.model, recall, precision, model_style)])
            names = ("recall_at_threshold", "precision_at_threshold")
            at_threshold = [result.number(protocol, name) for name in names]
            if np.isfinite(at_threshold).all():
                dot = {"color": model_style["color"], "clip_on": False, **DOT}
                axis.plot(*at_threshold, marker(result.model), **dot)
        precision_axes(axis, group[0].label)
    title = "marker: the model's own threshold, where it accepts anything"
    below(fig, handles(styles), 5 if is_wide else 2, title=title)
    return fig


@styled
def recall_at(results: Sequence[Result]) -> Figure:
    """Recall@n without rejection: the fraction of seen queries whose place is among the first n.

    Each panel judges by one protocol. A model's mean over the test sequences is bold, each sequence
    is faint.
    """
    groups = by_model(results)
    fig = figure(WIDTH_IN, 2.6, "Recall among the first n places")
    axes = fig.subplots(1, len(PROTOCOLS), sharey=True)
    drawn_by_protocol: dict[str, list[Line]] = {protocol: [] for protocol in PROTOCOLS}
    largest_n = 0
    for protocol, drawn in drawn_by_protocol.items():
        for model, model_style in line_styles(groups).items():
            # (sequence, n)
            recalls = np.stack([r.evaluation.protocol(protocol).recall_at for r in groups[model]])
            recalls = recalls[np.isfinite(recalls).all(axis=1)]
            largest_n = recalls.shape[1]
            if len(recalls):
                n = np.arange(1, 1 + largest_n)
                drawn.append(Line.mean(model, n, recalls, model_style | {"lw": 1.6}))
    # the recalls of single sequences: all panels have one scale, in which these fit too
    members = [line.members for drawn in drawn_by_protocol.values() for line in drawn]
    axes[0].set_ylim(*share_limits(*members))
    for axis, (protocol, drawn) in zip(axes, drawn_by_protocol.items(), strict=True):
        draw_lines(axis, drawn)
        ticks = (1, 5, 10, 15, 20, 25)
        axis.set(xlim=(1, 1.05 * largest_n), xlabel="n", title=f"by {protocol}", xticks=ticks)
        axis.grid(axis="y")
        name_ends(axis, drawn, gap=RECALL_NAME_GAP)
    axes[0].set_ylabel("recall@n of the seen queries")
    return fig


@styled
def history(curves: Mapping[str, NDArray[np.float64]], best: int | None, model: str) -> Figure:
    """The training of a model: a panel per metric, its curves on training and validation blocks.

    `curves` maps names to values (round,). A round is an epoch, or in an adversarial training some
    batches for each network and then a validation. `best` is the round whose model was kept, from
    0; None if the model does not say.
    """
    names = sorted({name.removeprefix(VALIDATION) for name in curves})
    rounds = np.arange(1, len(next(iter(curves.values()))) + 1)
    heading = f"{model}: {len(rounds)} rounds"
    if best is not None:
        heading = f"{model}: kept after round {best + 1} of {len(rounds)}"
    row_in = 2.0 if len(names) <= 3 else 1.5
    fig, panels = facets(
        names, most_columns=3, heading=heading, margin_in=0.4, row_in=row_in, shared=False
    )
    for axis, name in panels:
        shape = "o" if len(rounds) < 3 else ""
        tints = {name: ("training", "0.6"), VALIDATION + name: ("validation", colour(model))}
        drawn = [
            Line(label, rounds, curves[key], {"color": tint, "marker": shape})
            for key, (label, tint) in tints.items()
            if key in curves
        ]
        draw_lines(axis, drawn)
        if best is not None:
            kept = drawn[-1]
            tint = kept.style["color"]
            axis.plot(best + 1, kept.y[best], "o", color=tint, clip_on=False, **DOT)
            axis.axvline(best + 1, **MARK)
        axis.set(xlabel="round", ylabel=name.replace("_", " "), xlim=(1, max(len(rounds), 2)))
        axis.set_ylim(0, 1 if name.endswith(FRACTION_ENDINGS) else None)
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    fig.axes[0].legend(loc="best", labelcolor="linecolor", handlelength=1.2)
    return fig
