"""The style of every figure: fonts, a colour per model, legends, and the SVG that it becomes.

A figure is drawn by a function with the decorator `styled`, on what `figure` returns. `save` writes
it as a file, `inline` makes it an element of the page. Simulated data are marked as such in both,
and the same figure gives the same bytes each time.
"""

import re
from base64 import b64decode, b64encode
from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any, NamedTuple, cast

import matplotlib
from markupsafe import Markup, escape
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from PIL import Image

from pipeline.core.errors import InputError
from pipeline.studies.colours import colour, marker, method_of

FONT = "DejaVu Sans"  # the one font that comes with matplotlib
STYLE: Any = {
    "font.family": FONT,
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.linewidth": 0.5,
    "axes.edgecolor": "0.35",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "grid.linewidth": 0.4,
    "grid.color": "0.9",
    "lines.linewidth": 1.3,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.handlelength": 1.4,
    "legend.title_fontsize": 7,
    "svg.hashsalt": "yearloc",
    "svg.fonttype": "none",
}
TICKS = {"major.width": 0.5, "major.size": 2.5, "color": "0.25", "labelsize": 7.5}
STYLE |= {f"{axis}tick.{name}": value for axis in "xy" for name, value in TICKS.items()}
styled = matplotlib.rc_context(STYLE)  # decorator of functions that draw a figure
WIDTH_IN = 7.16  # both columns of an IEEE page
WIDE_IN = 6.0  # from this width on, a heading and SIMULATED stand in one line
LINE_IN = 0.17  # height of the line that a heading takes
MARGIN_IN = 0.04  # between the heading and the edges of a figure
IMAGE_COLOURS = 64  # of the images within an SVG
FAMILY = f"font-family: {FONT}, Verdana, sans-serif"
UNUSED_IDS = re.compile(r' id="[A-Za-z.0-9]+_\d+"')  # matplotlib's own, which nothing refers to
COORDINATES = re.compile(r' (?:d|x|y|points)="[^"]*"|translate\([^)]*\)')
DECIMALS = re.compile(r"-?\d+\.\d+")
DPI = 150  # of PNG files, and of the dense points within an SVG
SIMULATED = "simulated, not recorded data"
QUIET = "0.45"  # grey of labels and lines of less weight
# A box behind text that curves may cross.
VEIL: Any = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.6}
DASHED = (0, (4, 3))  # of lines of thresholds, and of values to compare with
MARK: Any = {"color": QUIET, "lw": 0.7, "ls": DASHED, "zorder": 1}  # a line to compare with
# The dashes of a method's line, then those of its variants.
DASHES: tuple[Any, ...] = (
    "-",
    (0, (4, 1.5)),
    (0, (1, 1)),
    (0, (5, 1.5, 1, 1.5)),
    (0, (2, 2)),
    (0, (8, 2)),
)
THICK: Any = {"lw": 1.6, "ms": 4, "mec": "white", "mew": 0.5}  # a legend's line with its marker
LONGEST_NAME = 12  # letters of a model's name that fit beside a panel


class Link(NamedTuple):
    """The result that a click on an artist of the page opens."""

    model: str
    sequence: str
    tooltip: str


