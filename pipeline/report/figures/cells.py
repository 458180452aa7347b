"""Fig. 11 of the SCI paper: each model's numbers over the side of a grid cell."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.report.comparison import AUC, FAR, FAR_AUC, RECALL
from pipeline.report.figures.panels import LINE_IN, model_lines, name_ends, share_limits
from pipeline.report.figures.style import QUIET, WIDTH_IN, figure, styled
from pipeline.report.found import Found

Values = Mapping[tuple[str, str, str], Sequence[NDArray[np.float64]]]
"""Model, protocol and number to one value a test sequence (s,) for each size."""


@styled
def cells(
    values: Values, sizes_m: Sequence[float], oracle: Mapping[str, Sequence[float]], simulated: bool, heading: str
) -> Figure:
    """A panel a number, a line a model: means over the sequences, bars: deviations; the oracle's mean recall@1 by protocol."""
    models = list(dict.fromkeys(model for model, _, _ in values))
    panel_in = 0.6 + LINE_IN * max(len(models) + 1, 9)
    fig = figure(WIDTH_IN, 0.3 + 2 * (0.45 + panel_in), simulated, heading)
    for axis, measure in zip(fig.subplots(2, 2).flat, (AUC, RECALL, FAR_AUC, FAR), strict=True):
        rows = {model: values.get((model, measure.protocol, measure.name), ()) for model in models}
        found = {model: [Found(np.reshape(one, (1, -1, 1))) for one in row] for model, row in rows.items() if len(row)}
        ends = model_lines(axis, found)
        if measure.name == "recall_at_1":
            best = np.stack([np.arange(len(sizes_m)), oracle[measure.protocol]], axis=1)
            axis.plot(*best.T, color="0.6", lw=0.8, marker="." if len(best) == 1 else "", zorder=2)
            ends.append(("oracle", QUIET, best))
        axis.set_ylim(*share_limits(axis.dataLim.intervaly))
        axis.set_xticks(range(len(sizes_m)), [f"{side_m:g} m" for side_m in sizes_m])
        axis.set_title(measure.title, loc="left", pad=8)
        axis.grid(axis="y")
        name_ends(axis, ends, gap=LINE_IN / panel_in)
    return fig
