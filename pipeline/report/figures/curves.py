"""The papers' curves: numbers over the year, precision over recall, recall@n, and training.

In: the results of some models on the test sequences, or the training curves of one model. Out:
figures with a line per model in its own colour.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.report.comparison import AUC, AUC_5, AUC_25, FAR, RECALL, Measure
from pipeline.report.figures.panels import (
    SLANTED,
    Line,
    balanced,
    course,
    facets,
    name_ends,
    oracle_line,
    precision_axes,
    share_limits,
)
from pipeline.report.figures.style import MARK, WIDTH_IN, below, figure, handles, look, styled
from pipeline.report.result import PRECISIONS, Result, by_model, by_sequence, day
from pipeline.studies.colours import colour, marker

# The look of a marker on a line.
DOT: Any = {"mec": "white", "mew": 0.6, "zorder": 4}
PAGE_IN = (5.2, 3.6)  # width and height of a figure on the first screen of the page
NAME_IN = 0.088 * 6.2 / 3  # height of a model's name beside a panel
MANY_MODELS = 3  # from so many models on, panels are larger
HELD_OUT = "held_out_"  # how the name of a training curve on held-out blocks begins
SHARE_ENDINGS = ("accuracy", "recall")  # curves whose names end so lie between 0 and 1
# The panels of `year`.
OVER_THE_YEAR = (AUC, RECALL, FAR)
FIGURE_8 = (AUC, AUC_5, AUC_25)  # the panels of Fig. 8 of the SCI paper.


@styled
def year(
    results: Sequence[Result],
    train: str,
    measures: Sequence[Measure] = OVER_THE_YEAR,
    size_in: tuple[float, float] = (WIDTH_IN, 6.2),
) -> Figure:
    """Numbers over the days since training, a panel per measure, as in Fig. 8 of the SCI paper.

    Bands are 95 % intervals. Grey is the oracle's recall@1: what answering with the nearest
    training pose would reach. A marker has the id of its result.
    """
    groups = by_model(results)
    first_of_day = [group[0] for group in by_sequence(results).values()]
    fig = figure(*size_in, f"The year after training on {day(train)}")
    axes = fig.subplots(len(measures), 1, squeeze=False, sharex=True)[:, 0]
    for axis, measure in zip(axes, measures, strict=True):
        band_alpha = 0.4 / max(len(groups), 3)
        ends = [
            _over_days(axis, groups[model], measure, line, band_alpha)
            for model, line in look(groups).items()
        ]
        oracle = [result.number(measure.protocol, "oracle") for result in first_of_day]
        driven = [result.days for result in first_of_day]
        ends.append(oracle_line(axis, driven, oracle, "oracle recall@1"))
        axis.set_ylabel(measure.title)
        axis.set_ylim(*share_limits(axis.dataLim.intervaly))
        axis.grid(axis="y")
        name_ends(axis, ends, gap=NAME_IN * len(measures) / size_in[1])
    labels = {result.days: day(result.sequence) for result in results}  # one label a day
    axes[-1].set_xticks([*labels], [*labels.values()], **SLANTED)
    axes[-1].set_xlabel("test sequence, spaced by days since training; bands: 95 % intervals")
    return fig


def _over_days(
    axis: Axes, group: Sequence[Result], measure: Measure, line: Mapping[str, Any], alpha: float
) -> Line:
    """Draw one model's number over the days with a band of its intervals, and return the line."""
    tint = line["color"]
    days = [result.days for result in group]
    rows = [result.values(measure.protocol, measure.name) for result in group]
    values, low, high = np.array(rows).T
    axis.fill_between(days, low, high, color=tint, alpha=alpha, lw=0, zorder=1)
    if len(days) == 1:  # a band has no width there
        axis.vlines(days, low, high, color=tint, lw=0.9, alpha=0.6)
    axis.plot(days, values, zorder=3, **line)
    for result, value in zip(group, values, strict=True):
        shape = marker(result.model)
        axis.plot(result.days, value, shape, ls="", ms=4, gid=result.id, color=tint, **DOT)
    return Line(group[0].model, tint, np.stack([days, values], axis=1))


@styled
def coverage(results: Sequence[Result]) -> Figure:
    """The share of one test sequence's queries that can be answered at each wanted precision.

    Answers are right by distance. The marker of a model is at its own threshold, and has the id of
    its result.
    """
    looks = look(by_model(results))
    fig = figure(*PAGE_IN, f"What can be answered on {day(results[0].sequence)}")
    axis = fig.subplots()
    for result in reversed(results):
        line = looks[result.model]
        axis.plot(PRECISIONS, result.coverage, zorder=3, **line)
        precision = max(result.number("distance", "precision_at_threshold"), PRECISIONS[0])
        share = result.number("distance", "answered")
        axis.plot(
            precision,
            share,
            marker(result.model),
            ls="",
            ms=4,
            gid=result.id,
            color=line["color"],
            **DOT,
        )
    axis.set(xlim=(PRECISIONS[0], 1.0), ylim=(0, 1.02), ylabel="of the judged queries answered")
    axis.set_xlabel("of its answers, so many are right, by distance")
    axis.grid(axis="y")
    below(fig, handles(looks), 4)
    return fig


