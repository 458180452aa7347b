"""How a model rejects queries that it takes for new: novelty, thresholds and calibration.

In: the results of one model on the test sequences. `histograms` shows the novelty of right, wrong
and unseen queries, `rejection` precision and recall at the threshold of each novelty measure,
and `diagram` whether its confidence is the fraction of its answers that is right.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pipeline.evaluation.calibration import BINS, Reliability, ece, probabilities, reliability
from pipeline.evaluation.numbers import MEASURES
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.report.figures.panels import (
    SLANTED,
    balanced,
    calibration,
    draw_dots,
    facets,
    share_limits,
)
from pipeline.report.figures.style import MARK, VEIL, WIDTH_IN, below, dot, figure, styled
from pipeline.report.result import Result, day
from pipeline.report.table import fixed
from pipeline.studies.colours import colour

HISTOGRAM_BINS = 25
# Colours of the queries of a histogram.
RIGHT = "#8CC8EE"
MISPLACED = "#D9604C"
UNSEEN = "#1B3C73"
LEGEND = (
    Patch(color=RIGHT, label="seen, placed right"),
    Patch(color=MISPLACED, label="seen, misplaced"),
    Line2D([], [], color=UNSEEN, lw=1.2, label="unseen"),
    Line2D([], [], label="rejected from here on", **MARK),
)
# Colour and marker of each novelty measure, the one in use first; they differ in grey too.
KINDS = (
    ("#111111", "o"),
    ("#DDAA33", "s"),
    ("#BB5566", "^"),
    ("#4477AA", "D"),
    ("#228833", "v"),
    ("#AA3377", "P"),
)
LONG_BAR = 0.15  # an interval that reaches farther below the lowest value is cut by the panel


@styled
def histograms(group: Sequence[Result], protocol: str) -> Figure:
    """Densities of a model's novelty, a panel per test sequence.

    It is Fig. 4 of the SCI paper (Kim, Park and Kim, RA-L 2019). Right and misplaced seen queries
    are stacked; unseen queries are a line.
    """
    kind = group[0].evaluation.kinds[0].replace("_", " ")
    novelties = np.concatenate([result.evaluation.novelty[:, 0] for result in group])
    finite = novelties[np.isfinite(novelties)].astype(np.float64)
    low = finite.min(initial=0.0)
    high = finite.max(initial=0.0)
    edges = np.linspace(low, high if high > low else low + 1.0, HISTOGRAM_BINS + 1)
    _, columns = balanced(len(group), 5)
    fig, panels = facets(
        group,
        most_columns=5,
        heading=f"{group[0].model}: {kind} of seen and unseen queries, by {protocol}",
        margin_in=0.85,
        row_in=1.35 if columns > 3 else 1.65,
        width_in=WIDTH_IN if len(group) > 1 else 4.8,
        x_label=kind,
        y_label="density",
    )
    for axis, result in panels:
        _histogram(axis, result, protocol, edges)
    fig.axes[0].set_xlim(edges[0], edges[-1])
    below(fig, LEGEND, 4 if len(group) > 1 else 2)
    return fig


def _histogram(axis: Axes, result: Result, protocol: str, edges: NDArray[np.float64]) -> None:
    """Draw one panel; densities are of all seen, and of all unseen queries."""
    judgement = result.evaluation.protocol(protocol)
    threshold = result.evaluation.reject_from[0]
    novelty = result.evaluation.novelty[:, 0].astype(np.float64)
    is_right = judgement.seen & (judgement.true_rank == 0)
    per_query = 1 / (max(int(judgement.seen.sum()), 1) * np.diff(edges)[0])
    right = np.histogram(novelty[is_right], edges)[0] * per_query
    wrong = np.histogram(novelty[judgement.seen & ~is_right], edges)[0] * per_query
    axis.stairs(right, edges, fill=True, color=RIGHT, lw=0)
    axis.stairs(right + wrong, edges, baseline=right, fill=True, color=MISPLACED, lw=0)
    if judgement.unseen.any():
        unseen = np.histogram(novelty[judgement.unseen], edges, density=True)[0]
        axis.stairs(unseen, edges, color=UNSEEN, lw=1.2)
    if edges[0] <= threshold <= edges[-1]:
        axis.axvline(threshold, **MARK)
    auroc = f"AUROC {fixed(result.number(protocol, 'auroc'), 3)}"
    corner = axis.text(0.97, 0.95, auroc, transform=axis.transAxes, ha="right", va="top")
    corner.set(size=7, bbox=VEIL, zorder=5)
    axis.set_title(result.label, pad=4)


@styled
def rejection(group: Sequence[Result]) -> Figure:
    """Precision and recall of a model at the threshold of each novelty measure.

    Thresholds were chosen on validation blocks of training, for a target precision that a novelty
    measure may not have reached there.
    """
    kinds = group[0].evaluation.kinds[: len(KINDS)]
    target = group[0].target_precision
    fig = figure(WIDTH_IN, 4.2, f"{group[0].model}: precision and recall at the chosen thresholds")
    axes = fig.subplots(2, len(PROTOCOLS), sharex=True, sharey="row")
    # (protocol, sequence, kind, measure, 3): value, low, high
    rejections = np.array(
        [[result.evaluation.protocol(name).rejection for result in group] for name in PROTOCOLS]
    )
    accepts_nothing = np.isnan(rejections[..., MEASURES.index("precision_at_threshold"), 0])
    rejections[accepts_nothing] = np.nan
    for row, name in zip(axes, ("precision", "recall"), strict=True):
        # (protocol, sequence, kind, 3)
        values = rejections[..., MEASURES.index(f"{name}_at_threshold"), :]
        for axis, protocol_values in zip(row, values, strict=True):
            for k, (tint, marker) in enumerate(KINDS[: len(kinds)]):
                x = np.arange(len(group)) + 0.16 * (k - (len(kinds) - 1) / 2)
                draw_dots(axis, x, protocol_values[:, k], tint, marker=marker)
            axis.set_xlim(-0.5, len(group) - 0.5)
            axis.grid(axis="y")
        lowest = np.nanmin(values[..., 0], initial=0.9)
        row[0].set(ylabel=name, ylim=share_limits(np.fmax(values[..., 1], lowest - LONG_BAR)))
    for (upper, lower), protocol in zip(axes.T, PROTOCOLS, strict=True):
        upper.set_title(f"by {protocol}", pad=6)
        upper.axhline(target, **MARK)
        lower.set_xticks(range(len(group)), [day(result.sequence) for result in group], **SLANTED)
    fig.align_ylabels(axes[:, 0])
    entries = []
    for i, (kind, (tint, marker)) in enumerate(zip(kinds, KINDS, strict=False)):
        label = kind.replace("_", " ")
        if i == 0 and len(kinds) > 1:
            label += " (in use)"
        validation_precision = group[0].evaluation.validation_precision[i]
        if validation_precision < target:
            label += f", keeps {validation_precision:.3f}"
        entries.append(dot(label, tint, marker))
    below(fig, [*entries, Line2D([], [], label=f"target precision {target:g}", **MARK)], 5)
    return fig


def confidences(results: Sequence[Result]) -> list[tuple[str, Reliability, float]]:
    """The raw confidence (1 − cost of the first place) and the scaled one: name, bins and ECE.

    The scaled one is by temperature. Queries are seen, and answers right, by cells. Empty if a
    model has neither.
    """
    evaluations = [result.evaluation for result in results]
    right = np.concatenate([(e.cells.true_rank == 0)[e.cells.seen] for e in evaluations])
    raw = np.concatenate([1.0 - e.cost[e.cells.seen] for e in evaluations])
    scaled = np.concatenate([e.confidence[e.cells.seen] for e in evaluations])
    # a method without a confidence has distances as costs, not probabilities
    if not len(right) or not probabilities(scaled):
        return []
    return [
        (name, reliability(confidence, right), ece(confidence, right))
        for name, confidence in (("raw: 1 − cost", raw), ("temperature-scaled", scaled))
        if probabilities(confidence)
    ]


@styled
def diagram(results: Sequence[Result]) -> Figure | None:
    """Fraction of right answers over confidence: of those with 80 %, are 80 % right?

    Below stands the fraction of the queries in each bin. The mean distance to the diagonal over the
    queries is the ECE. None for a model without confidence.
    """
    if not (calibrations := confidences(results)):
        return None
    model = results[0].model
    seen = sum(int(result.evaluation.cells.seen.sum()) for result in results)
    heading = f"{model}: confidence against the share right, by cells ({seen:,} seen queries)"
    fig = figure(WIDTH_IN, 3.4, heading)
    axes = fig.subplots(
        2, len(calibrations), sharex=True, sharey="row", squeeze=False, height_ratios=(3.2, 1)
    )
    for (upper, lower), (name, bins, error) in zip(axes.T, calibrations, strict=True):
        calibration(upper, bins, colour(model))
        upper.set_title(name)
        upper.text(0.04, 0.95, f"ECE {error:.3f}", transform=upper.transAxes, va="top")
        shares = bins.count / bins.count.sum()
        lower.stairs(shares, np.linspace(0, 1, BINS + 1), fill=True, color="0.75")
        lower.set_xlabel("confidence")
    axes[0, 0].set_ylabel("share that is right")
    axes[1, 0].set(ylabel="of queries", ylim=(0, None))
    return fig
