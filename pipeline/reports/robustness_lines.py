"""Fig. 9 of the SCI paper and SCI's N-way training: lines over how much was changed, and over N."""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.alterations import Case
from pipeline.reports.robustness_answers import Answers
from pipeline.reports.robustness_looks import DASHES, LINE_IN, extent, look
from pipeline.reports.robustness_numbers import AUC, FAR, KEPT, Measure, label
from pipeline.reports.style import QUIET, STYLE, TEXT_WIDTH_IN, colour, figure, name_at_the_end


@matplotlib.rc_context(STYLE)
def levels(answers: Answers, simulated: bool, heading: str, unit: str) -> Figure:
    """Over how much was changed: a panel a measure, a line a model; walls in a second row with what they hide hidden."""
    shadows = sorted({kind.shadow for kind in answers.changes})
    measures = (AUC, KEPT, FAR)
    panel_in = 0.5 + 0.12 * max(len(answers.models), 8)
    fig = figure(TEXT_WIDTH_IN, 0.3 + (0.6 + panel_in) * len(shadows), simulated, heading)
    grid = fig.subplots(len(shadows), len(measures), squeeze=False, sharex=True, sharey="col")
    for row, shadow in zip(grid, shadows, strict=True):
        kinds = [Case(), *sorted((k for k in answers.changes if k.shadow == shadow), key=lambda kind: kind.level)]
        for axis, measure in zip(row, measures, strict=True):
            at = np.arange(len(kinds)) if len(kinds) > 1 else np.zeros(1)
            _lines(axis, answers, kinds, at, measure)
            axis.set_xticks(at, [f"{kind.level:g}" for kind in kinds])
            axis.tick_params(labelbottom=True)
            axis.set_title(measure.title, loc="left", pad=9)
            axis.set_xlabel(unit)
        if len(shadows) > 1 or shadow:
            row[0].set_ylabel("what is behind is hidden" if shadow else "what is behind stays in view")
    for column, measure in enumerate(measures):
        _fit(grid[:, column], measure)
        for axis in grid[:, column]:
            _name_ends(axis, answers, panel_in)
    return fig


@matplotlib.rc_context(STYLE)
def ways(answers: Answers, kind: Case, others: Sequence[str], simulated: bool, heading: str) -> Figure:
    """SCI over how many ways its training images were turned, as driven and turned, beside models that need none of it."""
    found, looks = answers.ways(), look(answers.models)
    fig = figure(TEXT_WIDTH_IN, 2.7, simulated, heading)
    at = np.arange(len(found))
    tint = colour("sci")
    axes = fig.subplots(1, 3)
    for axis, measure in zip(axes, (AUC, KEPT, FAR), strict=True):
        ends: list[tuple[str, str, NDArray[np.float64]]] = []
        for i, case in enumerate((Case(), kind)):
            if not (measure.relative and i == 0):
                numbers = [answers.found(model, case, measure) for model in found.values()]
                means = np.array([one.mean for one in numbers])
                axis.errorbar(
                    at, means, [one.over_sequences for one in numbers], color=tint, lw=1.3, ls=DASHES[1 - i], elinewidth=0.6,
                    marker="o", ms=4, mfc=tint if i else "white", mew=0.8, zorder=3,
                )  # fmt: skip
                ends.append((f"SCI {label(case)}", tint, np.stack([at, means], axis=1)))
        for model in others:
            value = answers.found(model, kind, measure).mean
            axis.axhline(value, color=looks[model][0], lw=1.0, ls=DASHES[2])
            ends.append((model, looks[model][0], np.array([[at[-1], value]])))
        axis.set_xticks(at, [str(n) for n in found])
        axis.set_xlim(-0.3, len(found) - 0.7)
        axis.set_xlabel("N of N-way")
        axis.set_title(measure.title, loc="left", pad=5)
        _fit([axis], measure)
        low, high = axis.get_ylim()
        name_at_the_end(axis, [end for end in ends if np.isfinite(end[2][-1, 1])], gap=(high - low) * 0.07)
    return fig


def _lines(axis: Axes, answers: Answers, kinds: Sequence[Case], at: NDArray[Any], measure: Measure) -> None:
    """A line a model through its means, each model a little beside the others, with deviations over the sequences."""
    looks, models = look(answers.models), answers.models
    for i, model in enumerate(models):
        tint, dash = looks[model]
        found = [answers.found(model, kind, measure) for kind in kinds]
        x = at + 0.24 * ((i + 0.5) / len(models) - 0.5)
        means, apart = np.array([one.mean for one in found]), np.array([one.over_sequences for one in found])
        axis.vlines(x, means - apart, means + apart, color=tint, lw=0.7, alpha=0.45, zorder=1)
        axis.plot(x, means, color=tint, ls=dash, lw=1.1, marker="o", ms=3, mec="white", mew=0.4, zorder=3, label=model)


def _fit(axes: Sequence[Axes] | NDArray[Any], measure: Measure) -> None:
    """One scale for some panels."""
    low, high = extent([axis.dataLim.intervaly for axis in axes])
    for axis in axes:
        axis.set_ylim(low - 0.02 * (high - low), high + 0.03 * (high - low))
        axis.grid(axis="y", lw=0.4, color="0.9")
        axis.set_axisbelow(True)
        if measure.relative:
            axis.axhline(1.0, color=QUIET, lw=0.7, ls=(0, (4, 3)), zorder=1)


def _name_ends(axis: Axes, answers: Answers, panel_in: float) -> None:
    """The models' names right of their lines."""
    looks = look(answers.models)
    ends = [
        (model, looks[model][0], np.asarray(line.get_xydata(), float))
        for model in answers.models
        for line in axis.lines
        if line.get_label() == model and np.isfinite(line.get_xydata()[-1, 1])  # type: ignore[index]
    ]
    low, high = axis.get_ylim()
    if ends:
        name_at_the_end(axis, ends, gap=(high - low) * LINE_IN / panel_in)