@styled
def precision_recall(results: Sequence[Result], protocol: str) -> Figure:
    """Fig. 6 of the SCI paper: precision over recall, a panel per test sequence.

    The curve has a point for every novelty; the marker is at the model's own threshold.
    """
    looks = look(by_model(results))
    groups = [*by_sequence(results).values()]
    is_wide = len(groups) > 1
    most_columns = 5 if len(looks) < MANY_MODELS else 3
    _, columns = balanced(len(groups), most_columns)
    fig, panels = facets(
        groups,
        most_columns,
        heading=f"Precision over recall, by {protocol}",
        around_in=0.85,
        row_in=1.5 if columns > 3 else 2.0,
        width_in=WIDTH_IN if is_wide else 3.5,
        x_label="recall",
        y_label="precision",
    )
    for axis, group in panels:
        for result in reversed(group):
            line = looks[result.model]
            precision, recall = result.evaluation.exact_curve(protocol)
            axis.plot(recall, precision, lw=1.0, zorder=3, **line)
            names = ("recall_at_threshold", "precision_at_threshold")
            at_threshold = [result.number(protocol, name) for name in names]
            if np.isfinite(at_threshold).all():
                dot = {"ms": 4.5, "color": line["color"], "clip_on": False, **DOT}
                axis.plot(*at_threshold, marker(result.model), **dot)
        precision_axes(axis, group[0].label)
    title = "marker: the model's own threshold, where it accepts anything"
    below(fig, handles(looks), 5 if is_wide else 2, title=title)
    return fig


@styled
def recall_at(results: Sequence[Result]) -> Figure:
    """The share of seen queries whose place is among the first n, without rejection.

    A model's mean over the test sequences is bold, each sequence is faint.
    """
    groups = by_model(results)
    fig = figure(WIDTH_IN, 2.6, "Recall among the first n places")
    axes = fig.subplots(1, len(PROTOCOLS), sharey=True)
    # protocol and model to the recalls (sequence, n)
    recalls = {
        (protocol, model): np.stack([r.evaluation.protocol(protocol).recall_at for r in group])
        for protocol in PROTOCOLS
        for model, group in groups.items()
    }
    n = np.arange(1, 1 + len(results[0].evaluation.protocol(PROTOCOLS[0]).recall_at))
    axes[0].set_ylim(*share_limits(*recalls.values()))
    for axis, protocol in zip(axes, PROTOCOLS, strict=True):
        ends = []
        for model, line in look(groups).items():
            curves = recalls[protocol, model]
            curves = curves[np.isfinite(curves).all(axis=1)]
            if len(curves):
                mean = course(axis, n, curves, line["color"], ls=line["ls"], lw=1.6)
                ends.append(Line(model, line["color"], np.stack([n, mean], axis=1)))
        ticks = (1, 5, 10, 15, 20, 25)
        axis.set(xlim=(1, 1.05 * len(n)), xlabel="n", title=f"by {protocol}", xticks=ticks)
        axis.grid(axis="y")
        name_ends(axis, ends, gap=0.08)
    axes[0].set_ylabel("recall@n of the seen queries")
    return fig


@styled
def history(curves: Mapping[str, NDArray[np.float64]], best: int | None, model: str) -> Figure:
    """The training of a model: a panel per curve (round,), on training and on held-out blocks.

    `best` is the round whose model was kept, from 0; None if the model does not say.
    """
    names = sorted({name.removeprefix(HELD_OUT) for name in curves})
    rounds = np.arange(1, len(next(iter(curves.values()))) + 1)
    heading = f"{model}: {len(rounds)} rounds"
    if best is not None:
        heading = f"{model}: kept after round {best + 1} of {len(rounds)}"
    row_in = 2.0 if len(names) <= 3 else 1.5
    fig, panels = facets(
        names, most_columns=3, heading=heading, around_in=0.4, row_in=row_in, shared=False
    )
    for axis, name in panels:
        shape = "." if len(rounds) < 3 else ""
        for key, tint, label in (
            (name, "0.6", "training"),
            (HELD_OUT + name, colour(model), "held out"),
        ):
            if key in curves:
                axis.plot(rounds, curves[key], color=tint, marker=shape, label=label)
        if best is not None:
            last = axis.lines[-1]
            axis.plot(
                best + 1,
                np.asarray(last.get_ydata())[best],
                "o",
                ms=4,
                color=last.get_color(),
                clip_on=False,
                **DOT,
            )
            axis.axvline(best + 1, **MARK)
        axis.set(xlabel="round", ylabel=name.replace("_", " "), xlim=(1, max(len(rounds), 2)))
        axis.set_ylim(0, 1 if name.endswith(SHARE_ENDINGS) else None)
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    fig.axes[0].legend(loc="best", labelcolor="linecolor", handlelength=1.2)
    return fig
