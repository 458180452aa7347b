"""The table of poses: how accurate they are, and whether the promised precision was kept."""

from collections.abc import Sequence

from pipeline.evaluation.judgement import VERDICTS
from pipeline.report.result import Result, dates
from pipeline.report.table import Table, number, table

POSES = (
    ("within 2 m, 5°", "within_2m_5deg", 3),
    ("training's heading", "within_2m_5deg_same_heading", 3),
    ("turned", "within_2m_5deg_turned", 3),
    ("2 m or more beside", "within_2m_5deg_beside", 3),
    ("within .5 m, 2°", "within_05m_2deg", 3),
    ("error [m]", "error_m", 2),
    ("error [°]", "error_deg", 2),
    ("all poses, RMS [m]", "trajectory_m", 2),
    ("wrong of accepted at .99", "wrong_of_accepted_99", 4),
    ("recall at .99", "recall_99", 3),
)
ANSWERS = tuple((verdict.replace("_", " "), f"{verdict}_99", 0) for verdict in VERDICTS)
CHANCE = ("calibration error", "pose_ece", 3)


def poses(posed: Sequence[Result]) -> Table:
    """A row a model and test sequence: pose errors, and the outcome of the promised precision."""
    return _table("poses", posed, POSES)


def answers(posed: Sequence[Result]) -> Table:
    """A row a model and test sequence: how many queries got each verdict, and the chance's ECE."""
    return _table("pose_answers", posed, (*ANSWERS, CHANCE))


def _table(kind: str, posed: Sequence[Result], columns: Sequence[tuple[str, str, int]]) -> Table:
    rows = []
    days = dates(posed)
    for result in posed:
        cells = [
            number(result.number("distance", name), digits, result.interval("distance", name))
            for _, name, digits in columns
        ]
        rows.append((result.model, days[result.sequence], *cells))
    header = ("model", "sequence", *(heading for heading, _, _ in columns))
    return table(kind, header, rows, words=2)
