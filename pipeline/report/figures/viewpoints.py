"""Fig. 5 and 6 of paper 2: how methods match a place from another heading."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.evaluation.numbers import PRECISE
from pipeline.evaluation.viewpoints import MEAN, Judged
from pipeline.report.figures.panels import balanced, in_corner, panels, precision_axes, share_limits
from pipeline.report.figures.style import DASHED, QUIET, WIDTH_IN, below, figure, handles, look, styled
from pipeline.report.table import fixed

INDICES = {
    "roc_auc": "ROC-AUC, the paper's index",
    "pr_auc": "PR-AUC, of the correct matches",
    "accuracy": "accuracy within {correct_m:g} m",
    "recall": f"recall of all queries at {PRECISE:.0%} precision",
}
"""Number of `Judged` and its title."""
CROWDED = 0.6  # where no accuracy is higher, curves fill the lower left corner of a panel and leave the upper right one free


@styled
def precision_recall(group: Mapping[str, Sequence[Judged]], sequence: str, simulated: bool) -> Figure:
    """Fig. 5: a panel a heading, a curve a model and seed, in one sequence; the model's mean accuracy stands in the panel.

    Recall is of the model's own correct matches, so curves of models of different accuracy do not compare.
    """
    headings_deg, looks = next(iter(group.values()))[0].headings_deg, look(group)
    rows, columns = balanced(len(headings_deg), 4)
    fig = figure(WIDTH_IN, 0.9 + 1.55 * rows, simulated, f"Precision over recall of the correct matches, {sequence}")
    axes = panels(fig, len(headings_deg), columns, x="recall of the correct", y="precision")
    numbers = {model: [judged.numbers() for judged in seeds] for model, seeds in group.items()}
    shares = {
        model: [[at["accuracy"] for key, at in one.items() if key != MEAN] for one in seeds] for model, seeds in numbers.items()
    }
    accuracy = {model: np.mean(np.array(seeds, np.float64), axis=0) for model, seeds in shares.items()}
    upper = bool(np.max([*accuracy.values()]) < CROWDED)
    for i, (axis, deg) in enumerate(zip(axes, headings_deg, strict=True)):
        for line, model in enumerate(group if upper else reversed(list(group))):
            tint, dash = looks[model]
            for precision, recall in (judged.curve(i) for judged in group[model]):
                if recall[-1] > 0:
                    axis.plot(recall, precision, color=tint, ls=dash, lw=1.1 if len(group[model]) == 1 else 0.8, zorder=3)
            in_corner(axis, line, fixed(accuracy[model][i], 3), tint, upper)
        precision_axes(axis, f"{deg:g}°")
    below(fig, handles(group), title="number: accuracy, the share that is correct")
    return fig


@styled
def indices(
    values: Mapping[tuple[str, str], NDArray[np.float64]], headings_deg: Sequence[float], correct_m: float, simulated: bool
) -> Figure:
    """Fig. 6: each number over the headings, models side by side; means of the rows, each of them a faint dot.

    `values` (n, heading), a row a sequence and seed, go by model and number; NaN where there is none.
    """
    looks, at = look(dict.fromkeys(model for model, _ in values)), np.arange(len(headings_deg))
    fig = figure(WIDTH_IN, 4.4, simulated, "Each index over the heading of the query")
    for axis, (name, title) in zip(panels(fig, len(INDICES), 2, shared=False), INDICES.items(), strict=True):
        for i, (model, (tint, dash)) in enumerate(looks.items()):
            every, x = np.ma.masked_invalid(values[model, name]), at + 0.5 * ((i + 0.5) / len(looks) - 0.5)
            axis.scatter(np.broadcast_to(x, every.shape), every, 6, tint, alpha=0.35, linewidths=0, zorder=2)
            means = every.mean(axis=0).filled(np.nan)
            axis.plot(x, means, color=tint, ls=dash, lw=0.7, marker="o", ms=4, mec="white", mew=0.5, zorder=3)
        axis.set_ylim(*share_limits(*(values[model, name] for model in looks)))
        if name == "roc_auc":
            axis.axhline(0.5, color=QUIET, lw=0.7, ls=DASHED, zorder=1)
        axis.set_xticks(at, [f"{deg:g}°" for deg in headings_deg], size=6.5)
        axis.set_title(title.format(correct_m=correct_m), pad=5)
        axis.grid(axis="y")
    below(fig, handles(looks))
    return fig
