"""Fig. 4 of the SCI paper: how new the queries looked that were placed right, misplaced, or unseen."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from pipeline.reports.result import Result, some
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, balanced, figure, panels

COLUMNS = 5
BINS = 25
RIGHT, MISPLACED, UNSEEN = "#8CC8EE", "#D9604C", "#1B3C73"


@matplotlib.rc_context(STYLE)
def histograms(results: Sequence[Result], protocol: str, simulated: bool) -> Figure:
    """The novelty in use of one method's seen and unseen queries as densities, a panel a test sequence.

    What was seen is stacked of right and misplaced, so its area is 1 as a whole, like that of the unseen.
    """
    group = sorted(some(results), key=lambda result: result.days)
    kind = group[0].evaluation.kinds[0]
    edges = _edges([result.evaluation.novelty[:, 0] for result in group])
    rows, columns = balanced(len(group), COLUMNS)
    heading = f"{group[0].method}: {kind.replace('_', ' ')} of seen and unseen queries, by {protocol}"
    fig = figure(TEXT_WIDTH_IN if columns > 1 else 3.5, 0.85 + (1.35 if columns > 3 else 1.65) * rows, simulated, heading)
    axes = panels(fig, len(group), columns, shared=True)
    for axis, result in zip(axes, group, strict=True):
        _draw(axis, result, protocol, edges)
    axes[0].set_xlim(edges[0], edges[-1])
    for axis in axes[-columns:]:
        axis.set_xlabel(kind.replace("_", " "))
    for axis in axes[::columns]:
        axis.set_ylabel("density")
    handles = [
        Patch(color=RIGHT, label="seen, placed right"),
        Patch(color=MISPLACED, label="seen, misplaced"),
        Line2D([], [], color=UNSEEN, lw=1.2, label="unseen"),
        Line2D([], [], color=QUIET, lw=0.9, ls=(0, (4, 2)), label="rejected from here on"),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=4 if columns > 1 else 2, frameon=False, handlelength=1.4)
    return fig


def _draw(axis: Axes, result: Result, protocol: str, edges: NDArray[np.float64]) -> None:
    e, j = result.evaluation, result.evaluation.protocol(protocol)
    novelty = e.novelty[:, 0].astype(np.float64)
    right = j.seen & (j.true_rank == 0)
    per_query = 1 / (max(int(j.seen.sum()), 1) * np.diff(edges)[0])
    right_density, wrong_density = (np.histogram(novelty[m], edges)[0] * per_query for m in (right, j.seen & ~right))
    axis.stairs(right_density, edges, fill=True, color=RIGHT, lw=0)
    axis.stairs(right_density + wrong_density, edges, baseline=right_density, fill=True, color=MISPLACED, lw=0)
    if j.unseen.any():
        axis.stairs(np.histogram(novelty[j.unseen], edges, density=True)[0], edges, color=UNSEEN, lw=1.2)
    threshold = e.reject_from[0]
    if edges[0] <= threshold <= edges[-1]:
        axis.axvline(threshold, color=QUIET, lw=0.9, ls=(0, (4, 2)))
    auroc = result.number(protocol, "auroc")
    text = "AUROC –" if auroc is None else f"AUROC {auroc:.3f}"
    axis.text(0.97, 0.95, text, transform=axis.transAxes, ha="right", va="top", size=7)
    axis.set_title(result.label, pad=4)


def _edges(novelties: Sequence[NDArray[np.float32]]) -> NDArray[np.float64]:
    """Edges of the bins, the same in each panel: from 0, or the least novelty where that is negative, to the largest."""
    values = np.concatenate(novelties).astype(np.float64)
    values = values[np.isfinite(values)]
    low, high = min(0.0, values.min(initial=0.0)), values.max(initial=0.0)
    return np.linspace(low, high if high > low else low + 1.0, BINS + 1)
