"""What rejecting by each kind of novelty really gave, at thresholds that were chosen without any test sequence."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipeline.evaluation.numbers import MEASURES
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.reports.result import Result, some
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, figure

KINDS = (("#111111", "o"), ("#DDAA33", "s"), ("#BB5566", "^"), ("#4477AA", "D"), ("#228833", "v"), ("#AA3377", "P"))
"""Colour and marker of each kind of novelty, the one in use first: apart in grey too."""
LONG_BAR = 0.15
"""An interval may run so far below the lowest value; a longer one is cut by the panel."""


@matplotlib.rc_context(STYLE)
def rejection(results: Sequence[Result], simulated: bool) -> Figure:
    """Precision, and recall below it, of one method at the threshold of each kind of novelty, by both protocols.

    Bars are 95 % intervals; the line is the precision that the thresholds were chosen for.
    """
    group = sorted(some(results), key=lambda result: result.days)
    kinds, wanted = group[0].evaluation.kinds[: len(KINDS)], group[0].wanted_precision
    heading = f"{group[0].method}: what rejecting at the chosen thresholds gave"
    fig = figure(TEXT_WIDTH_IN, 4.2, simulated, heading)
    axes = fig.subplots(2, len(PROTOCOLS), sharex=True, sharey="row")
    for row, name in zip(axes, ("precision", "recall"), strict=True):
        values = np.stack([[of(r, protocol, f"{name}_at_threshold") for r in group] for protocol in PROTOCOLS])
        for axis, one in zip(row, values[:, :, : len(kinds)], strict=True):
            _draw(axis, one)
        lowest = max(np.nanmin(values[..., 1], initial=0.9), np.nanmin(values[..., 0], initial=0.9) - LONG_BAR)
        row[0].set(ylabel=name, ylim=(max(0.0, np.floor(lowest * 10) / 10), 1.0))
    for column, protocol in zip(axes.T, PROTOCOLS, strict=True):
        column[0].set_title(f"by {protocol}", pad=6)
        if wanted is not None:
            column[0].axhline(wanted, color=QUIET, lw=0.8, ls=(0, (4, 2)), zorder=1)
        ticks = [result.sequence[:10] for result in group]
        column[1].set_xticks(range(len(group)), ticks, rotation=40, ha="right", rotation_mode="anchor")
    fig.align_ylabels(axes[:, 0])
    used = " (in use)" if len(kinds) > 1 else ""
    handles = [
        Line2D([], [], ls="", marker=marker, ms=4, color=tint, mew=0, label=kind.replace("_", " ") + ("" if i else used))
        for i, (kind, (tint, marker)) in enumerate(zip(kinds, KINDS, strict=False))
    ]
    if wanted is not None:
        handles.append(Line2D([], [], color=QUIET, lw=0.8, ls=(0, (4, 2)), label=f"wanted precision {wanted:g}"))
    fig.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 5), frameon=False, handlelength=1.4)
    return fig


def of(result: Result, protocol: str, measure: str) -> NDArray[np.float64]:
    """One of MEASURES of each kind of novelty (kind, 3): value, lowest and highest; NaN where there is none."""
    return result.evaluation.protocol(protocol).rejection[:, MEASURES.index(measure)]


def _draw(axis: Axes, values: NDArray[np.float64]) -> None:
    """Values (sequence, kind, 3), the kinds side by side at each sequence."""
    sequences, kinds, _ = values.shape
    for kind, (tint, marker) in zip(range(kinds), KINDS, strict=False):
        x = np.arange(sequences) + 0.16 * (kind - (kinds - 1) / 2)
        value, low, high = values[:, kind].T
        axis.vlines(x, low, high, color=tint, lw=0.9, alpha=0.6, zorder=2)
        axis.plot(x, value, ls="", marker=marker, ms=3.6, color=tint, mec="white", mew=0.4, zorder=3, clip_on=False)
    axis.set_xlim(-0.5, sequences - 0.5)
    axis.grid(axis="y", lw=0.4, color="0.9")
    axis.set_axisbelow(True)
