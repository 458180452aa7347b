"""Fig. 10 of the SCI paper and its like: dots that show each model's numbers beside each other, as driven and altered."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.alterations import AS_DRIVEN, Case
from pipeline.reports.robustness_answers import Answers
from pipeline.reports.robustness_looks import extent, look
from pipeline.reports.robustness_numbers import AUC, AUROC, FAR, OFF, RECALL, Found, Measure, label
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, figure

MARKERS = "osD^vP"
ROW_IN = 0.17
"""Height of a row of dots."""
BELOW: Any = {"loc": "outside lower center", "ncols": 6, "frameon": False, "handlelength": 1.4}


@matplotlib.rc_context(STYLE)
def dots(answers: Answers, measures: Sequence[Measure], by: Case, simulated: bool, heading: str) -> Figure:
    """A row a model, the best AUC in one kind of case above; a panel a measure, a marker a kind of case.

    Bars are standard deviations over the test sequences.
    """
    models, kinds = answers.ordered(by, AUC), answers.kinds
    fig = figure(TEXT_WIDTH_IN, 0.95 + ROW_IN * max(1.0, len(kinds) / 3) * len(models), simulated, heading)
    axes = fig.subplots(1, len(measures), squeeze=False, sharey=True)[0]
    for axis, measure in zip(axes, measures, strict=True):
        for i, kind in enumerate(kinds):
            if not (measure.relative and kind.change == AS_DRIVEN):
                found = [answers.found(model, kind, measure) for model in models]
                lift = 0.0 if len(kinds) < 3 else 0.66 * (i / (len(kinds) - 1) - 0.5)
                _row(axis, models, found, [one.over_sequences for one in found], MARKERS[i % len(MARKERS)], i > 0, lift)
        if len(kinds) == 2 and not measure.relative:
            ends = [[answers.found(model, kind, measure).mean for model in models] for kind in kinds]
            axis.hlines(range(len(models)), *ends, color="0.75", lw=1.0, zorder=1)
        _scale(axis, measure)
    _name_rows(axes[0], models)
    marks: list[Any] = [_mark(MARKERS[i % len(MARKERS)], i > 0, label(kind)) for i, kind in enumerate(kinds)]
    fig.legend(handles=marks, **BELOW)
    return fig


@matplotlib.rc_context(STYLE)
def sequences(answers: Answers, named: Mapping[str, str], simulated: bool, heading: str) -> Figure:
    """As driven: a row of panels a test sequence, a row a model, the best on average above; bars are deviations over seeds."""
    models, measures = answers.ordered(Case(), RECALL), (RECALL, AUC, AUROC, FAR)
    rows = answers.sequences
    fig = figure(TEXT_WIDTH_IN, 0.4 + (0.42 + 0.145 * len(models)) * len(rows), simulated, heading)
    grid = fig.subplots(len(rows), len(measures), squeeze=False, sharex="col", sharey=True)
    for i, sequence in enumerate(rows):
        for axis, measure in zip(grid[i], measures, strict=True):
            found = [answers.found(model, Case(), measure).on(i) for model in models]
            _row(axis, models, found, [one.over_seeds for one in found], "o", True, 0.0)
        grid[i, 0].set_title(named[sequence], loc="left", pad=4)
        _name_rows(grid[i, 0], models)
    for axis, measure in zip(grid[-1], measures, strict=True):
        _scale(axis, measure)
    for axis in grid[:-1].flat:
        axis.grid(axis="both", lw=0.4, color="0.9")
        axis.set_axisbelow(True)
        axis.tick_params(axis="y", left=False)
    return fig


def _row(
    axis: Axes, models: Sequence[str], found: Sequence[Found], deviations: Sequence[float], marker: str, full: bool, lift: float
) -> None:
    """One marker in the row of each model, with its bar."""
    looks = look(models)
    for y, (model, one, deviation) in enumerate(zip(models, found, deviations, strict=True)):
        if np.isfinite(one.mean):
            tint = looks[model][0]
            if np.isfinite(deviation):
                axis.hlines(y + lift, one.mean - deviation, one.mean + deviation, color=tint, lw=0.8, alpha=0.6, zorder=2)
            mark: Any = {"mfc": tint if full else "white", "mec": tint, "mew": 0.9}
            axis.plot(one.mean, y + lift, marker, ms=4.5, ls="", zorder=3, **mark)


def _name_rows(axis: Axes, models: Sequence[str]) -> None:
    looks = look(models)
    axis.set_yticks(range(len(models)), models, size=7)
    axis.set_ylim(len(models) - 0.4, -0.6)
    for text, model in zip(axis.get_yticklabels(), models, strict=True):
        text.set_color(looks[model][0])


def _scale(axis: Axes, measure: Measure) -> None:
    """Shares up to 1, or degrees from 0; a line where nothing is lost."""
    low, high = extent([axis.dataLim.intervalx])
    axis.set_xlim(*((0.0, 1.1 * max(high, 5.0)) if measure is OFF else (low - 0.02, high + 0.03)))
    if measure.relative:
        axis.axvline(1.0, color=QUIET, lw=0.7, ls=(0, (4, 3)), zorder=1)
    axis.set_xlabel(measure.title)
    axis.grid(axis="both", lw=0.4, color="0.9")
    axis.set_axisbelow(True)
    axis.tick_params(axis="y", left=False)


def _mark(marker: str, full: bool, words: str) -> Line2D:
    return Line2D([], [], ls="", marker=marker, ms=4.5, mfc=QUIET if full else "white", mec=QUIET, mew=0.9, label=words)
