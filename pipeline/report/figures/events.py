"""Each model's numbers over the distance to the nearest real change."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.study_rows import SHOWN, TO_COME
from pipeline.report.figures.panels import points
from pipeline.report.figures.style import WIDTH_IN, below, dot, figure, folded, styled, tints
from pipeline.report.selection import indexed

NEAR = {"recall_at_1": "recall@1", "auc_exact_top1": "exact AUC"}
BESIDE = 0.13  # distance of the two markers from the middle of a band
PALE = 0.3
HOLLOW: Any = {"mfc": "white", "mec": "0.6", "mew": 1.0}


@styled
def by_distance(
    rows: pd.DataFrame, models: Sequence[str], bands: Mapping[float, str], few: int
) -> Figure:
    """A row a model, a column a number by each protocol: values of the bands with 95 % intervals.

    `bands` are names by the farthest distance in metres. Those of fewer than `few` seen queries are
    pale; hollow ones are near a change that is still to come.
    """
    shades = tints(models)
    numbers = indexed(rows, "change", "method", "protocol", "number", "level")

    def over_bands(when: str, model: str, protocol: str, number: str) -> NDArray[np.float64]:
        return np.array([numbers[when, model, protocol, number, edge] for edge in bands])

    fig = figure(
        WIDTH_IN,
        1.5 + 0.85 * len(shades),
        "By the distance to the nearest building that went up or came down",
    )
    columns = [(protocol, name) for protocol in PROTOCOLS for name in NEAR]
    axes = fig.subplots(len(shades) + 1, len(columns), squeeze=False, sharex=True, sharey="row")
    for (*column, counts), (protocol, name) in zip(axes.T, columns, strict=True):
        column[0].set_title(f"{NEAR[name]}, by {protocol}", pad=5)
        for when, offset, shade in ((TO_COME, BESIDE, "0.75"), (SHOWN, -BESIDE, "0.35")):
            seen = over_bands(when, models[0], protocol, "seen")[:, 0]
            unseen = over_bands(when, models[0], protocol, "unseen")[:, 0]
            for axis, (model, tint) in zip(column, shades.items(), strict=True):
                of_bands = over_bands(when, model, protocol, name)
                for band in np.flatnonzero(np.isfinite(of_bands[:, 0])):
                    look = HOLLOW if when == TO_COME else {}
                    look = look | {"alpha": PALE if seen[band] < few else 1.0}
                    shown_tint = tint if when == SHOWN else "0.6"
                    points(axis, [band + offset], of_bands[[band]], shown_tint, **look)
            queries = seen if name == "recall_at_1" else seen + unseen
            bars = counts.bar(
                np.arange(len(bands)) + 1.4 * offset, queries, 2 * BESIDE, color=shade
            )
            counts.bar_label(bars, size=5.5, color=shade)
        counts.set_xticks(
            range(len(bands)),
            [band.replace(" m", "").replace("over ", ">") for band in bands.values()],
        )
        counts.set_xlabel("metres")
    for row, (model, tint) in zip(axes, shades.items(), strict=False):
        row[0].set_ylabel(folded(model), color=tint, size=7.5)
        row[0].set_ylim(0, 1.04)
    axes[-1, 0].set_ylabel("queries", size=7.5)
    axes[-1, 0].margins(y=0.3)
    axes[-1, 0].set_xlim(-0.5, len(bands) - 0.5)
    for axis in axes.flat:
        axis.grid(axis="y")
    near = (
        dot("near a change that shows", "0.2"),
        dot("nearer to one still to come", "0.6", full=False),
    )
    below(fig, [*near, dot(f"of fewer than {few} seen queries", "0.2", alpha=PALE)])
    return fig
