"""The papers' figures: precision over recall, the year, and how a model was learned."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.reports.result import Result, by_method, by_sequence
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, colour, figure, panels

COLUMNS = 5
VEIL = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6}
"""Behind text that curves may cross."""


@matplotlib.rc_context(STYLE)
def precision_recall(results: Sequence[Result], simulated: bool, top_n: int = 1) -> Figure:
    """Fig. 6 of the SCI paper: one panel a test sequence, one curve a method, a dot at the model's own threshold.

    Each method is named in its panel with its AUC.
    """
    groups = by_sequence(_some(results))
    rows = -(-len(groups) // COLUMNS)
    columns = min(COLUMNS, len(groups))
    fig = figure(max(TEXT_WIDTH_IN * columns / COLUMNS, 3.2), 0.5 + 1.5 * rows if columns > 2 else 0.5 + 2.2 * rows, simulated)
    axes = panels(fig, len(groups), COLUMNS, shared=True)
    for axis, group in zip(axes, groups.values(), strict=True):
        for line, result in enumerate(reversed(group)):
            j, tint = result.judgement, colour(result.method)
            axis.plot(j.recall[top_n - 1], j.precision[top_n - 1], color=tint, clip_on=False, zorder=3)
            threshold = result.numbers["threshold"]
            if threshold is not None:
                at = int(np.abs(j.thresholds - threshold).argmin())
                dot = j.recall[top_n - 1, at], j.precision[top_n - 1, at]
                axis.plot(*dot, "o", ms=3.5, color=tint, mec="white", mew=0.5, zorder=4)
            text = f"{result.method} {j.auc[top_n - 1]:.3f}"
            name = axis.annotate(text, (0.04, 0.03), (0, 9 * line), xycoords="axes fraction", textcoords="offset points")
            name.set(color=tint, size=7, zorder=5, bbox=VEIL)
        axis.set(xlim=(0, 1), ylim=(0, 1))
        axis.set_xticks((0, 0.5, 1), ("0", ".5", "1"))
        axis.set_yticks((0, 0.5, 1), ("0", ".5", "1"))
        axis.set_title(group[0].label, pad=5)
    fig.supxlabel("recall (number: AUC; dot: the model's threshold)", size=8)
    fig.supylabel(f"precision, top-{top_n}" if top_n > 1 else "precision", size=8)
    return fig


@matplotlib.rc_context(STYLE)
def year(results: Sequence[Result], train: str, simulated: bool) -> Figure:
    """Fig. 8 of the SCI paper: AUC (top-1) of each method over the days since training, and the oracle's top-1 in grey."""
    fig = figure(TEXT_WIDTH_IN, 3.1, simulated)
    axis = fig.subplots()
    lines: list[tuple[str, str, NDArray[np.float64]]] = []
    for method, group in by_method(_some(results)).items():
        points = np.array([(r.days, r.judgement.auc[0]) for r in group], float)
        axis.plot(points[:, 0], points[:, 1], "-o", ms=4, mec="white", mew=0.6, color=colour(method), zorder=3)
        lines.append((method, colour(method), points))
    firsts = [group[0] for group in by_sequence(results).values()]
    oracle = np.array([(r.days, np.nan if r.numbers["oracle_top1"] is None else r.numbers["oracle_top1"]) for r in firsts], float)
    axis.plot(oracle[:, 0], oracle[:, 1], "-", lw=0.8, color="0.6", zorder=2)
    lines.append(("oracle top-1", QUIET, oracle))
    values = np.concatenate([points[:, 1] for _, _, points in lines])
    low = min(float(np.floor(np.nanmin(values) * 10) / 10), 0.9)
    axis.set(ylim=(low, 1.0), ylabel="AUC, top-1", xlabel=f"test sequence, spaced by days since training on {train[:10]}")
    ticks = {r.days: r.sequence[:10] for r in firsts}  # two sequences of one day share a label
    axis.set_xticks(list(ticks), list(ticks.values()), rotation=40, ha="right", rotation_mode="anchor")
    axis.grid(axis="y", lw=0.4, color="0.9")
    axis.set_axisbelow(True)
    _name_at_the_end(axis, lines, gap=0.075 * (1.0 - low))
    return fig


@matplotlib.rc_context(STYLE)
def history(
    loss: NDArray[np.float64],
    accuracy: NDArray[np.float64],
    held_out_loss: NDArray[np.float64],
    held_out_accuracy: NDArray[np.float64],
    best_epoch: int,
    method: str,
    simulated: bool,
) -> Figure:
    """How a model was learned, all (epoch,): loss and accuracy on training and held-out blocks; `best_epoch` is 0-based."""
    fig = figure(TEXT_WIDTH_IN, 2.3, simulated)
    epochs = np.arange(1, len(loss) + 1)
    pairs = ((loss, held_out_loss, "cross-entropy [nat]"), (accuracy, held_out_accuracy, "accuracy, top-1"))
    for axis, (train, held_out, what) in zip(fig.subplots(1, 2), pairs, strict=True):
        axis.plot(epochs, train, color="0.6", lw=1.0, marker="." if len(loss) < 3 else "", label="training")
        axis.plot(epochs, held_out, color=colour(method), marker="." if len(loss) < 3 else "", label="held out")
        axis.axvline(best_epoch + 1, color=QUIET, lw=0.7, ls=(0, (4, 3)), zorder=1)
        best = best_epoch + 1, held_out[best_epoch]
        axis.plot(*best, "o", ms=4, color=colour(method), mec="white", mew=0.6, clip_on=False, zorder=4)
        axis.set(xlabel="epoch", ylabel=what, xlim=(1, max(len(loss), 2)), ylim=(0, None if axis is fig.axes[0] else 1))
        axis.xaxis.get_major_locator().set_params(integer=True)
    fig.axes[0].set_title(f"{method}: kept after epoch {best_epoch + 1} of {len(loss)}", loc="left")
    fig.axes[1].legend(frameon=False, loc="lower right", labelcolor="linecolor", handlelength=1.2, fontsize=8)
    return fig


def _some(results: Sequence[Result]) -> Sequence[Result]:
    if not results:
        raise InputError("a figure needs at least one result")
    return results


def _name_at_the_end(axis: Axes, lines: Sequence[tuple[str, str, NDArray[np.float64]]], gap: float) -> None:
    """Write each line's name right of its last point, pushed apart by at least `gap` of the y axis."""
    high = axis.get_ylim()[1]
    ends = sorted(((float(points[-1, 1]) if np.isfinite(points[-1, 1]) else high, name, tint) for name, tint, points in lines))
    right, y = max(points[-1, 0] for _, _, points in lines), -np.inf
    places = [y := max(end, y + gap) for end, _, _ in ends]
    over = max(places[-1] - high, 0.0)
    for place, (_, name, tint) in zip(places, ends, strict=True):
        end = right, place - over
        axis.annotate(name, end, (7, 0), textcoords="offset points", color=tint, va="center", annotation_clip=False)
