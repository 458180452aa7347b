"""The papers' curves: precision over recall, recall among the first n, and how a model was learned."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipeline.evaluation.counts import ExactCounts
from pipeline.evaluation.numbers import curve
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.reports.result import Result, by_method, by_sequence, some
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, VEIL, balanced, colour, figure, name_at_the_end, panels

COLUMNS = 5
FEW = 3
"""From so many methods on, panels are larger."""
HELD_OUT = "held_out_"
SHARE_ENDINGS = ("accuracy", "recall")
"""Curves of these names lie between 0 and 1."""
SHARES = (0.0, 0.5, 1.0), ("0", ".5", "1")
"""Ticks of an axis from 0 to 1 in a small panel."""


@matplotlib.rc_context(STYLE)
def precision_recall(results: Sequence[Result], protocol: str, simulated: bool) -> Figure:
    """Fig. 6 of the SCI paper: one panel a test sequence, one curve a method, a dot at the model's own threshold.

    The curve is the exact one, through every novelty that was met; the area under it stands in the panel, in the method's colour.
    """
    groups, methods = by_sequence(some(results)), list(by_method(results))
    rows, columns = balanced(len(groups), COLUMNS if len(methods) < FEW else 3)
    width_in = TEXT_WIDTH_IN if columns > 1 else 3.5
    fig = figure(width_in, 0.85 + (1.5 if columns > 3 else 2.0) * rows, simulated, f"Precision over recall, by {protocol}")
    axes = panels(fig, len(groups), columns, shared=True)
    for axis, group in zip(axes, groups.values(), strict=True):
        for line, result in enumerate(reversed(group)):
            tint, (precision, recall) = colour(result.method), exact(result, protocol)
            axis.plot(recall, precision, color=tint, lw=1.0, zorder=3)
            x, y = (result.number(protocol, f"{name}_at_threshold") for name in ("recall", "precision"))
            if x is not None and y is not None:
                axis.plot(x, y, "o", ms=4, color=tint, mec="white", mew=0.6, clip_on=False, zorder=4)
            area = result.number(protocol, "auc_exact_top1")
            place: Any = {"xycoords": "axes fraction", "textcoords": "offset points"}
            name = axis.annotate("–" if area is None else f"{area:.3f}", (0.04, 0.03), (0, 8.5 * line), **place)
            name.set(color=tint, size=7, zorder=5, bbox=VEIL)
        axis.set(xlim=(0, 1), ylim=(0, 1.02))
        axis.set_xticks(*SHARES)
        axis.set_yticks(*SHARES)
        axis.set_title(group[0].label, pad=5)
    for axis in axes[columns * (rows - 1) :]:
        axis.set_xlabel("recall")
    for axis in axes[::columns]:
        axis.set_ylabel("precision")
    handles = [Line2D([], [], color=colour(method), lw=1.6, label=method) for method in methods]
    across: Any = {"loc": "outside lower center", "ncols": 5 if columns > 1 else 2, "frameon": False, "handlelength": 1.4}
    fig.legend(handles=handles, title="number: exact AUC; dot: the model's own threshold", title_fontsize=7, **across)
    return fig


def exact(result: Result, protocol: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Precision and recall of the first answer at every distinct novelty in use, from nothing accepted to everything."""
    truth, novelty = result.evaluation.truth(protocol), result.evaluation.novelty[:, 0]
    counts = ExactCounts(truth, novelty, np.ones((1, len(novelty)))).count(1)
    precision, recall = curve(truth, counts, np.array([float(truth.seen.sum())]))
    return precision[0], recall[0]


@matplotlib.rc_context(STYLE)
def recall_at(results: Sequence[Result], simulated: bool) -> Figure:
    """Recall among the first n places, rejection ignored: the mean over the test sequences of each method, each of them faint."""
    fig = figure(TEXT_WIDTH_IN, 2.6, simulated, "Recall among the first n places")
    axes = fig.subplots(1, len(PROTOCOLS), sharey=True)
    curves = {
        (protocol, method): np.stack([r.evaluation.protocol(protocol).recall_at for r in group])  # (sequence, n)
        for method, group in by_method(some(results)).items()
        for protocol in PROTOCOLS
    }
    low = np.floor(np.nanmin([np.nanmin(curve, initial=0.9) for curve in curves.values()]) * 10) / 10
    axes[0].set_ylim(low, 1.0 + 0.02 * (1.0 - low))
    for axis, protocol in zip(axes, PROTOCOLS, strict=True):
        means = []
        for method in by_method(results):
            curve = curves[protocol, method]
            n, there = np.arange(1, curve.shape[1] + 1), np.isfinite(curve).all(axis=1)
            axis.plot(n, curve[there].T, color=colour(method), lw=0.5, alpha=0.45, zorder=2)
            if there.any():
                axis.plot(n, curve[there].mean(axis=0), color=colour(method), lw=1.6, zorder=3)
                means.append((method, colour(method), np.stack([n, curve[there].mean(axis=0)], axis=1)))
        axis.set(xlim=(1, None), xlabel="n", title=f"by {protocol}")
        axis.set_xticks((1, 5, 10, 15, 20, 25))
        axis.grid(axis="y", lw=0.4, color="0.9")
        if means:
            name_at_the_end(axis, means, gap=0.08 * (1.0 - low))
    axes[0].set_ylabel("recall@n of the seen queries")
    return fig


@matplotlib.rc_context(STYLE)
def history(curves: Mapping[str, NDArray[np.float64]], best: int | None, method: str, simulated: bool) -> Figure:
    """How a model was learned: a panel for each curve (round,), of training and of held-out blocks; `best` was kept, from 0."""
    names = sorted({name.removeprefix(HELD_OUT) for name in curves})
    rounds = np.arange(1, len(next(iter(curves.values()))) + 1)
    heading = f"{method}: " + (f"{len(rounds)} rounds" if best is None else f"kept after round {best + 1} of {len(rounds)}")
    rows, columns = balanced(len(names), 3)
    fig = figure(TEXT_WIDTH_IN, 0.4 + (2.0 if rows == 1 else 1.5) * rows, simulated, heading)
    few = "." if len(rounds) < 3 else ""
    for axis, name in zip(panels(fig, len(names), columns, shared=False), names, strict=True):
        for key, tint, label in ((name, "0.6", "training"), (HELD_OUT + name, colour(method), "held out")):
            if key in curves:
                axis.plot(rounds, curves[key], color=tint, marker=few, label=label)
        if best is not None:
            last = axis.lines[-1]
            dot = best + 1, np.asarray(last.get_ydata())[best]
            axis.plot(*dot, "o", ms=4, color=last.get_color(), mec="white", mew=0.6, clip_on=False, zorder=4)
            axis.axvline(best + 1, color=QUIET, lw=0.7, ls=(0, (4, 3)), zorder=1)
        axis.set(xlabel="round", ylabel=name.replace("_", " "), xlim=(1, max(len(rounds), 2)))
        axis.set_ylim(0, 1 if name.endswith(SHARE_ENDINGS) else None)
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    fig.axes[0].legend(frameon=False, loc="best", labelcolor="linecolor", handlelength=1.2, fontsize=8)
    return fig
