"""Each method's numbers by the distance to the nearest real change."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.evaluation.events import NUMBERS, Banded
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.reports.ageing_figures import folded
from pipeline.reports.style import STYLE, TEXT_WIDTH_IN, colour, figure

TITLES = {"recall_at_1": "recall@1", "auc_exact_top1": "exact AUC"}
SHOWN, TO_COME = "shown", "to come"
Nearby = Mapping[tuple[str, str, str], Banded]
"""By method, protocol, and whether the nearest change is SHOWN or TO_COME."""
BESIDE = 0.13
"""How far the two stand from the middle of a band."""
PALE = 0.3


@matplotlib.rc_context(STYLE)
def by_distance(nearby: Nearby, names: Sequence[str], few: int, simulated: bool) -> Figure:
    """A row a method and a column a number by each protocol: each band's value with its 95 % interval, pale where of few."""
    methods = list(dict.fromkeys(method for method, _, _ in nearby))
    columns = [(protocol, name) for protocol in PROTOCOLS for name in TITLES]
    heading = "By the distance to the nearest building that went up or came down"
    fig = figure(TEXT_WIDTH_IN, 1.5 + 0.85 * len(methods), simulated, heading)
    axes = fig.subplots(len(methods) + 1, len(columns), squeeze=False, sharex=True, sharey="row")
    for column, (protocol, name) in zip(axes.T, columns, strict=True):
        column[0].set_title(f"{TITLES[name]}, by {protocol}", pad=5)
        for axis, method in zip(column, methods, strict=False):
            for when in (TO_COME, SHOWN):
                _draw(axis, nearby[method, protocol, when], name, few, "0.6" if when == TO_COME else colour(method), when)
            axis.set_ylim(0, 1.04)
        for when in (TO_COME, SHOWN):
            one = nearby[methods[0], protocol, when]
            counted = one.seen if name == "recall_at_1" else one.seen + one.unseen
            tint = "0.75" if when == TO_COME else "0.35"
            bars = column[-1].bar(np.arange(len(names)) + 1.4 * _aside(when), counted, 2 * BESIDE, color=tint)
            column[-1].bar_label(bars, size=5.5, color=tint)
        column[-1].set_xticks(range(len(names)), [name.replace(" m", "").replace("over ", ">") for name in names])
        column[-1].set_xlabel("metres")
    for row, method in zip(axes, methods, strict=False):
        row[0].set_ylabel(folded(method), color=colour(method), size=7.5)
    axes[-1, 0].set_ylabel("queries", size=7.5)
    axes[-1, 0].margins(y=0.3)
    axes[-1, 0].set_xlim(-0.5, len(names) - 0.5)
    for axis in axes.flat:
        axis.grid(axis="y", lw=0.4, color="0.9")
        axis.set_axisbelow(True)
    handles = [
        Line2D([], [], ls="", marker="o", ms=4, color="0.2", label="near a change that shows"),
        Line2D([], [], ls="", marker="o", ms=4, color="0.6", mfc="white", label="nearer to one still to come"),
        Line2D([], [], ls="", marker="o", ms=4, color="0.2", alpha=PALE, label=f"of fewer than {few} seen queries"),
    ]
    fig.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, handlelength=1.4)
    return fig


def _aside(when: str) -> float:
    return BESIDE if when == TO_COME else -BESIDE


def _draw(axis: Axes, banded: Banded, name: str, few: int, tint: str, when: str) -> None:
    value, low, high = banded.values[:, NUMBERS.index(name)].T
    x = np.arange(len(value)) + _aside(when)
    filled: Any = {"mfc": "white"} if when == TO_COME else {"mec": "white", "mew": 0.4}
    for band in np.flatnonzero(np.isfinite(value)):
        alpha = 1.0 if banded.seen[band] >= few else PALE
        axis.vlines(x[band], low[band], high[band], color=tint, lw=0.9, alpha=0.7 * alpha, zorder=2)
        axis.plot(x[band], value[band], "o", ms=3.6, color=tint, alpha=alpha, zorder=3, clip_on=False, **filled)
