"""Fig. 10 of the SCI paper and similar ones: dots that show each model's numbers beside each other, as driven and altered."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.report.comparison import AUC, AUROC, FAR, OFF, RECALL, Comparison, Kind, Measure, label
from pipeline.report.figures.panels import means_of, name_rows, share_limits
from pipeline.report.figures.style import DASHED, QUIET, WIDTH_IN, below, dot, figure, styled, tints

MARKERS = "osD^vP"


@styled
def dots(comparison: Comparison, measures: Sequence[Measure], by: Kind, simulated: bool, heading: str) -> Figure:
    """A row a model, the best AUC in the kind `by` above; a panel a measure, a marker a kind, bars: deviations over sequences."""
    models, kinds = comparison.ordered(by, AUC), comparison.kinds
    lifts = np.linspace(-0.33, 0.33, len(kinds)) if len(kinds) > 2 else np.zeros(len(kinds))
    fig = figure(WIDTH_IN, 0.95 + 0.17 * max(1.0, len(kinds) / 3) * len(models), simulated, heading)
    axes = fig.subplots(1, len(measures), squeeze=False, sharey=True)[0]
    for axis, measure in zip(axes, measures, strict=True):
        found = [means_of([comparison.found(model, kind, measure) for model in models]) for kind in kinds]
        for i, values in enumerate(found):
            if i or not measure.relative:
                _row(axis, models, values, MARKERS[i % len(MARKERS)], i > 0, lifts[i])
        if len(kinds) == 2 and not measure.relative:
            axis.hlines(range(len(models)), found[0][0], found[1][0], color="0.75", lw=1.0, zorder=1)
        _scale(axis, measure)
    name_rows(axes[0], tints(models))
    below(fig, [dot(label(kind), marker=MARKERS[i % len(MARKERS)], full=i > 0) for i, kind in enumerate(kinds)])
    return fig


@styled
def sequences(comparison: Comparison, named: Mapping[str, str], simulated: bool, heading: str) -> Figure:
    """As driven: a row of panels a test sequence, titled as `named`, a row a model, the best above; bars: over the seeds."""
    models, measures = comparison.ordered(Kind(), RECALL), (RECALL, AUC, AUROC, FAR)
    fig = figure(WIDTH_IN, 0.4 + (0.42 + 0.145 * len(models)) * len(comparison.sequences), simulated, heading)
    grid = fig.subplots(len(comparison.sequences), len(measures), squeeze=False, sharex="col", sharey=True)
    for i, (row, sequence) in enumerate(zip(grid, comparison.sequences, strict=True)):
        for axis, measure in zip(row, measures, strict=True):
            found = [comparison.found(model, Kind(), measure).on(i) for model in models]
            _row(axis, models, np.array([[one.mean for one in found], [one.over_seeds for one in found]]))
            _scale(axis, measure)
        row[0].set_title(named[sequence], loc="left", pad=4)
        name_rows(row[0], tints(models))
    for axis in grid[:-1].flat:
        axis.set_xlabel("")
    for column in grid.T:
        column[0].set_xlim(*share_limits(*(axis.dataLim.intervalx for axis in column)))
    return fig


def _row(
    axis: Axes, models: Sequence[str], values: NDArray[np.float64], marker: str = "o", full: bool = True, lift: float = 0.0
) -> None:
    """One marker in the row of each model, of means and deviations (2, model)."""
    for y, tint, mean, apart in zip(np.arange(len(models)) + lift, tints(models).values(), *values, strict=True):
        axis.hlines(y, mean - apart, mean + apart, color=tint, lw=0.8, alpha=0.6, zorder=2)
        axis.plot(mean, y, marker, ms=4.5, mfc=tint if full else "white", mec=tint, mew=0.9, zorder=3)


def _scale(axis: Axes, measure: Measure) -> None:
    """Shares up to 1, or degrees from 0; a line where nothing is lost."""
    limits = share_limits(axis.dataLim.intervalx)
    axis.set_xlim(*((0.0, max(limits[1], 5.5)) if measure is OFF else limits))
    if measure.relative:
        axis.axvline(1.0, color=QUIET, lw=0.7, ls=DASHED, zorder=1)
    axis.set_xlabel(measure.title)
    axis.grid(axis="both")
    axis.tick_params(axis="y", left=False)
