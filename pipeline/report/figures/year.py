"""Fig. 8 of the SCI paper: each model's numbers over the days since training."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.report.comparison import AUC, FAR, RECALL, Measure
from pipeline.report.figures.panels import Line, name_ends, share_limits
from pipeline.report.figures.style import QUIET, WIDTH_IN, figure, look, styled
from pipeline.report.study import Result, by_model, by_sequence, some

PANELS = (AUC, RECALL, FAR)


@styled
def year(results: Sequence[Result], train: str, simulated: bool) -> Figure:
    """Each number of `PANELS` over the days since training, its 95 % interval as a band, and the oracle's recall@1 in grey."""
    fig = figure(WIDTH_IN, 6.2, simulated, f"The year after training on {train[:10]}")
    axes = fig.subplots(len(PANELS), 1, sharex=True)
    for axis, measure in zip(axes, PANELS, strict=True):
        _panel(axis, some(results), measure)
    days = {result.days: result.sequence[:10] for result in results}  # two sequences of one day share a label
    axes[-1].set_xticks(list(days), list(days.values()), rotation=40, ha="right", rotation_mode="anchor")
    axes[-1].set_xlabel("test sequence, spaced by days since training; bands: 95 % intervals")
    return fig


def _panel(axis: Axes, results: Sequence[Result], measure: Measure) -> None:
    looks, protocol, name = look(by_model(results)), measure.protocol, measure.name
    lines: list[Line] = []
    for model, group in by_model(results).items():
        (tint, dash), points = looks[model], _points(group, protocol, name)
        bounds = np.array([result.interval(protocol, name) or (np.nan, np.nan) for result in group])
        axis.fill_between(points[:, 0], *bounds.T, color=tint, alpha=0.4 / max(len(looks), 3), lw=0, zorder=1)
        if len(points) == 1:  # a band has no width there
            axis.vlines(points[:, 0], *bounds.T, color=tint, lw=0.9, alpha=0.6)
        axis.plot(*points.T, color=tint, ls=dash, marker="o", ms=4, mec="white", mew=0.6, zorder=3)
        lines.append((model, tint, points))
    oracle = _points([group[0] for group in by_sequence(results).values()], protocol, "oracle")
    axis.plot(*oracle.T, marker="." if len(oracle) == 1 else "", lw=0.8, color="0.6", zorder=2)
    axis.set_ylabel(measure.title)
    axis.set_ylim(*share_limits(axis.dataLim.intervaly))
    axis.grid(axis="y")
    name_ends(axis, [*lines, ("oracle recall@1", QUIET, oracle)], gap=0.088)


def _points(results: Sequence[Result], protocol: str, name: str) -> NDArray[np.float64]:
    """Days and number (sequence, 2); NaN where there is none."""
    return np.array([(result.days, result.number(protocol, name)) for result in results], np.float64)
