"""Whether a method's confidence means what it says: of the answers given with 80 %, are 80 % right?"""

from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.evaluation.calibration import BINS, Reliability, chances, ece, reliability
from pipeline.reports.result import Result, some
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, colour, figure


@dataclass(frozen=True)
class Told:
    """One method's confidences in its answers to the seen queries (by cells) of all its test sequences."""

    name: str
    bins: Reliability
    ece: float


def pooled(results: Sequence[Result]) -> list[Told]:
    """As the method ranks (1 − cost of the first place), and temperature-scaled (its `confidence`); none where it has neither."""
    parts = [(result.evaluation, result.evaluation.cells.seen) for result in some(results)]
    right = np.concatenate([(e.cells.true_rank == 0)[seen] for e, seen in parts])
    raw, scaled = (
        np.concatenate(columns) for columns in zip(*((1.0 - e.cost[s], e.confidence[s]) for e, s in parts), strict=True)
    )
    if not len(right) or not chances(scaled):  # without a confidence, a cost is no chance either, but a distance
        return []
    named = (("raw: 1 − cost", raw), ("temperature-scaled", scaled))
    return [Told(name, reliability(told, right), ece(told, right)) for name, told in named if chances(told)]


@matplotlib.rc_context(STYLE)
def diagram(results: Sequence[Result], simulated: bool) -> Figure:
    """One method's confidence against the share that was right, a panel a confidence; below, how many answers it was told of."""
    method, told = some(results)[0].method, pooled(results)
    count = sum(int(result.evaluation.cells.seen.sum()) for result in results)
    heading = f"{method}: confidence against the share right, by cells ({count:,} seen queries)"
    fig = figure(TEXT_WIDTH_IN, 3.4, simulated, heading)
    axes = fig.subplots(2, max(len(told), 1), sharex=True, sharey="row", squeeze=False, height_ratios=(3.2, 1))
    for (upper, lower), one in zip(axes.T, told, strict=False):
        _draw(upper, one, colour(method))
        lower.stairs(one.bins.count / max(one.bins.count.sum(), 1), np.linspace(0, 1, BINS + 1), fill=True, color="0.75")
        lower.set_xlabel("confidence")
    axes[0, 0].set_ylabel("share that is right")
    axes[1, 0].set_ylabel("of queries")
    axes[1, 0].set_ylim(0, None)
    return fig


def _draw(axis: Axes, told: Told, tint: str) -> None:
    """Points of the bins, with a line each to the diagonal: the calibration error is the mean length of these."""
    full: NDArray[np.bool_] = told.bins.count > 0
    confidence, right = told.bins.confidence[full], told.bins.right[full]
    axis.plot([0, 1], [0, 1], color=QUIET, lw=0.7, ls=(0, (4, 2)), zorder=1)
    axis.vlines(confidence, confidence, right, color="#B2182B", lw=0.9, alpha=0.7, zorder=2)
    axis.plot(confidence, right, "-o", ms=3.6, color=tint, mec="white", mew=0.5, zorder=3)
    axis.set(xlim=(0, 1), ylim=(0, 1), title=told.name)
    axis.text(0.04, 0.95, f"ECE {told.ece:.3f}", transform=axis.transAxes, va="top")
