"""How a model rejects: its novelty, precision and recall at its thresholds, and calibration."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pipeline.evaluation.calibration import BINS, Reliability, chances, ece, reliability
from pipeline.evaluation.numbers import MEASURES
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.report.figures.panels import balanced, calibration, panels, points, share_limits
from pipeline.report.figures.style import MARK, VEIL, WIDTH_IN, below, dot, figure, styled
from pipeline.report.result import Result, day
from pipeline.report.table import fixed
from pipeline.studies.colours import colour

STEPS = 25  # of a histogram
RIGHT = "#8CC8EE"
MISPLACED = "#D9604C"
UNSEEN = "#1B3C73"
LEGEND = (
    Patch(color=RIGHT, label="seen, placed right"),
    Patch(color=MISPLACED, label="seen, misplaced"),
    Line2D([], [], color=UNSEEN, lw=1.2, label="unseen"),
    Line2D([], [], label="rejected from here on", **MARK),
)
# colour and marker of each kind of novelty, the one in use first; different in grey too
KINDS = (
    ("#111111", "o"),
    ("#DDAA33", "s"),
    ("#BB5566", "^"),
    ("#4477AA", "D"),
    ("#228833", "v"),
    ("#AA3377", "P"),
)
LONG_BAR = 0.15  # an interval may reach so far below the lowest value; the panel cuts a longer one


@styled
def histograms(group: Sequence[Result], protocol: str) -> Figure:
    """Fig. 4 of the SCI paper: densities of a model's novelty, a panel a test sequence.

    Right and misplaced seen queries are stacked; unseen ones are a line.
    """
    kind = group[0].evaluation.kinds[0].replace("_", " ")
    novelties = np.concatenate([result.evaluation.novelty[:, 0] for result in group]).astype(
        np.float64
    )
    novelties = novelties[np.isfinite(novelties)]
    low = novelties.min(initial=0.0)
    high = novelties.max(initial=0.0)
    edges = np.linspace(low, high if high > low else low + 1.0, STEPS + 1)
    rows, columns = balanced(len(group), 5)
    width_in = WIDTH_IN if columns > 1 else 4.8
    height_in = 0.85 + (1.35 if columns > 3 else 1.65) * rows
    fig = figure(
        width_in, height_in, f"{group[0].model}: {kind} of seen and unseen queries, by {protocol}"
    )
    axes = panels(fig, len(group), columns, x=kind, y="density")
    for axis, result in zip(axes, group, strict=True):
        _histogram(axis, result, protocol, edges)
    axes[0].set_xlim(edges[0], edges[-1])
    below(fig, LEGEND, 4 if columns > 1 else 2)
    return fig


def _histogram(axis: Axes, result: Result, protocol: str, edges: NDArray[np.float64]) -> None:
    judgement = result.evaluation.protocol(protocol)
    threshold = result.evaluation.reject_from[0]
    novelty = result.evaluation.novelty[:, 0].astype(np.float64)
    right = judgement.seen & (judgement.true_rank == 0)
    per_query = 1 / (max(int(judgement.seen.sum()), 1) * np.diff(edges)[0])
    right_density, wrong_density = (
        np.histogram(novelty[mask], edges)[0] * per_query
        for mask in (right, judgement.seen & ~right)
    )
    axis.stairs(right_density, edges, fill=True, color=RIGHT, lw=0)
    axis.stairs(
        right_density + wrong_density,
        edges,
        baseline=right_density,
        fill=True,
        color=MISPLACED,
        lw=0,
    )
    if judgement.unseen.any():
        axis.stairs(
            np.histogram(novelty[judgement.unseen], edges, density=True)[0],
            edges,
            color=UNSEEN,
            lw=1.2,
        )
    if edges[0] <= threshold <= edges[-1]:
        axis.axvline(threshold, **MARK)
    auroc = f"AUROC {fixed(result.number(protocol, 'auroc'), 3)}"
    axis.text(
        0.97,
        0.95,
        auroc,
        transform=axis.transAxes,
        ha="right",
        va="top",
        size=7,
        bbox=VEIL,
        zorder=5,
    )
    axis.set_title(result.label, pad=4)


@styled
def rejection(group: Sequence[Result]) -> Figure:
    """Precision and recall of a model at the threshold of each kind of novelty.

    Thresholds are chosen without a test sequence.
    """
    kinds = group[0].evaluation.kinds[: len(KINDS)]
    wanted = group[0].wanted_precision
    fig = figure(WIDTH_IN, 4.2, f"{group[0].model}: precision and recall at the chosen thresholds")
    axes = fig.subplots(2, len(PROTOCOLS), sharex=True, sharey="row")
    for row, name in zip(axes, ("precision", "recall"), strict=True):
        number = MEASURES.index(f"{name}_at_threshold")
        precise = MEASURES.index("precision_at_threshold")
        judgements = [
            [result.evaluation.protocol(protocol) for result in group] for protocol in PROTOCOLS
        ]
        # (protocol, sequence, kind, measure, 3)
        rejections = np.array(
            [[judgement.rejection for judgement in protocol_row] for protocol_row in judgements]
        )
        values = rejections[..., number, :]
        nothing_accepted = np.isnan(rejections[..., precise, 0])
        values[nothing_accepted] = np.nan
        for axis, of_kinds in zip(row, np.moveaxis(values, 2, 1), strict=True):
            for k, (kind_values, (tint, marker)) in enumerate(
                zip(of_kinds[: len(kinds)], KINDS, strict=False)
            ):
                points(
                    axis,
                    np.arange(len(group)) + 0.16 * (k - (len(kinds) - 1) / 2),
                    kind_values,
                    tint,
                    marker,
                )
            axis.set_xlim(-0.5, len(group) - 0.5)
            axis.grid(axis="y")
        cut = np.fmax(values[..., 1], np.nanmin(values[..., 0], initial=0.9) - LONG_BAR)
        row[0].set(ylabel=name, ylim=share_limits(cut))
    for column, protocol in zip(axes.T, PROTOCOLS, strict=True):
        column[0].set_title(f"by {protocol}", pad=6)
        column[0].axhline(wanted, **MARK)
        ticks = [day(result.sequence) for result in group]
        column[1].set_xticks(
            range(len(group)), ticks, rotation=40, ha="right", rotation_mode="anchor"
        )
    fig.align_ylabels(axes[:, 0])
    names = [
        kind.replace("_", " ") + " (in use)" * (i == 0 < len(kinds) - 1)
        for i, kind in enumerate(kinds)
    ]
    kept_precisions = group[0].evaluation.kept_precision[: len(kinds)]
    names = [
        name + f", keeps {precision:.3f}" * (precision < wanted)
        for name, precision in zip(names, kept_precisions, strict=True)
    ]
    entries = [dot(name, tint, marker) for name, (tint, marker) in zip(names, KINDS, strict=False)]
    below(fig, [*entries, Line2D([], [], label=f"wanted precision {wanted:g}", **MARK)], 5)
    return fig


def confidences(results: Sequence[Result]) -> list[tuple[str, Reliability, float]]:
    """Calibration of the raw confidence (1 − cost of the first place) and of the scaled one.

    The scaled one is by temperature. Each with its name, the seen queries (by cells) of all test
    sequences in bins, and its expected calibration error (ECE). Empty where a model has neither.
    """
    parts = [(result.evaluation, result.evaluation.cells.seen) for result in results]
    right = np.concatenate([(e.cells.true_rank == 0)[seen] for e, seen in parts])
    raw = np.concatenate([1.0 - e.cost[seen] for e, seen in parts])
    scaled = np.concatenate([e.confidence[seen] for e, seen in parts])
    if not len(right) or not chances(
        scaled
    ):  # without a confidence, a cost is no chance either, but a distance
        return []
    named_confidences = (("raw: 1 − cost", raw), ("temperature-scaled", scaled))
    return [
        (name, reliability(confidence, right), ece(confidence, right))
        for name, confidence in named_confidences
        if chances(confidence)
    ]


@styled
def diagram(results: Sequence[Result]) -> Figure | None:
    """Share of right answers over confidence: of those with 80 %, are 80 % right?

    Below: the share of the queries in each bin. The mean distance to the diagonal over the queries
    is the ECE. None for a model without confidence.
    """
    if not (calibrations := confidences(results)):
        return None
    model = results[0].model
    count = sum(int(result.evaluation.cells.seen.sum()) for result in results)
    fig = figure(
        WIDTH_IN,
        3.4,
        f"{model}: confidence against the share right, by cells ({count:,} seen queries)",
    )
    axes = fig.subplots(
        2, len(calibrations), sharex=True, sharey="row", squeeze=False, height_ratios=(3.2, 1)
    )
    for (upper, lower), (name, bins, error) in zip(axes.T, calibrations, strict=True):
        calibration(upper, bins, colour(model))
        upper.set_title(name)
        upper.text(0.04, 0.95, f"ECE {error:.3f}", transform=upper.transAxes, va="top")
        lower.stairs(
            bins.count / bins.count.sum(), np.linspace(0, 1, BINS + 1), fill=True, color="0.75"
        )
        lower.set_xlabel("confidence")
    axes[0, 0].set_ylabel("share that is right")
    axes[1, 0].set(ylabel="of queries", ylim=(0, None))
    return fig
