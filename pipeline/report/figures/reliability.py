"""Reliability diagrams: of the answers given with a confidence of 80 %, are 80 % right?"""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from pipeline.evaluation.calibration import BINS, Reliability, chances, ece, reliability
from pipeline.report.figures.style import DASHED, QUIET, WIDTH_IN, figure, styled
from pipeline.report.study import Result, some
from pipeline.studies.colours import colour

OFF = "#B2182B"  # distance to the diagonal, whose mean over the queries is the calibration error (ECE)
Confidence = tuple[str, Reliability, float]
"""Its name, the seen queries (by cells) of all test sequences in bins, and its expected calibration error."""


def confidences(results: Sequence[Result]) -> list[Confidence]:
    """The raw one (1 − cost of the first place) and the temperature-scaled one (`confidence`); none where a model has neither."""
    parts = [(result.evaluation, result.evaluation.cells.seen) for result in some(results)]
    right = np.concatenate([(e.cells.true_rank == 0)[seen] for e, seen in parts])
    raw = np.concatenate([1.0 - e.cost[seen] for e, seen in parts])
    scaled = np.concatenate([e.confidence[seen] for e, seen in parts])
    if not len(right) or not chances(scaled):  # without a confidence, a cost is no chance either, but a distance
        return []
    named = (("raw: 1 − cost", raw), ("temperature-scaled", scaled))
    return [(name, reliability(one, right), ece(one, right)) for name, one in named if chances(one)]


@styled
def diagram(results: Sequence[Result], simulated: bool) -> Figure | None:
    """Confidence against the share that is right, and below it the share of queries in each bin; None of no confidence."""
    model, found = some(results)[0].model, confidences(results)
    if not found:
        return None
    count = sum(int(result.evaluation.cells.seen.sum()) for result in results)
    heading = f"{model}: confidence against the share right, by cells ({count:,} seen queries)"
    fig = figure(WIDTH_IN, 3.4, simulated, heading)
    axes = fig.subplots(2, len(found), sharex=True, sharey="row", squeeze=False, height_ratios=(3.2, 1))
    for (upper, lower), (name, bins, error) in zip(axes.T, found, strict=True):
        full = bins.count > 0
        upper.plot([0, 1], [0, 1], color=QUIET, lw=0.7, ls=DASHED, zorder=1)
        upper.vlines(bins.confidence[full], bins.confidence[full], bins.right[full], color=OFF, lw=0.9, alpha=0.7, zorder=2)
        upper.plot(bins.confidence[full], bins.right[full], "-o", ms=3.6, color=colour(model), mec="white", mew=0.5, zorder=3)
        upper.set(xlim=(0, 1), ylim=(0, 1), title=name)
        upper.text(0.04, 0.95, f"ECE {error:.3f}", transform=upper.transAxes, va="top")
        lower.stairs(bins.count / bins.count.sum(), np.linspace(0, 1, BINS + 1), fill=True, color="0.75")
        lower.set_xlabel("confidence")
    axes[0, 0].set_ylabel("share that is right")
    axes[1, 0].set(ylabel="of queries", ylim=(0, None))
    return fig
