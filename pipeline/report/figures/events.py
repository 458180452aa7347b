"""Each model's metrics over the distance to the nearest change: a building built or torn down.

In: rows of the table of results, which are of queries near a change that shows, or near one that
is still to come. Out: one figure; in each band of distance the metrics near changes that show and
near changes to come stand side by side.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.evaluation.rows import NEAR_CHANGE, indexed, pick
from pipeline.evaluation.study_rows import SHOWN, TO_COME
from pipeline.report.figures.panels import draw_dots
from pipeline.report.figures.style import WIDTH_IN, below, dot, figure, folded, styled, tints

NEAR = {"recall_at_1": "recall@1", "auc_exact_top1": "exact AUC"}
OFFSET = 0.13  # of each of the two markers from the middle of a band; bands are 1 apart
PALE = 0.3  # opacity of a value of few queries
# Values near a change that is still to come are drawn grey and hollow.
LATER = "0.6"


@styled
def by_distance(
    rows: pd.DataFrame, models: Sequence[str], bands: Mapping[float, str], least_queries: int
) -> Figure:
    """A row per model, a column per metric and protocol: a value per band with its 95 % interval.

    `bands` maps the farthest distance of a band in metres to its name. Values of fewer than
    `least_queries` seen queries are pale; hollow ones are near a change that is still to come. Bars
    below count the queries.
    """
    shades = tints(models)
    near = pick(rows, ask=NEAR_CHANGE)
    numbers = indexed(near, "of", "method", "protocol", "number", "at")

    def over_bands(when: str, model: str, protocol: str, number: str) -> NDArray[np.float64]:
        """Value, low and high of a metric in each band (band, 3)."""
        return np.array([numbers[when, model, protocol, number, edge_m] for edge_m in bands])

    fig = figure(
        WIDTH_IN,
        1.5 + 0.85 * len(shades),
        "By the distance to the nearest building that went up or came down",
    )
    columns = [(protocol, name) for protocol in PROTOCOLS for name in NEAR]
    axes = fig.subplots(len(shades) + 1, len(columns), squeeze=False, sharex=True, sharey="row")
    for (*panels, counts), (protocol, name) in zip(axes.T, columns, strict=True):
        panels[0].set_title(f"{NEAR[name]}, by {protocol}", pad=5)
        for when, offset, grey in ((TO_COME, OFFSET, "0.75"), (SHOWN, -OFFSET, "0.35")):
            # the queries are the same for all models
            seen = over_bands(when, models[0], protocol, "seen")[:, 0]
            unseen = over_bands(when, models[0], protocol, "unseen")[:, 0]
            for axis, (model, tint) in zip(panels, shades.items(), strict=True):
                is_shown = when == SHOWN
                for band, interval in enumerate(over_bands(when, model, protocol, name)):
                    alpha = PALE if seen[band] < least_queries else 1.0
                    ink = tint if is_shown else LATER
                    draw_dots(axis, [band + offset], interval, ink, is_filled=is_shown, alpha=alpha)
            # recall is of the seen queries, an AUC of all
            queries = seen if name == "recall_at_1" else seen + unseen
            middle = np.arange(len(bands)) + 1.4 * offset
            bars = counts.bar(middle, queries, 2 * OFFSET, color=grey)
            counts.bar_label(bars, size=5.5, color=grey)
        names = [band.replace(" m", "").replace("over ", ">") for band in bands.values()]
        counts.set_xticks(range(len(bands)), names)
        counts.set_xlabel("metres")
    for row, (model, tint) in zip(axes[:-1], shades.items(), strict=True):
        row[0].set_ylabel(folded(model), color=tint, size=7.5)
        row[0].set_ylim(0, 1.04)
    axes[-1, 0].set_ylabel("queries", size=7.5)
    axes[-1, 0].margins(y=0.3)
    axes[-1, 0].set_xlim(-0.5, len(bands) - 0.5)
    for axis in axes.flat:
        axis.grid(axis="y")
    entries = [
        dot("near a change that shows", "0.2"),
        dot("nearer to one still to come", LATER, is_filled=False),
        dot(f"of fewer than {least_queries} seen queries", "0.2", alpha=PALE),
    ]
    below(fig, entries)
    return fig
