"""Fig. 7 of paper 2, and whether codes collapsed: what networks on bird-views learned."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipeline.report.figures.panels import panels
from pipeline.report.figures.style import WIDTH_IN, below, figure, handles, look, styled
from pipeline.studies.colours import colour

COLLAPSE = {
    "code_variance": "variance of the codes",
    "code_distance": "mean distance between codes",
    "held_out_error": "held-out reconstruction error",
}
"""Curve (round,) of a model and its title."""
MOST = 8  # pictures beside each other


@styled
def reconstructions(pictures: Mapping[str, tuple[NDArray[Any], NDArray[Any]]], simulated: bool) -> Figure:
    """Fig. 7: views (heading, side, side) of one place, 0 to 255, and each model's reconstructions; mean squared errors."""
    rows: list[tuple[str, NDArray[Any], NDArray[Any] | None]] = []
    for model, (seen, reconstructed) in pictures.items():
        rows += [] if rows and np.array_equal(rows[-1][1], seen) else [("seen", seen, None)]
        rows.append((model, seen, reconstructed))
    headings = max(len(seen) for _, seen, _ in rows)
    columns = range(0, headings, -(-headings // MOST))
    side_in = (WIDTH_IN - 0.4) / len(columns)
    fig = figure(WIDTH_IN, 0.45 + (side_in + 0.12) * len(rows), simulated, "Seen, and reconstructed from a code")
    axes = fig.subplots(len(rows), len(columns), squeeze=False)
    for line, (name, seen, shown) in zip(axes, rows, strict=True):
        for axis, i in zip(line, columns, strict=True):
            axis.imshow((seen if shown is None else shown)[i], cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            axis.set(xticks=[], yticks=[])
            if shown is not None:
                error = np.square((shown[i].astype(np.float64) - seen[i]) / 127.5).mean()
                axis.set_xlabel(f"{error:.3f}", size=7, labelpad=2)
        line[0].set_ylabel(name, color="0.1" if shown is None else colour(name))
    for axis, i in zip(axes[0], columns, strict=True):
        axis.set_title(f"{i * 360 / headings:g}°", pad=4)
    return fig


@styled
def collapse(curves: Mapping[str, Sequence[Mapping[str, NDArray[np.float64]]]], simulated: bool) -> Figure | None:
    """How far codes lie apart, and the error of reconstructions, over training, a line a seed; None without any such curve.

    Codes have collapsed where variance and distance fall towards 0: all places look alike to the model.
    """
    found = {model: [one for one in seeds if COLLAPSE.keys() & one.keys()] for model, seeds in curves.items()}
    found = {model: seeds for model, seeds in found.items() if seeds}
    if not found:
        return None
    looks, fig = look(found), figure(WIDTH_IN, 2.5, simulated, "While learning")
    for axis, (name, title) in zip(panels(fig, len(COLLAPSE), len(COLLAPSE), shared=False), COLLAPSE.items(), strict=True):
        for model, (tint, dash) in looks.items():
            for curve in (one[name] for one in found[model] if name in one):
                few, width = "." if len(curve) < 3 else "", 1.0 if len(found[model]) > 1 else 1.3
                axis.plot(1 + np.arange(len(curve)), curve, color=tint, ls=dash, marker=few, lw=width)
        axis.set(xlabel="round", title=title, ylim=(0, None))
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    below(fig, handles(found))
    return fig
