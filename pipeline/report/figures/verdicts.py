"""How good verdicts on poses are: errors over novelty, calibration, and failures.

In: the results of one model with poses on the test sequences. A pose is accepted if its novelty is
below a threshold that was chosen for a target precision of .99 on validation blocks of training.
`cards` shows wrong verdicts: each scan on the training map where its pose placed it, with an arrow
there and one where it was taken.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pipeline.core.errors import ArtifactError
from pipeline.core.schemas import Fixes
from pipeline.evaluation.calibration import reliability
from pipeline.evaluation.failures import JudgedFix, failures, of_drive
from pipeline.mapping.from_above import INKS, draw_heading, scan_on_map
from pipeline.report.figures.panels import WRONG_RED, calibration, facets, in_corner
from pipeline.report.figures.style import MARK, QUIET, WIDTH_IN, below, dot, styled
from pipeline.report.result import Result
from pipeline.report.study import StudyResults
from pipeline.report.table import fixed
from pipeline.studies.colours import colour

# Errors are drawn between these; a query without a pose lies at the upper one.
LEAST_ERROR_M = 1e-3
MOST_ERROR_M = 1e3
RIGHT = "#6BB6E8"
MOST_CARDS = 6
SHOWN_M = 40.0  # from the middle of a card to its edge
WHOLE_AREA = 60.0  # square points of the marker of a probability that all queries have


@styled
def verdicts(group: Sequence[Result]) -> Figure:
    """Position error over novelty, a panel per test sequence.

    Poses left of the dashed line are accepted.
    """
    far_m, far_deg = group[0].evaluation.right_within
    kind = group[0].evaluation.kinds[0].replace("_", " ")
    fig, panels = facets(
        group,
        most_columns=4,
        heading=f"{group[0].model}: error of each pose over its novelty",
        margin_in=0.9,
        row_in=1.75,
        x_label=f"novelty: {kind}",
        y_label="error [m]",
    )
    for axis, result in panels:
        evaluation = result.evaluation
        accepted = evaluation.pose_accepted
        right = evaluation.pose_right
        novelty = evaluation.novelty[:, 0]
        error_m = np.nan_to_num(evaluation.pose_error_m, nan=MOST_ERROR_M).clip(
            LEAST_ERROR_M, MOST_ERROR_M
        )
        for is_shown, tint, marker in ((right, RIGHT, "o"), (~right, WRONG_RED, "X")):
            style: Any = {"marker": marker, "linewidths": 0, "rasterized": True}
            axis.scatter(novelty[is_shown], error_m[is_shown], 5.0, tint, **style)
        axis.set(yscale="log", ylim=(LEAST_ERROR_M / 1.5, MOST_ERROR_M * 1.5))
        axis.set(xlim=(-0.03, 1.03), title=result.label)
        axis.axhline(evaluation.right_within[0], color="0.8", lw=0.7, zorder=0)
        if 0 < evaluation.reject_pose_from < 1:
            axis.axvline(evaluation.reject_pose_from, **MARK)
        wrong = f"{(accepted & ~right).sum()} of {accepted.sum()} accepted are wrong"
        in_corner(axis, wrong, "0.25")
    right_words = f"within {far_m:g} m and {far_deg:g}°"
    below(fig, [dot(right_words, RIGHT, "o"), dot("off by more", WRONG_RED, "X")], 2)
    return fig


@styled
def probabilities(group: Sequence[Result]) -> Figure:
    """Fraction of right poses over their probability of being right, a panel per test sequence.

    The area of a marker is the fraction of the queries that have such a probability.
    """
    fig, panels = facets(
        group,
        most_columns=5,
        heading=f"{group[0].model}: how often poses of a probability are right",
        margin_in=0.6,
        row_in=1.7,
        x_label="probability of the pose",
        y_label="share that is right",
    )
    for axis, result in panels:
        evaluation = result.evaluation
        bins = reliability(evaluation.pose_probabilities, evaluation.pose_right)
        calibration(axis, bins, colour(result.model), whole_area=WHOLE_AREA)
        ece = fixed(result.number("distance", "pose_ece"), 3)
        in_corner(axis, f"ECE {ece}", "0.25")
        axis.set(aspect="equal", title=result.label)
    return fig


def cards(study: StudyResults, group: Sequence[Result]) -> Figure | None:
    """A card for each of the surest wrong verdicts of one model, at most MOST_CARDS.

    None if no verdict of the model is wrong, or the scans are not here.
    """
    judged: list[JudgedFix] = []
    try:
        for result in group:
            fixes = study.artifact(Fixes, "localize", result.sequence, result.model)
            drive = study.drive(result.sequence)
            judged += of_drive(fixes, drive, result.evaluation.reject_pose_from, result.label)
    except ArtifactError:
        return None
    failed = failures(judged)[:MOST_CARDS]
    return _cards(study, group[0].model, failed) if failed and study.footprint else None


@styled
def _cards(study: StudyResults, model: str, failed: Sequence[JudgedFix]) -> Figure:
    """Draw a card per failure over the footprint of training."""
    fig, panels = facets(
        failed,
        most_columns=3,
        heading=f"{model}: what its verdict got wrong",
        margin_in=0.3,
        row_in=WIDTH_IN / 3 + 0.2,
        shared=False,
    )
    for axis, fix in panels:
        ink = INKS[fix.accepted]
        scan_on_map(axis, study.footprint, fix.standing_m(), fix.world_T_found, ink, SHOWN_M)
        draw_heading(axis, fix.world_T_true, "black")
        verdict = "accepted" if fix.accepted else "refused"
        axis.set_title(f"{fix.name}: {verdict}, {fix.off[0]:.1f} m off", size=7, pad=3)
        axis.spines[:].set(visible=True, color=QUIET)
    return fig
