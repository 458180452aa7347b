"""Fig. 4 of the SCI paper: the novelty of queries that were placed right, misplaced, or unseen."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pipeline.report.figures.panels import balanced, panels
from pipeline.report.figures.style import DASHED, QUIET, VEIL, WIDTH_IN, below, figure, styled
from pipeline.report.study import Result, some
from pipeline.report.table import fixed

BINS = 25
RIGHT, MISPLACED, UNSEEN = "#8CC8EE", "#D9604C", "#1B3C73"
LEGEND = (
    Patch(color=RIGHT, label="seen, placed right"),
    Patch(color=MISPLACED, label="seen, misplaced"),
    Line2D([], [], color=UNSEEN, lw=1.2, label="unseen"),
    Line2D([], [], color=QUIET, lw=0.9, ls=DASHED, label="rejected from here on"),
)


@styled
def histograms(results: Sequence[Result], protocol: str, simulated: bool) -> Figure:
    """Densities of one model's novelty in use, a panel a test sequence: the seen, right and misplaced stacked, and the unseen."""
    group = sorted(some(results), key=lambda result: result.days)
    kind = group[0].evaluation.kinds[0].replace("_", " ")
    every = np.concatenate([result.evaluation.novelty[:, 0] for result in group]).astype(np.float64)
    every = every[np.isfinite(every)]
    low, high = every.min(initial=0.0), every.max(initial=0.0)
    edges = np.linspace(low, high if high > low else low + 1.0, BINS + 1)
    rows, columns = balanced(len(group), 5)
    heading = f"{group[0].model}: {kind} of seen and unseen queries, by {protocol}"
    fig = figure(WIDTH_IN if columns > 1 else 4.8, 0.85 + (1.35 if columns > 3 else 1.65) * rows, simulated, heading)
    axes = panels(fig, len(group), columns, x=kind, y="density")
    for axis, result in zip(axes, group, strict=True):
        _panel(axis, result, protocol, edges)
    axes[0].set_xlim(edges[0], edges[-1])
    below(fig, LEGEND, 4 if columns > 1 else 2)
    return fig


def _panel(axis: Axes, result: Result, protocol: str, edges: NDArray[np.float64]) -> None:
    by, threshold = result.evaluation.protocol(protocol), result.evaluation.reject_from[0]
    novelty, right = result.evaluation.novelty[:, 0].astype(np.float64), by.seen & (by.true_rank == 0)
    per_query = 1 / (max(int(by.seen.sum()), 1) * np.diff(edges)[0])
    right_density, wrong_density = (np.histogram(novelty[of], edges)[0] * per_query for of in (right, by.seen & ~right))
    axis.stairs(right_density, edges, fill=True, color=RIGHT, lw=0)
    axis.stairs(right_density + wrong_density, edges, baseline=right_density, fill=True, color=MISPLACED, lw=0)
    if by.unseen.any():
        axis.stairs(np.histogram(novelty[by.unseen], edges, density=True)[0], edges, color=UNSEEN, lw=1.2)
    if edges[0] <= threshold <= edges[-1]:
        axis.axvline(threshold, color=QUIET, lw=0.9, ls=DASHED)
    auroc = f"AUROC {fixed(result.number(protocol, 'auroc'), 3)}"
    axis.text(0.97, 0.95, auroc, transform=axis.transAxes, ha="right", va="top", size=7, bbox=VEIL, zorder=5)
    axis.set_title(result.label, pad=4)
