"""What a model's verdict got wrong: poses that were believed and are wrong, or right and refused.

`misjudged` chooses the worst of them, and `cards` draws each scan on the training map where its
pose lays it, with an arrow there and one where it was taken.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError
from pipeline.core.frames import Poses, moved
from pipeline.report.clouds import CELL_M, Drive, Footprint
from pipeline.report.figures.panels import facets
from pipeline.report.figures.style import QUIET, WIDTH_IN, styled
from pipeline.report.result import Result
from pipeline.report.study import Study

MOST_CARDS = 6
SHOWN_M = 40.0  # from the middle of a card to its edge
# Colours of a pose that was believed (accepted) and is wrong, and of one that was refused.
INKS = {True: "#C8400A", False: "#0072B2"}
GREYS = ListedColormap(["#C4C3BD"])


class Failure(NamedTuple):
    """A pose whose verdict is wrong."""

    result: Result
    query: int
    accepted: bool

    @property
    def surprise(self) -> float:
        """The lower, the surer the wrong verdict was: the novelty, negated if it was refused."""
        novelty = float(self.result.evaluation.novelty[self.query, 0])
        return novelty if self.accepted else -novelty


def misjudged(group: Sequence[Result]) -> list[Failure]:
    """At most MOST_CARDS poses of a model whose verdict is wrong, the surest verdicts first.

    Wrong poses that were believed come before right ones that were refused.
    """
    failures = []
    for result in group:
        believed = result.evaluation.acceptance
        right = ~np.isnan(result.evaluation.pose_error_m) & ~believed["refused_wrong"]
        refused_right = believed["refused"] & right
        for mask, accepted in ((believed["accepted_wrong"], True), (refused_right, False)):
            failures += [Failure(result, int(query), accepted) for query in np.flatnonzero(mask)]
    failures.sort(key=lambda failure: (not failure.accepted, failure.surprise))
    return failures[:MOST_CARDS]


def cards(study: Study, group: Sequence[Result]) -> Figure | None:
    """A card per failure: its scan where it was laid, and an arrow where it was taken.

    None if no verdict of the model is wrong, or the scans are not here.
    """
    failures = misjudged(group)
    footprint = Footprint.read(study) if failures else None
    try:
        return _cards(study, failures, footprint) if footprint else None
    except ArtifactError:
        return None


@styled
def _cards(study: Study, failures: Sequence[Failure], footprint: Footprint) -> Figure:
    """Draw a card per failure over the footprint of training."""
    model = failures[0].result.model
    low_m = footprint.corner_m
    high_m = low_m + np.array(footprint.occupied.shape[::-1]) * footprint.cell_m
    extent: Any = (low_m[0], high_m[0], low_m[1], high_m[1])
    ground = np.ma.masked_equal(footprint.occupied.astype(float), 0.0)
    fig, panels = facets(
        failures,
        most_columns=3,
        heading=f"{model}: what its verdict got wrong",
        around_in=0.3,
        row_in=WIDTH_IN / 3 + 0.2,
        shared=False,
    )
    for axis, (result, query, accepted) in panels:
        drive = Drive.read(study, result.sequence)
        fixes = store.read(study.find("localize", result.sequence, model), schemas.Fixes)
        world_T_query = np.asarray(fixes["world_T_query"][query])
        ink = INKS[accepted]
        axis.imshow(ground, cmap=GREYS, extent=extent, origin="lower", interpolation="nearest")
        xy_m = np.unique(
            np.rint(moved(world_T_query, drive.standing_m(query))[:, :2] / CELL_M), axis=0
        )
        axis.plot(*(xy_m * CELL_M).T, ".", ms=2.2, mew=0, color=ink, rasterized=True)
        _arrow(axis, world_T_query, ink)
        _arrow(axis, drive.world_T_anchor[query], "black")
        x_m, y_m = world_T_query[:2, 3]
        axis.set(xlim=(x_m - SHOWN_M, x_m + SHOWN_M), ylim=(y_m - SHOWN_M, y_m + SHOWN_M))
        axis.set(xticks=[], yticks=[], aspect="equal")
        verdict = "believed" if accepted else "refused"
        off = f"{result.evaluation.pose_error_m[query]:.1f} m off"
        axis.set_title(f"{result.label}: {verdict}, {off}", size=7, pad=3)
        axis.spines[:].set(visible=True, color=QUIET)
    return fig


def _arrow(axis: Axes, world_T_robot: Poses, ink: str) -> None:
    """Draw an arrow of 8 m at a robot, along its heading."""
    start_m = world_T_robot[:2, 3] - 3.0 * world_T_robot[:2, 0]
    end_m = start_m + 8.0 * world_T_robot[:2, 0]
    axis.annotate(
        "", tuple(end_m), tuple(start_m), arrowprops={"arrowstyle": "->", "color": ink, "lw": 1.4}
    )
