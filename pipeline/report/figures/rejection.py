"""Precision and recall where a model rejects, at thresholds that were chosen without any test sequence."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipeline.evaluation.numbers import MEASURES
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.report.figures.panels import share_limits
from pipeline.report.figures.style import DASHED, QUIET, WIDTH_IN, below, dot, figure, styled
from pipeline.report.study import Result, some

KINDS = (("#111111", "o"), ("#DDAA33", "s"), ("#BB5566", "^"), ("#4477AA", "D"), ("#228833", "v"), ("#AA3377", "P"))
"""Colour and marker of each kind of novelty, the one in use first; different in grey too."""
LONG_BAR = 0.15  # an interval may reach so far below the lowest value; the panel cuts a longer one


@styled
def rejection(results: Sequence[Result], simulated: bool) -> Figure:
    """Precision, and recall below it, of one model at the threshold of each kind of novelty; bars are 95 % intervals."""
    group = sorted(some(results), key=lambda result: result.days)
    kinds, wanted = group[0].evaluation.kinds[: len(KINDS)], group[0].wanted_precision
    fig = figure(WIDTH_IN, 4.2, simulated, f"{group[0].model}: precision and recall at the chosen thresholds")
    axes = fig.subplots(2, len(PROTOCOLS), sharex=True, sharey="row")
    for row, name in zip(axes, ("precision", "recall"), strict=True):
        number = MEASURES.index(f"{name}_at_threshold")
        by = [[result.evaluation.protocol(protocol) for result in group] for protocol in PROTOCOLS]
        values = np.array([[one.rejection[:, number] for one in row_of] for row_of in by])  # (protocol, sequence, kind, 3)
        for axis, one in zip(row, values[:, :, : len(kinds)], strict=True):
            _panel(axis, one)
        cut = np.fmax(values[..., 1], np.nanmin(values[..., 0], initial=0.9) - LONG_BAR)
        row[0].set(ylabel=name, ylim=share_limits(cut))
    for column, protocol in zip(axes.T, PROTOCOLS, strict=True):
        column[0].set_title(f"by {protocol}", pad=6)
        column[0].axhline(wanted, color=QUIET, lw=0.8, ls=DASHED, zorder=1)
        ticks = [result.sequence[:10] for result in group]
        column[1].set_xticks(range(len(group)), ticks, rotation=40, ha="right", rotation_mode="anchor")
    fig.align_ylabels(axes[:, 0])
    names = [kind.replace("_", " ") + " (in use)" * (i == 0 < len(kinds) - 1) for i, kind in enumerate(kinds)]
    entries = [dot(name, tint, marker) for name, (tint, marker) in zip(names, KINDS, strict=False)]
    below(fig, [*entries, Line2D([], [], color=QUIET, lw=0.8, ls=DASHED, label=f"wanted precision {wanted:g}")], 5)
    return fig


def _panel(axis: Axes, values: NDArray[np.float64]) -> None:
    """Values (sequence, kind, 3), the kinds side by side at each sequence."""
    sequences, kinds, _ = values.shape
    for kind, (tint, marker) in zip(range(kinds), KINDS, strict=False):
        x = np.arange(sequences) + 0.16 * (kind - (kinds - 1) / 2)
        value, low, high = values[:, kind].T
        axis.vlines(x, low, high, color=tint, lw=0.9, alpha=0.6, zorder=2)
        axis.plot(x, value, ls="", marker=marker, ms=3.6, color=tint, mec="white", mew=0.4, zorder=3, clip_on=False)
    axis.set_xlim(-0.5, sequences - 0.5)
    axis.grid(axis="y")