def line_styles(models: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Map each model of a figure to the colour and dash (`color` and `ls`) of its line.

    A variant has its method's colour, darker and with another dash.
    """
    models = list(models)
    styles = {}
    for model in models:
        variants = sorted(
            {name for name in models if method_of(name) == method_of(model)},
            key=lambda name: ("-" in name, len(name), name),
        )
        place = variants.index(model)
        shade = 1.0 - 0.6 * place / max(len(variants) - 1, 1)
        red, green, blue = to_rgb(colour(model))
        tint = to_hex((shade * red, shade * green, shade * blue)).upper()
        styles[model] = {"color": tint, "ls": DASHES[place % len(DASHES)]}
    return styles


def tints(models: Iterable[str]) -> dict[str, str]:
    """Map each model of a figure to its colour."""
    return {model: line["color"] for model, line in line_styles(models).items()}


def handles(models: Iterable[str]) -> list[Line2D]:
    """The entries of a legend, one per model."""
    return [
        Line2D([], [], marker=marker(model), label=model, **THICK, **line)
        for model, line in line_styles(models).items()
    ]


def dot(
    label: str, tint: str = QUIET, marker: str = "o", is_filled: bool = True, alpha: float = 1.0
) -> Line2D:
    """A legend entry of a marker, hollow unless `is_filled`."""
    fill = tint if is_filled else "white"
    shape: Any = {"marker": marker, "ms": 4, "mfc": fill, "mew": 0.8}
    return Line2D([], [], ls="", color=tint, alpha=alpha, label=label, **shape)


def below(fig: Figure, entries: Sequence[Any], columns: int = 6, **options: Any) -> None:
    """Add a legend of at most `columns` columns below the panels."""
    used_columns = min(columns, len(entries))
    fig.legend(handles=entries, loc="outside lower center", ncols=used_columns, **options)


def folded(model: str) -> str:
    """A model's name; a long one breaks before its last dash or underscore into two lines."""
    cut = max(model.rfind("_"), model.rfind("-"))
    return f"{model[:cut]}\n{model[cut:]}" if len(model) > LONGEST_NAME and cut > 0 else model


def figure(width_in: float, height_in: float, heading: str) -> Figure:
    """An empty figure with a tight layout below its heading."""
    layout = ConstrainedLayoutEngine(w_pad=0.03, h_pad=0.03)
    fig = Figure(figsize=(width_in, height_in), layout=layout)
    fig.text(MARGIN_IN / width_in, 1.0, heading, ha="left", va="top", size=8, weight="bold")
    return fig


def save(fig: Figure, path: Path, simulated: bool) -> Path:
    """Write a figure as .svg, marked if its data were simulated; returns the path.

    The bytes are the same each time: no date, no random ids, fonts from matplotlib itself. Raises
    InputError for another ending.
    """
    if path.suffix != ".svg":
        raise InputError(f"{path.name}: a figure is saved as .svg")
    path.write_text(_svg(fig, simulated), encoding="utf-8")
    return path


def inline(fig: Figure, simulated: bool, name: str, links: Mapping[str, Link]) -> Markup:
    """A figure as an SVG element of a page, all of whose ids begin with `name`.

    `links` maps the id of an artist to what a click on it opens, which its tooltip names.
    """
    for artist in fig.findobj():  # a clip path is loaded by its address: a strict page forbids it
        artist.set_clip_on(False)
    text = _svg(fig, simulated)
    head, _, body = text[text.index("<svg") :].partition(">")
    head = re.sub(r' (width|height)="[\d.]+pt"', "", head)
    label = f' class="chart" role="img" aria-label="{escape(fig.texts[0].get_text())}">'
    body = re.sub(r"<style.*?</style>", "", body, flags=re.DOTALL)
    body = re.sub(r'\b(id|href)="(#?)', rf'\1="\g<2>{name}-', body)
    for gid, link in links.items():
        group = f'<g id="{name}-{gid}"'
        model, sequence, tooltip = map(escape, link)
        opens = f' data-model="{model}" data-day="{sequence}"><title>{tooltip}</title>'
        body = body.replace(f"{group}>", group + opens)
    return Markup(head + label + re.sub(r"\s+", " ", body))


def _svg(fig: Figure, simulated: bool) -> str:
    """The text of an SVG, light enough to be one of many on a page."""
    with matplotlib.rc_context(STYLE), StringIO() as file:
        _head(fig, simulated)
        FigureCanvasAgg(fig)
        # the layout is rounded: its last bits vary, and matplotlib makes ids of positions
        cast(ConstrainedLayoutEngine, fig.get_layout_engine()).execute(fig)
        fig.set_layout_engine("none")
        for axis in fig.axes:
            bounds = axis.get_position(original=True).bounds
            left, bottom, width, height = (round(float(side), 6) for side in bounds)
            axis.set_position((left, bottom, width, height), which="original")
        fig.set_dpi(DPI)  # of its images
        canvas: Any = FigureCanvasSVG(fig)
        canvas.print_svg(file, metadata={"Date": None})  # `savefig` would draw it twice
        text = file.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>|<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(rf" font-family: '{FONT}';| transform=\"rotate\(-0 [^\"]*\"", "", text)
    text = UNUSED_IDS.sub("", text).replace("<svg ", f'<svg style="{FAMILY}" ', 1)
    text = COORDINATES.sub(lambda part: DECIMALS.sub(_tenth, part[0]), text)
    return re.sub(r"(?<=base64,)[^\"]+", lambda png: _fewer_colours(png[0]), text)


def _tenth(number: re.Match[str]) -> str:
    """A coordinate to a tenth of a point."""
    return f"{float(number[0]):z.1f}".removesuffix(".0")


def _fewer_colours(png: str) -> str:
    """The same PNG in base64 with IMAGE_COLOURS, enough for dense points and small views."""
    image = Image.open(BytesIO(b64decode(png))).convert("RGBA")
    return png_text(image.quantize(IMAGE_COLOURS, Image.Quantize.FASTOCTREE))


def png_text(image: Image.Image, **options: Any) -> str:
    """An image as a small PNG in base64."""
    file = BytesIO()
    image.save(file, "PNG", optimize=True, **options)
    return b64encode(file.getvalue()).decode()


def _head(fig: Figure, simulated: bool) -> None:
    """Make room for the heading, and write SIMULATED beside it or, in a narrow figure, above it."""
    width_in, height_in = fig.get_size_inches()
    is_narrow = width_in < WIDE_IN
    above_in = LINE_IN * (simulated and is_narrow)
    margin = MARGIN_IN / width_in
    top = 1.0 - MARGIN_IN / height_in
    if simulated:  # on the left where the right may be out of sight
        x, side = (margin, "left") if is_narrow else (1.0 - margin, "right")
        fig.text(x, top, SIMULATED, ha=side, va="top", size=7, style="italic", color=QUIET)
    fig.texts[0].set_y(top - above_in / height_in)
    cast(ConstrainedLayoutEngine, fig.get_layout_engine()).set(
        rect=(0.0, 0.0, 1.0, 1.0 - (LINE_IN + above_in) / height_in)
    )
