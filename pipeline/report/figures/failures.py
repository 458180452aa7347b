"""Failure cards of a model of a study: its fixes whose verdict is wrong, the surest verdicts first.

Each card shows the scan on the training map where its pose placed it, with an arrow there and one
where it was taken.
"""

from collections.abc import Sequence

from matplotlib.figure import Figure

from pipeline.core.errors import ArtifactError
from pipeline.core.schemas import Fixes
from pipeline.evaluation.failures import JudgedFix, failures, of_drive
from pipeline.mapping.from_above import INKS, heading, scan_on_map
from pipeline.report.figures.panels import facets
from pipeline.report.figures.style import QUIET, WIDTH_IN, styled
from pipeline.report.result import Result
from pipeline.report.study import Study

MOST_CARDS = 6
SHOWN_M = 40.0  # from the middle of a card to its edge


def cards(study: Study, group: Sequence[Result]) -> Figure | None:
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
def _cards(study: Study, model: str, failed: Sequence[JudgedFix]) -> Figure:
    """Draw a card per failure over the footprint of training."""
    fig, panels = facets(
        failed,
        most_columns=3,
        heading=f"{model}: what its verdict got wrong",
        around_in=0.3,
        row_in=WIDTH_IN / 3 + 0.2,
        shared=False,
    )
    for axis, fix in panels:
        ink = INKS[fix.accepted]
        scan_on_map(axis, study.footprint, fix.standing_m(), fix.world_T_found, ink, SHOWN_M)
        heading(axis, fix.world_T_true, "black")
        verdict = "believed" if fix.accepted else "refused"
        axis.set_title(f"{fix.name}: {verdict}, {fix.off[0]:.1f} m off", size=7, pad=3)
        axis.spines[:].set(visible=True, color=QUIET)
    return fig
