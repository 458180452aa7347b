"""What networks on bird-views learned: Fig. 7 of paper 2, and whether the codes collapsed."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pipeline.reports.style import STYLE, TEXT_WIDTH_IN, colour, figure, panels
from pipeline.reports.viewpoint_figures import ACROSS, handles

COLLAPSE = {
    "code_variance": "variance of the codes",
    "code_distance": "mean distance between codes",
    "held_out_error": "held-out reconstruction error",
}
"""Curve (round,) of a model: its name."""
MOST_PICTURES = 8
"""Beside each other."""


@matplotlib.rc_context(STYLE)
def reconstructions(pictures: Mapping[str, tuple[NDArray[Any], NDArray[Any]]], simulated: bool) -> Figure:
    """Fig. 7: what was seen at several headings of one place (h, side, side), and below it what each method made of it.

    Under each stands the mean squared error, of pixels from −1 to 1 as the networks see them.
    """
    rows: list[tuple[str, NDArray[Any], NDArray[Any] | None]] = []
    for method, (images, of_codes) in pictures.items():
        rows += [] if rows and np.array_equal(rows[-1][1], images) else [("seen", images, None)]
        rows.append((method, images, of_codes))
    most = max(len(seen) for _, seen, _ in rows)
    columns = range(0, most, max(1, -(-most // MOST_PICTURES)))
    side_in = (TEXT_WIDTH_IN - 0.4) / len(columns)
    fig = figure(TEXT_WIDTH_IN, 0.45 + (side_in + 0.12) * len(rows), simulated, "Seen, and reconstructed from a code")
    axes = fig.subplots(len(rows), len(columns), squeeze=False)
    for line, (name, seen, made) in zip(axes, rows, strict=True):
        for axis, i in zip(line, columns, strict=True):
            axis.imshow((seen if made is None else made)[i], cmap="gray", vmin=0, vmax=255, interpolation="nearest")
            axis.set_xticks([])
            axis.set_yticks([])
            if made is not None:
                error = np.square((made[i].astype(np.float64) - seen[i]) / 127.5).mean()
                axis.set_xlabel(f"{error:.3f}", size=7, labelpad=2)
        line[0].set_ylabel(name, color="0.1" if made is None else colour(name))
    for axis, i in zip(axes[0], columns, strict=True):
        axis.set_title(f"{i * 360 / most:g}°", pad=4)
    return fig


@matplotlib.rc_context(STYLE)
def collapse(curves: Mapping[str, Sequence[Mapping[str, NDArray[np.float64]]]], simulated: bool) -> Figure | None:
    """How codes spread and pictures come back while a method learns, a line a seed; None where no model tells.

    Codes that draw together, in variance and in distance, have collapsed: all places look alike to the method.
    """
    told = {method: [one for one in seeds if COLLAPSE.keys() & one.keys()] for method, seeds in curves.items()}
    told = {method: seeds for method, seeds in told.items() if seeds}
    if not told:
        return None
    fig = figure(TEXT_WIDTH_IN, 2.5, simulated, "While learning")
    for axis, (name, title) in zip(panels(fig, len(COLLAPSE), len(COLLAPSE), shared=False), COLLAPSE.items(), strict=True):
        for method, seeds in told.items():
            for one in seeds:
                curve = one.get(name, np.empty(0))
                few = "." if len(curve) < 3 else ""
                axis.plot(1 + np.arange(len(curve)), curve, color=colour(method), marker=few, lw=1.0 if len(seeds) > 1 else 1.3)
        axis.set(xlabel="round", title=title)
        axis.set_ylim(0, None)
        axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    fig.legend(handles=handles(told), **ACROSS)
    return fig
