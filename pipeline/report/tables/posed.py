"""The tables of models that answer with poses: how near these are, and what robots are told."""

from collections.abc import Sequence

from pipeline.evaluation.judgement import VERDICTS
from pipeline.evaluation.numbers import LEVEL_POSES
from pipeline.report.result import Scores, dates
from pipeline.report.table import Table, table
from pipeline.report.tables.columns import Column, bounded_cells, headings_of

# How near the poses are. "At .99" are poses accepted where a precision of .99 was promised.
POSES = (
    Column("within 2 m, 5°", "within_2m_5deg", 3),
    Column("within 1 m, 10°", LEVEL_POSES, 3),
    Column("training's heading", "within_2m_5deg_same_heading", 3),
    Column("turned", "within_2m_5deg_turned", 3),
    Column("2 m or more beside", "within_2m_5deg_beside", 3),
    Column("within .5 m, 2°", "within_05m_2deg", 3),
    Column("error [m]", "error_m", 2),
    Column("error [°]", "error_deg", 2),
    Column("all poses, RMS [m]", "trajectory_m", 2),
    Column("wrong of accepted at .99", "wrong_of_accepted_99", 4),
    Column("recall at .99", "recall_99", 3),
)
# How many queries got each verdict where a precision of .99 was promised.
ANSWERS = (
    *(Column(verdict.replace("_", " "), f"{verdict}_99", 0) for verdict in VERDICTS),
    Column("calibration error", "pose_ece", 3),
)


def pose_tables(scores: Sequence[Scores]) -> list[Table]:
    """What a robot is told of the queries of each day, and how good the poses are."""
    headings = ("model", "sequence")
    return [
        pose_table("pose_answers", headings, scores, ANSWERS),
        pose_table("poses", headings, scores, POSES),
    ]


def pose_table(
    table_kind: str,
    text_headings: tuple[str, str],
    scores: Sequence[Scores],
    columns: Sequence[Column],
) -> Table:
    """Some numbers of each model and test day by distance, with 95 % intervals.

    `text_headings` stand above the model and the day. The column of level sweeps is left out where
    there are none.
    """
    days = dates(scores)
    has_level = any(("distance", LEVEL_POSES) in score.numbers for score in scores)
    shown = [column for column in columns if has_level or column.number != LEVEL_POSES]
    rows = [
        (score.model, days[score.sequence], *bounded_cells(score, shown, "distance"))
        for score in scores
    ]
    return table(table_kind, (*text_headings, *headings_of(shown)), rows, text_columns=2)
