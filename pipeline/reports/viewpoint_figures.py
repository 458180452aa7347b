"""Fig. 5 and 6 of paper 2: how methods match a place that is met from another heading."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pipeline.evaluation.numbers import PRECISE
from pipeline.evaluation.viewpoints import MEAN, Judged
from pipeline.reports.plots import SHARES
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, VEIL, balanced, colour, figure, panels
from pipeline.reports.table import mean, number

INDICES = {
    "roc_auc": "ROC-AUC, the paper's index",
    "pr_auc": "PR-AUC, of the correct matches",
    "accuracy": "accuracy within {correct_m:g} m",
    "recall": f"recall of all queries at {PRECISE:.0%} precision",
}
CROWDED = 0.6
"""Where no method is more often right than this, curves fill the left lower corner of a panel."""
ACROSS: Any = {"loc": "outside lower center", "ncols": 6, "frameon": False, "handlelength": 1.4}


@matplotlib.rc_context(STYLE)
def precision_recall(group: Mapping[str, Sequence[Judged]], sequence: str, simulated: bool) -> Figure:
    """Fig. 5: a panel a heading, a curve a method and seed, in one sequence; the method's accuracy stands in the panel.

    Recall is of the method's own correct matches, so curves of methods of unlike accuracy do not compare.
    """
    headings_deg = next(iter(group.values()))[0].headings_deg
    rows, columns = balanced(len(headings_deg), 4)
    fig = figure(TEXT_WIDTH_IN, 0.9 + 1.55 * rows, simulated, f"Precision over recall of the correct matches, {sequence}")
    axes = panels(fig, len(headings_deg), columns, shared=True)
    correct = {method: np.mean([values(judged, "accuracy") for judged in seeds], axis=0) for method, seeds in group.items()}
    crowded = np.max([*correct.values()]) < CROWDED  # curves end at the accuracy, so their right upper corner is free
    corner, step, side = ((0.97, 0.9), -8.5, "right") if crowded else ((0.04, 0.03), 8.5, "left")
    for i, (axis, deg) in enumerate(zip(axes, headings_deg, strict=True)):
        for line, method in enumerate(group if crowded else reversed(list(group))):
            for judged in group[method]:
                precision, recall = judged.curve(i)
                if recall[-1] > 0:
                    axis.plot(recall, precision, color=colour(method), lw=1.1 if len(group[method]) == 1 else 0.8, zorder=3)
            place: Any = {"xycoords": "axes fraction", "textcoords": "offset points", "ha": side}
            told = axis.annotate(number(correct[method][i], 3), corner, (0, step * line), **place)
            told.set(color=colour(method), size=7, zorder=5, bbox=VEIL)
        axis.set(xlim=(0, 1), ylim=(0, 1.02))
        axis.set_xticks(*SHARES)
        axis.set_yticks(*SHARES)
        axis.set_title(f"{deg:g}°", pad=5)
    for axis in axes[columns * (rows - 1) :]:
        axis.set_xlabel("recall of the correct")
    for axis in axes[::columns]:
        axis.set_ylabel("precision")
    fig.legend(handles=handles(group), title="number: accuracy, the share that is correct", title_fontsize=7, **ACROSS)
    return fig


@matplotlib.rc_context(STYLE)
def indices(judged: Mapping[tuple[str, str], Sequence[Judged]], simulated: bool) -> Figure:
    """Fig. 6: each number over the headings, methods side by side; means over sequences and seeds, each of them a faint dot."""
    methods = list(dict.fromkeys(method for method, _ in judged))
    first = next(iter(judged.values()))[0]
    fig = figure(TEXT_WIDTH_IN, 4.4, simulated, "Each index over the heading of the query")
    at = np.arange(len(first.headings_deg))
    for axis, (name, title) in zip(panels(fig, len(INDICES), 2, shared=False), INDICES.items(), strict=True):
        for line, method in enumerate(methods):
            every = np.stack([values(one, name) for (whose, _), seeds in judged.items() if whose == method for one in seeds])
            x = at + 0.5 * ((line + 0.5) / len(methods) - 0.5)
            axis.scatter(np.broadcast_to(x, every.shape), every, 6, colour(method), alpha=0.35, linewidths=0, zorder=2)
            axis.plot(x, means(every), color=colour(method), lw=0.7, marker="o", ms=4, mec="white", mew=0.5, zorder=3)
        _scale(axis)
        if name == "roc_auc":
            axis.axhline(0.5, color=QUIET, lw=0.7, ls=(0, (4, 3)), zorder=1)
        axis.set_xticks(at, [f"{deg:g}°" for deg in first.headings_deg], size=6.5)
        axis.set_title(title.format(correct_m=first.correct_m), pad=5)
        axis.grid(axis="y", lw=0.4, color="0.9")
    fig.legend(handles=handles(methods), **ACROSS)
    return fig


def values(judged: Judged, name: str) -> NDArray[np.float64]:
    """One number at each heading (h,), NaN where there is none."""
    return np.array([one[name] for key, one in judged.numbers().items() if key != MEAN], np.float64)


def means(every: NDArray[np.float64]) -> NDArray[np.float64]:
    """Means (h,) of numbers (n, h) that are there, NaN where none is."""
    return np.array([np.nan if (there := mean(list(column))) is None else there for column in every.T])


def _scale(axis: Axes) -> None:
    """Up to 1, and down to the tenth below all that is shown."""
    shown = np.concatenate([np.asarray(line.get_offsets())[:, 1] for line in axis.collections])
    low = np.floor(np.nanmin(shown, initial=0.9) * 10) / 10
    axis.set_ylim(low - 0.02 * (1 - low), 1 + 0.03 * (1 - low))


def handles(methods: Iterable[str]) -> list[Line2D]:
    """A legend's line for each method."""
    return [Line2D([], [], color=colour(method), lw=1.6, label=method) for method in methods]
