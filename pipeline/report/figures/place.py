"""Fig. 3, 5 and 9(a) of the SCI paper: a cloud, its Scan Context and its image; and the same place
altered."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.alterations import Alteration, Case, generator
from pipeline.evaluation.rows import case_text
from pipeline.report.figures.style import WIDTH_IN, figure, styled
from pipeline.views.scan_context import ScanContext, colorize

COLOURS = "viridis"
TOP_M = 15.0
"""Where the colours of heights end, as those of the image do."""
POINTS = 30_000  # shown at most, evenly spread over the cloud
ROBOT = "#D55E00"
RINGS_IN = 1.35


def altered(
    points_m: NDArray[np.floating], alteration: Alteration, stamp_ns: int
) -> Mapping[str, NDArray[np.floating]]:
    """The cloud (n, 3) as driven, then each case of an alteration, by what is done to it."""
    return {
        case_text(case) or "as driven": (
            points_m
            if case == Case()
            else alteration.alter(case, points_m, generator(alteration, stamp_ns))[0]
        )
        for case in alteration.cases
    }


@styled
def place(clouds_m: Mapping[str, NDArray[np.floating]], view: ScanContext) -> Figure:
    """A row for each cloud (n, 3): from above, its Scan Context in metres, and its colour image."""
    fig = figure(WIDTH_IN, 0.3 + RINGS_IN * len(clouds_m), "One place as methods see it")
    rows = fig.subplots(
        len(clouds_m), 3, squeeze=False, gridspec_kw={"width_ratios": [1.0, 1.8, 1.8]}
    )
    heights = Normalize(0.0, TOP_M)
    for (name, points_m), (cloud, context, image) in zip(clouds_m.items(), rows, strict=True):
        _from_above(cloud, points_m, view.max_range_m, heights)
        cloud.set_ylabel(name)
        heights_m = view(points_m)
        shown: Any = {"origin": "lower", "aspect": "auto", "interpolation": "nearest"}
        filled_m = np.where(heights_m != 0, heights_m, np.nan)
        context.imshow(filled_m, cmap=COLOURS, norm=heights, **shown)
        image.imshow(colorize(heights_m), **shown)
        for axis in (context, image):
            axis.set_xticks([])
            axis.set_yticks([])
    for axis, title in zip(rows[0], ("cloud", "Scan Context", "its image"), strict=True):
        axis.set_title(title)
    for axis in rows[-1, 1:]:
        axis.set_xlabel("sector, from ahead to the left")
    rows[0, 1].set_ylabel("ring")
    return fig


def _from_above(
    axis: Axes, points_m: NDArray[np.floating], range_m: float, heights: Normalize
) -> None:
    """The cloud around the robot, its front up, higher points over lower ones."""
    near = points_m[(np.abs(points_m[:, :2]) < range_m).all(axis=1)]
    near = near[:: -(-len(near) // POINTS) or 1]
    near = near[np.argsort(near[:, 2], kind="stable")]
    look: Any = {"cmap": COLOURS, "norm": heights, "linewidths": 0, "rasterized": True}
    axis.scatter(-near[:, 1], near[:, 0], 0.2, near[:, 2], **look)
    axis.plot(0, 0, "^", color=ROBOT, ms=4)
    axis.set_xlim(-range_m, range_m)
    axis.set_ylim(-range_m, range_m)
    axis.set_aspect("equal")
    axis.set_xticks([])
    axis.set_yticks([])
