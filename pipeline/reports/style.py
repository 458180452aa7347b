"""What every figure shares: the print style, a colour for each method, the honest line, and files of the same bytes each time."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from numpy.typing import NDArray

from pipeline.errors import InputError

STYLE: Any = {
    "font.family": "DejaVu Sans",  # the one font that matplotlib brings along
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "axes.linewidth": 0.5,
    "axes.edgecolor": "0.35",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.color": "0.25",
    "ytick.color": "0.25",
    "lines.linewidth": 1.3,
    "lines.solid_capstyle": "round",
    "svg.fonttype": "path",  # the viewer need not have the font
    "svg.hashsalt": "yearloc",
}
TEXT_WIDTH_IN = 7.16
"""Both columns of an IEEE page."""
WIDE_IN = 6.0
"""From this width on, a heading and the line about simulation stand beside each other."""
DPI = 200
"""Of PNG files, and of the dense points within an SVG."""
SIMULATED = "simulated, not recorded data"
QUIET = "0.45"
"""The grey of what is said in passing."""
VEIL: Any = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6}
"""Behind text that curves may cross."""
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#3FA7E0", "#D89000", "#7B3294", "#6B4E16", "#1F1F1F")
"""Okabe and Ito's hues, told apart by colour-blind readers too; two lightest darkened to carry text."""


def colour(method: str) -> str:
    """A method's colour in every figure and on the MLflow page, from its name alone, so that no list of names is kept here.

    The salt was searched for once, so that the design's eight methods and `scan_context_all` share no colour (a test looks), and
    kin are near: two blues for SCI's, orange and vermilion for Scan Context's.
    """
    digest = hashlib.sha256(f"147890{method}".encode()).digest()
    return PALETTE[int.from_bytes(digest[:8], "big") % len(PALETTE)]


def figure(width_in: float, height_in: float, simulated: bool, heading: str = "") -> Figure:
    """An empty figure laid out tightly, under its heading and a line that says so where the data was simulated.

    Every figure whose numbers depend on the protocol names it in its heading.
    """
    both = simulated and bool(heading) and width_in < WIDE_IN
    head_in = 0.17 * ((simulated or bool(heading)) + both)
    engine = ConstrainedLayoutEngine(rect=(0.0, 0.0, 1.0, 1.0 - head_in / height_in), w_pad=0.03, h_pad=0.03)
    fig = Figure(figsize=(width_in, height_in), layout=engine)
    if simulated:
        right, top = 1.0 - 0.04 / width_in, 1.0 - 0.04 / height_in
        fig.text(right, top, SIMULATED, ha="right", va="top", size=7, style="italic", color=QUIET)
    if heading:
        fig.text(0.04 / width_in, 1.0 - (0.04 + 0.17 * both) / height_in, heading, ha="left", va="top", size=8, weight="bold")
    return fig


def balanced(number: int, most: int) -> tuple[int, int]:
    """Rows and columns for `number` panels, at most so many beside each other, with as few cells left over as can be."""
    rows = -(-number // most)
    return rows, -(-number // rows)


def panels(fig: Figure, number: int, columns: int, shared: bool) -> list[Axes]:
    """`number` axes in rows of `columns`, with shared scales or none; the cells left over stay empty."""
    columns = min(columns, number)
    rows = -(-number // columns)
    grid = fig.subplots(rows, columns, squeeze=False, sharex=shared, sharey=shared)
    axes = [axis for row in grid for axis in row]
    for axis in axes[number:]:
        axis.remove()
    for axis in axes[max(number - columns, 0) : number]:
        axis.tick_params(labelbottom=True)
    return axes[:number]


def save(fig: Figure, path: Path) -> Path:
    """Write a figure as .svg or .png, the same bytes each time: no date, no random ids, fonts from matplotlib itself."""
    path = Path(path)
    metadata: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".png": {"Software": None}}
    if path.suffix not in metadata:
        raise InputError(f"{path.name}: a figure is saved as .svg or .png")
    with matplotlib.rc_context(STYLE):
        FigureCanvasAgg(fig)
        _settle(fig)
        fig.savefig(path, dpi=DPI, metadata=metadata[path.suffix])
    return path


def _settle(fig: Figure) -> None:
    """Lay the figure out once and round where its axes lie: the solver's last bits vary from run to run, and ids hang on them."""
    fig.draw_without_rendering()
    fig.set_layout_engine("none")
    for axis in fig.axes:
        left, bottom, width, height = (round(float(side), 6) for side in axis.get_position(original=True).bounds)
        axis.set_position((left, bottom, width, height), which="original")


def name_at_the_end(axis: Axes, lines: Sequence[tuple[str, str, NDArray[np.float64]]], gap: float) -> None:
    """Write each line's name in its colour right of its last point (n, xy), pushed apart by at least `gap` of the y axis."""
    high = axis.get_ylim()[1]
    ends = sorted(((float(points[-1, 1]) if np.isfinite(points[-1, 1]) else high, name, tint) for name, tint, points in lines))
    right, y = max(points[-1, 0] for _, _, points in lines), -np.inf
    places, y = [y := max(end, y + gap) for end, _, _ in ends], high + gap
    places = [y := min(place, y - gap) for place in reversed(places)]
    for place, (_, name, tint) in zip(places, reversed(ends), strict=True):
        end = right, place
        axis.annotate(name, end, (7, 0), textcoords="offset points", color=tint, va="center", annotation_clip=False)
