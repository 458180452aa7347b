"""Fig. 8 of the SCI paper: how each method lasts as the days since training go by."""

from collections.abc import Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.reports.result import Result, by_method, by_sequence, some
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, colour, figure, name_at_the_end

PANELS = (
    ("cells", "auc_top1", "AUC, top-1, by cells"),
    ("cells", "recall_at_1", "recall@1 by cells"),
    ("distance", "recall_at_1", "recall@1 by distance"),
)
"""Protocol, number and name of each panel."""


@matplotlib.rc_context(STYLE)
def year(results: Sequence[Result], train: str, simulated: bool) -> Figure:
    """Each number of `PANELS` over the days since training, its 95 % interval as a band, and the oracle's recall@1 in grey."""
    fig = figure(TEXT_WIDTH_IN, 6.2, simulated, f"The year after training on {train[:10]}")
    axes = fig.subplots(len(PANELS), 1, sharex=True)
    for axis, (protocol, name, label) in zip(axes, PANELS, strict=True):
        _draw(axis, some(results), protocol, name)
        axis.set_ylabel(label)
    firsts = [group[0] for group in by_sequence(results).values()]
    ticks = {r.days: r.sequence[:10] for r in firsts}  # two sequences of one day share a label
    axes[-1].set_xticks(list(ticks), list(ticks.values()), rotation=40, ha="right", rotation_mode="anchor")
    axes[-1].set_xlabel("test sequence, spaced by days since training; bands: 95 % intervals")
    return fig


def _draw(axis: Axes, results: Sequence[Result], protocol: str, name: str) -> None:
    lines: list[tuple[str, str, NDArray[np.float64]]] = []
    lowest = []
    alpha = 0.4 / max(len({result.method for result in results}), 3)
    for method, group in by_method(results).items():
        points = _points(group, protocol, name)
        bounds = np.array([r.interval(protocol, name) or (np.nan, np.nan) for r in group])
        axis.fill_between(points[:, 0], *bounds.T, color=colour(method), alpha=alpha, lw=0, zorder=1)
        if len(points) == 1:  # no band has a width there
            axis.vlines(points[:, 0], *bounds.T, color=colour(method), lw=0.9, alpha=0.6)
        axis.plot(points[:, 0], points[:, 1], "-o", ms=4, mec="white", mew=0.6, color=colour(method), zorder=3)
        lines.append((method, colour(method), points))
        lowest += [*points[:, 1], *bounds[:, 0]]
    oracle = _points([group[0] for group in by_sequence(results).values()], protocol, "oracle")
    axis.plot(oracle[:, 0], oracle[:, 1], marker="." if len(oracle) == 1 else "", lw=0.8, color="0.6", zorder=2)
    lines.append(("oracle recall@1", QUIET, oracle))
    low = np.nanmin([*lowest, *oracle[:, 1], 0.9])
    low = float(np.floor(low * 10) / 10)
    axis.set_ylim(low, 1.0 + 0.02 * (1.0 - low))
    axis.grid(axis="y", lw=0.4, color="0.9")
    axis.set_axisbelow(True)
    name_at_the_end(axis, lines, gap=0.09 * (1.0 - low))


def _points(results: Sequence[Result], protocol: str, name: str) -> NDArray[np.float64]:
    """Days and number (sequence, 2); NaN where there is none."""
    values = [(r.days, r.number(protocol, name)) for r in results]
    return np.array([(days, np.nan if value is None else value) for days, value in values], float)
