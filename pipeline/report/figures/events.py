"""Each model's numbers over the distance to the nearest real change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.report.figures.style import WIDTH_IN, below, dot, figure, folded, styled, tints

BESIDE = 0.13  # distance of the two markers from the middle of a band
PALE = 0.3


@dataclass(frozen=True, eq=False)
class BandValues:
    """One model by one protocol in each of b bands of distance, over all its test sequences; NaN where there is no number."""

    seen: NDArray[np.int64]  # (b,) queries
    unseen: NDArray[np.int64]  # (b,)
    recall: NDArray[np.float64]  # (b, 3) recall@1 and its 95 % interval
    auc: NDArray[np.float64]  # (b, 3) the exact AUC and its interval


@styled
def by_distance(values: Mapping[tuple[str, str, bool], BandValues], names: Sequence[str], few: int, simulated: bool) -> Figure:
    """A row a model and a column a number by each protocol: each band's value with its 95 % interval.

    `values` go by model, protocol and whether the change shows already; bands of fewer than `few` seen queries are pale.
    """
    shades = tints(dict.fromkeys(model for model, _, _ in values))
    heading = "By the distance to the nearest building that went up or came down"
    fig = figure(WIDTH_IN, 1.5 + 0.85 * len(shades), simulated, heading)
    columns = [(protocol, name) for protocol in PROTOCOLS for name in ("recall", "auc")]
    axes = fig.subplots(len(shades) + 1, len(columns), squeeze=False, sharex=True, sharey="row")
    for (*column, counts), (protocol, name) in zip(axes.T, columns, strict=True):
        column[0].set_title(f"{'recall@1' if name == 'recall' else 'exact AUC'}, by {protocol}", pad=5)
        for shown in (False, True):
            for axis, (model, tint) in zip(column, shades.items(), strict=True):
                one = values[model, protocol, shown]
                _panel(axis, one.recall if name == "recall" else one.auc, one.seen < few, tint if shown else "0.6", shown)
            queries = one.seen if name == "recall" else one.seen + one.unseen
            x, shade = np.arange(len(names)) + 1.4 * (-BESIDE if shown else BESIDE), "0.35" if shown else "0.75"
            counts.bar_label(counts.bar(x, queries, 2 * BESIDE, color=shade), size=5.5, color=shade)
        counts.set_xticks(range(len(names)), [band.replace(" m", "").replace("over ", ">") for band in names])
        counts.set_xlabel("metres")
    for row, (model, tint) in zip(axes, shades.items(), strict=False):
        row[0].set_ylabel(folded(model), color=tint, size=7.5)
        row[0].set_ylim(0, 1.04)
    axes[-1, 0].set_ylabel("queries", size=7.5)
    axes[-1, 0].margins(y=0.3)
    axes[-1, 0].set_xlim(-0.5, len(names) - 0.5)
    for axis in axes.flat:
        axis.grid(axis="y")
    near = dot("near a change that shows", "0.2"), dot("nearer to one still to come", "0.6", full=False)
    below(fig, [*near, dot(f"of fewer than {few} seen queries", "0.2", alpha=PALE)])
    return fig


def _panel(axis: Axes, values: NDArray[np.float64], pale: NDArray[np.bool_], tint: str, shown: bool) -> None:
    """A marker a band of values (b, 3), filled where the change shows."""
    fill: Any = {"mec": "white", "mew": 0.4} if shown else {"mfc": "white"}
    for band in np.flatnonzero(np.isfinite(values[:, 0])):
        x, alpha, (value, low, high) = band + (-BESIDE if shown else BESIDE), PALE if pale[band] else 1.0, values[band]
        axis.vlines(x, low, high, color=tint, lw=0.9, alpha=0.7 * alpha, zorder=2)
        axis.plot(x, value, "o", ms=3.6, color=tint, alpha=alpha, zorder=3, clip_on=False, **fill)
