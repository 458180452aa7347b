"""The papers' curves: precision over recall, recall among the first n places, and the training of a model."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.report.figures.panels import balanced, in_corner, name_ends, panels, precision_axes, share_limits
from pipeline.report.figures.style import DASHED, QUIET, WIDTH_IN, below, figure, handles, look, styled
from pipeline.report.study import Result, by_model, by_sequence, some
from pipeline.report.table import fixed
from pipeline.studies.colours import colour

FEW = 3  # from so many models on, panels are larger
HELD_OUT = "held_out_"
SHARE_ENDINGS = ("accuracy", "recall")  # curves of these names lie between 0 and 1


@styled
def precision_recall(results: Sequence[Result], protocol: str, simulated: bool) -> Figure:
    """Fig. 6 of the SCI paper: a panel a test sequence, a model's exact curve with its area, a dot at its own threshold."""
    groups, looks = by_sequence(some(results)), look(by_model(results))
    rows, columns = balanced(len(groups), 5 if len(looks) < FEW else 3)
    width_in = WIDTH_IN if columns > 1 else 3.5
    fig = figure(width_in, 0.85 + (1.5 if columns > 3 else 2.0) * rows, simulated, f"Precision over recall, by {protocol}")
    for axis, group in zip(panels(fig, len(groups), columns, x="recall", y="precision"), groups.values(), strict=True):
        for line, result in enumerate(reversed(group)):
            (tint, dash), (precision, recall) = looks[result.model], result.evaluation.exact_curve(protocol)
            axis.plot(recall, precision, color=tint, ls=dash, lw=1.0, zorder=3)
            dot = [result.number(protocol, f"{name}_at_threshold") for name in ("recall", "precision")]
            if np.isfinite(dot).all():
                axis.plot(*dot, "o", ms=4, color=tint, mec="white", mew=0.6, clip_on=False, zorder=4)
            in_corner(axis, line, fixed(result.number(protocol, "auc_exact_top1"), 3), tint)
        precision_axes(axis, group[0].label)
    below(fig, handles(looks), 5 if columns > 1 else 2, title="number: exact AUC; dot: the model's own threshold")
    return fig


@styled
def recall_at(results: Sequence[Result], simulated: bool) -> Figure:
    """Recall among the first n places, without rejection: each model's mean over the test sequences, and each sequence faint."""
    groups, looks = by_model(some(results)), look(by_model(results))
    fig = figure(WIDTH_IN, 2.6, simulated, "Recall among the first n places")
    axes = fig.subplots(1, len(PROTOCOLS), sharey=True)
    every = [result.evaluation.protocol(protocol).recall_at for protocol in PROTOCOLS for result in results]
    axes[0].set_ylim(*share_limits(*every))
    for axis, protocol in zip(axes, PROTOCOLS, strict=True):
        means = []
        for model, group in groups.items():
            curves = np.stack([result.evaluation.protocol(protocol).recall_at for result in group])  # (sequence, n)
            curves, (tint, dash) = curves[np.isfinite(curves).all(axis=1)], looks[model]
            if len(curves):
                n, mean = np.arange(1, curves.shape[1] + 1), curves.mean(axis=0)
                axis.plot(n, curves.T, color=tint, lw=0.5, alpha=0.45, zorder=2)
                axis.plot(n, mean, color=tint, ls=dash, lw=1.6, zorder=3)
                means.append((model, tint, np.stack([n, mean], axis=1)))
        axis.set(xlim=(1, 1.05 * len(every[0])), xlabel="n", title=f"by {protocol}", xticks=(1, 5, 10, 15, 20, 25))
        axis.grid(axis="y")
        name_ends(axis, means, gap=0.08)
    axes[0].set_ylabel("recall@n of the seen queries")
    return fig


@styled
def history(curves: Mapping[str, NDArray[np.float64]], best: int | None, model: str, simulated: bool) -> Figure:
    """The training of a model: a panel for each curve (round,), on training and on held-out blocks; `best`, from 0, was kept."""
    names = sorted({name.removeprefix(HELD_OUT) for name in curves})
    rounds = np.arange(1, len(next(iter(curves.values()))) + 1)
    heading = f"{model}: " + (f"{len(rounds)} rounds" if best is None else f"kept after round {best + 1} of {len(rounds)}")
    rows, columns = balanced(len(names), 3)
    fig = figure(WIDTH_IN, 0.4 + (2.0 if rows == 1 else 1.5) * rows, simulated, heading)
    for axis, name in zip(panels(fig, len(names), columns, shared=False), names, strict=True):
        for key, tint, label in ((name, "0.6", "training"), (HELD_OUT + name, colour(model), "held out")):
            if key in curves:
                axis.plot(rounds, curves[key], color=tint, marker="." if len(rounds) < 3 else "", label=label)
        if best is not None:
            last = axis.lines[-1]
            dot = best + 1, np.asarray(last.get_ydata())[best]
            axis.plot(*dot, "o", ms=4, color=last.get_color(), mec="white", mew=0.6, clip_on=False, zorder=4)
            axis.axvline(best + 1, color=QUIET, lw=0.7, ls=DASHED, zorder=1)
        axis.set(xlabel="round", ylabel=name.replace("_", " "), xlim=(1, max(len(rounds), 2)))
        axis.set_ylim(0, 1 if name.endswith(SHARE_ENDINGS) else None)
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    fig.axes[0].legend(loc="best", labelcolor="linecolor", handlelength=1.2)
    return fig
