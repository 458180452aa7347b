"""Fig. 9 of the SCI paper and N-way training: lines over how much was changed, and over N."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.report.comparison import AUC, FAR, KEPT, Comparison, Kind, Measure, label
from pipeline.report.figures.panels import LINE_IN, Line, means_of, model_lines, name_ends, share_limits
from pipeline.report.figures.style import DASHED, DASHES, QUIET, WIDTH_IN, figure, look, styled
from pipeline.studies.colours import colour, method_of

MEASURES = (AUC, KEPT, FAR)


@styled
def levels(comparison: Comparison, simulated: bool, heading: str, unit: str) -> Figure:
    """A panel a measure, a line a model, over the level of the change in `unit`; walls with shadow in a second row."""
    models, shadows = comparison.models, sorted({kind.shadow for kind in comparison.changes})
    panel_in = 0.5 + 0.12 * max(len(models), 8)
    fig = figure(WIDTH_IN, 0.3 + (0.6 + panel_in) * len(shadows), simulated, heading)
    grid = fig.subplots(len(shadows), len(MEASURES), squeeze=False, sharex=True, sharey="col")
    for column, measure in zip(grid.T, MEASURES, strict=True):
        ends = []
        for axis, shadow in zip(column, shadows, strict=True):
            changed = sorted((kind for kind in comparison.changes if kind.shadow == shadow), key=lambda kind: kind.level)
            kinds = [Kind(), *changed]
            ends.append(model_lines(axis, {m: [comparison.found(m, kind, measure) for kind in kinds] for m in models}))
            axis.set_xticks(range(len(kinds)), [f"{kind.level:g}" for kind in kinds])
            axis.tick_params(labelbottom=True)
            axis.set_title(measure.title, loc="left", pad=9)
            axis.set_xlabel(unit)
        _scale(column, measure)
        for axis, lines in zip(column, ends, strict=True):
            name_ends(axis, lines, gap=LINE_IN / panel_in)
    for axis, shadow in zip(grid[:, 0], shadows, strict=True):
        if any(shadows):
            axis.set_ylabel("what is behind is hidden" if shadow else "what is behind stays in view")
    return fig


@styled
def ways(comparison: Comparison, kind: Kind, others: Sequence[str], simulated: bool, heading: str) -> Figure:
    """A method over N of its N-way training, as driven and altered; `others` altered, as level lines."""
    found, looks = comparison.ways(), look(comparison.models)
    method, at = method_of(next(iter(found.values()))), np.arange(len(found))
    tint = colour(method)
    fig = figure(WIDTH_IN, 2.7, simulated, heading)
    for axis, measure in zip(fig.subplots(1, len(MEASURES)), MEASURES, strict=True):
        ends: list[Line] = []
        for one in (kind,) if measure.relative else (Kind(), kind):
            dash, fill = ("-", tint) if one == kind else (DASHES[1], "white")
            means, apart = means_of([comparison.found(model, one, measure) for model in found.values()])
            marks: Any = {"marker": "o", "ms": 4, "mfc": fill, "mew": 0.8}
            axis.errorbar(at, means, apart, color=tint, lw=1.3, ls=dash, elinewidth=0.6, zorder=3, **marks)
            ends.append((f"{method} {label(one)}", tint, np.stack([at, means], axis=1)))
        for model in others:
            level = np.array([[-0.3, at[-1]], [comparison.found(model, kind, measure).mean] * 2])
            axis.plot(*level, color=looks[model][0], lw=1.0, ls=DASHES[2])
            ends.append((model, looks[model][0], level.T))
        axis.set_xticks(at, [str(n) for n in found])
        axis.set(xlim=(-0.3, len(found) - 0.7), xlabel="N of N-way")
        axis.set_title(measure.title, loc="left", pad=5)
        _scale([axis], measure)
        name_ends(axis, ends, gap=0.07)
    return fig


def _scale(axes: Iterable[Axes], measure: Measure) -> None:
    """One scale for some panels, and a line where nothing is lost."""
    limits = share_limits(*(axis.dataLim.intervaly for axis in axes))
    for axis in axes:
        axis.set_ylim(*limits)
        axis.grid(axis="y")
        if measure.relative:
            axis.axhline(1.0, color=QUIET, lw=0.7, ls=DASHED, zorder=1)
