"""Each model's numbers over the distance to the nearest real change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.report.figures.panels import points
from pipeline.report.figures.style import WIDTH_IN, below, dot, figure, folded, styled, tints

BESIDE = 0.13  # distance of the two markers from the middle of a band
PALE = 0.3
HOLLOW: Any = {"mfc": "white", "mec": "0.6", "mew": 1.0}


@dataclass(frozen=True, eq=False)
class BandValues:
    """One model by one protocol in each of b bands of distance, over all its test sequences.

    NaN where there is no number.
    """

    seen: NDArray[np.int64]  # (b,) queries
    unseen: NDArray[np.int64]  # (b,)
    recall: NDArray[np.float64]  # (b, 3) recall@1 and its 95 % interval
    auc: NDArray[np.float64]  # (b, 3) the exact AUC and its interval


@styled
def by_distance(
    values: Mapping[tuple[str, str, bool], BandValues], names: Sequence[str], few: int
) -> Figure:
    """A row a model, a column a number by each protocol: values of the bands with 95 % intervals.

    `values` go by model, protocol and whether the change shows already; bands of fewer than `few`
    seen queries are pale.
    """
    shades = tints(dict.fromkeys(model for model, _, _ in values))
    fig = figure(
        WIDTH_IN,
        1.5 + 0.85 * len(shades),
        "By the distance to the nearest building that went up or came down",
    )
    columns = [(protocol, name) for protocol in PROTOCOLS for name in ("recall", "auc")]
    axes = fig.subplots(len(shades) + 1, len(columns), squeeze=False, sharex=True, sharey="row")
    for (*column, counts), (protocol, name) in zip(axes.T, columns, strict=True):
        column[0].set_title(
            f"{'recall@1' if name == 'recall' else 'exact AUC'}, by {protocol}", pad=5
        )
        for is_shown, offset, shade in ((False, BESIDE, "0.75"), (True, -BESIDE, "0.35")):
            for axis, (model, tint) in zip(column, shades.items(), strict=True):
                band_values = values[model, protocol, is_shown]
                numbers = band_values.recall if name == "recall" else band_values.auc
                for band in np.flatnonzero(np.isfinite(numbers[:, 0])):
                    alpha = PALE if band_values.seen[band] < few else 1.0
                    fill = {} if is_shown else HOLLOW
                    points(
                        axis,
                        [band + offset],
                        numbers[[band]],
                        tint if is_shown else "0.6",
                        alpha=alpha,
                        **fill,
                    )
            queries = (
                band_values.seen if name == "recall" else band_values.seen + band_values.unseen
            )
            bars = counts.bar(
                np.arange(len(names)) + 1.4 * offset, queries, 2 * BESIDE, color=shade
            )
            counts.bar_label(bars, size=5.5, color=shade)
        counts.set_xticks(
            range(len(names)), [band.replace(" m", "").replace("over ", ">") for band in names]
        )
        counts.set_xlabel("metres")
    for row, (model, tint) in zip(axes, shades.items(), strict=False):
        row[0].set_ylabel(folded(model), color=tint, size=7.5)
        row[0].set_ylim(0, 1.04)
    axes[-1, 0].set_ylabel("queries", size=7.5)
    axes[-1, 0].margins(y=0.3)
    axes[-1, 0].set_xlim(-0.5, len(names) - 0.5)
    for axis in axes.flat:
        axis.grid(axis="y")
    near = (
        dot("near a change that shows", "0.2"),
        dot("nearer to one still to come", "0.6", full=False),
    )
    below(fig, [*near, dot(f"of fewer than {few} seen queries", "0.2", alpha=PALE)])
    return fig
