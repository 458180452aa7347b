"""Fig. 5 to 7 of paper 2: matching from another heading, reconstructions, and collapse.

Paper 2 is Yin et al., "Stabilize an Unsupervised Feature Learning for LiDAR-based Place
Recognition" (IROS 2018).

In: how the queries of a sequence, turned to other headings, were matched with the sequence itself;
what networks reconstruct of a view from its code; and the curves of their training.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipeline.evaluation.numbers import PRECISE
from pipeline.evaluation.viewpoint_matches import NUMBERS, ViewpointMatches
from pipeline.report.figures.panels import (
    Line,
    draw_lines,
    facets,
    in_corner,
    precision_axes,
    scale_shares,
)
from pipeline.report.figures.style import (
    MARK,
    QUIET,
    WIDTH_IN,
    below,
    figure,
    handles,
    line_styles,
    styled,
)
from pipeline.report.table import fixed
from pipeline.studies.colours import colour

# The metrics of `ViewpointMatches` that are drawn, and their titles.
INDICES = {
    "roc_auc": "ROC-AUC, the paper's index",
    "pr_auc": "PR-AUC, of the correct matches",
    "accuracy": "accuracy within {correct_m:g} m",
    "recall": f"recall of all queries at {PRECISE:.0%} precision",
}
# The training curves (round,) that are drawn, and their titles. A round is some batches for each
# network, and then a validation.
COLLAPSE = {
    "code_variance": "variance of the codes",
    "code_distance": "mean distance between codes",
    "validation_error": "validation reconstruction error",
}
BLACK = "black_error"  # the curve of a black image's error on the images of `validation_error`
MOST_PICTURES = 8  # beside each other
# If no accuracy is higher, curves fill the lower left corner of a panel, and the numbers stand in
# the upper right one.
CROWDED = 0.6


@styled
def precision_recall(group: Mapping[str, Sequence[ViewpointMatches]], sequence: str) -> Figure:
    """Fig. 5: precision over recall in one sequence: a panel per heading, curves of all models.

    Recall is a fraction of the model's own correct matches, so curves of models of different
    accuracy do not compare. The mean accuracy of each model stands in the panel.
    """
    styles = line_styles(group)
    fig, panels = facets(
        next(iter(group.values()))[0].headings_deg.tolist(),
        most_columns=4,
        heading=f"Precision over recall of the correct matches, {sequence}",
        margin_in=0.9,
        row_in=1.55,
        x_label="recall of the correct",
        y_label="precision",
    )
    accuracy = {
        model: np.mean([judged.values[:, NUMBERS.index("accuracy")] for judged in seeds], axis=0)
        for model, seeds in group.items()
    }
    is_upper = bool(np.max([*accuracy.values()]) < CROWDED)
    models = list(group) if is_upper else list(group)[::-1]
    for i, (axis, deg) in enumerate(panels):
        for lines_away, model in enumerate(models):
            curves = [judged.curve(i) for judged in group[model]]
            line_style = styles[model] | {"lw": 1.1 if len(curves) == 1 else 0.8}
            draw_lines(
                axis,
                [
                    Line(model, recall, precision, line_style)
                    for precision, recall in curves
                    if recall[-1] > 0
                ],
            )
            shown_accuracy = fixed(accuracy[model][i], 3)
            tint = styles[model]["color"]
            in_corner(axis, shown_accuracy, tint, lines_away=lines_away, is_upper=is_upper)
        precision_axes(axis, f"{deg:g}°")
    below(fig, handles(group), title="number: accuracy, the share that is correct")
    return fig


@styled
def indices(
    values: Mapping[tuple[str, str], NDArray[np.float64]],
    headings_deg: Sequence[float],
    correct_m: float,
) -> Figure:
    """Fig. 6: each metric over the headings, models side by side.

    `values` maps a model and metric to its values (sequence and seed, heading), NaN where there is
    none. Lines join their means, and thin lines are single ones.
    """
    styles = line_styles(dict.fromkeys(model for model, _ in values))
    positions = np.arange(len(headings_deg))
    heading = "Each index over the heading of the query"
    fig, panels = facets(
        [*INDICES.items()],
        most_columns=2,
        heading=heading,
        margin_in=0.0,
        row_in=2.2,
        shared=False,
    )
    for axis, (name, title) in panels:
        for i, (model, style) in enumerate(styles.items()):
            x = positions + 0.5 * ((i + 0.5) / len(styles) - 0.5)
            draw_lines(axis, [Line.mean(model, x, values[model, name], style | {"marker": "o"})])
        scale_shares([axis])
        if name == "roc_auc":
            axis.axhline(0.5, **MARK)
        axis.set_xticks(positions, [f"{deg:g}°" for deg in headings_deg], size=6.5)
        axis.set_title(title.format(correct_m=correct_m), pad=5)
    below(fig, handles(styles))
    return fig


@styled
def reconstructions(pictures: Mapping[str, tuple[NDArray[Any], NDArray[Any]]]) -> Figure:
    """Fig. 7: views (heading, side, side) of one place, 0 to 255, and their reconstructions.

    `pictures` maps a model to both. Numbers are mean squared errors.
    """
    rows: list[tuple[str, NDArray[Any], NDArray[Any]]] = []  # name, what was seen, what is shown
    for model, (seen, reconstructed) in pictures.items():
        if not rows or not np.array_equal(rows[-1][1], seen):
            rows.append(("seen", seen, seen))
        rows.append((model, seen, reconstructed))
    headings = max(len(seen) for _, seen, _ in rows)
    columns = range(0, headings, math.ceil(headings / MOST_PICTURES))
    height_in = 0.45 + ((WIDTH_IN - 0.4) / len(columns) + 0.12) * len(rows)
    fig = figure(WIDTH_IN, height_in, "Seen, and reconstructed from a code")
    axes = fig.subplots(len(rows), len(columns), squeeze=False)
    for axes_row, (name, seen, shown) in zip(axes, rows, strict=True):
        for axis, i in zip(axes_row, columns, strict=True):
            axis.imshow(shown[i], cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            axis.set(xticks=[], yticks=[])
            if name != "seen":
                error = np.square((shown[i].astype(np.float64) - seen[i]) / 127.5).mean()
                axis.set_xlabel(f"{error:.3f}", size=7, labelpad=2)
        axes_row[0].set_ylabel(name, color="0.1" if name == "seen" else colour(name))
    for axis, i in zip(axes[0], columns, strict=True):
        axis.set_title(f"{i * 360 / headings:g}°", pad=4)
    return fig


@styled
def collapse(curves: Mapping[str, Sequence[Mapping[str, NDArray[np.float64]]]]) -> Figure | None:
    """Spread of the codes and reconstruction error over training, a line per seed.

    `curves` maps a model to the training curves of each of its seeds. Codes have collapsed if their
    variance and distance fall towards 0: all places look similar to the model. A dashed line is the
    error of a black image, which a reconstruction has to undercut. None if no model has any of
    these curves.
    """
    seeds = [
        (model, seed_curves)
        for model, model_curves in curves.items()
        for seed_curves in model_curves
        if COLLAPSE.keys() & seed_curves.keys()
    ]
    if not seeds:
        return None
    models = Counter(model for model, _ in seeds)
    # models that were judged on the same images have the same one
    black_errors = sorted(
        {float(seed_curves[BLACK][-1]) for _, seed_curves in seeds if BLACK in seed_curves}
    )
    fig, panels = facets(
        [*COLLAPSE.items()],
        most_columns=len(COLLAPSE),
        heading="While learning",
        margin_in=0.0,
        row_in=2.5,
        shared=False,
    )
    for axis, (name, title) in panels:
        for model, seed_curves in seeds:
            if name in seed_curves:
                curve = seed_curves[name]
                marker = {"marker": "o" if len(curve) < 3 else ""}
                rounds = 1 + np.arange(len(curve))
                draw_lines(axis, [Line(model, rounds, curve, line_styles(models)[model] | marker)])
        if name == "validation_error":
            for error in black_errors:
                axis.axhline(error, **MARK)
                note = axis.text(0.98, error, "a black image", transform=axis.get_yaxis_transform())
                note.set(size=6.5, color=QUIET, ha="right", va="bottom")
        axis.set(xlabel="round", title=title, ylim=(0, None))
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    below(fig, handles(models))
    return fig
