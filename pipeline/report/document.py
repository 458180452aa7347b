"""The results of all studies as markdown, from the table of results alone."""

from collections.abc import Iterator, Mapping, Sequence

import pandas as pd

from pipeline.evaluation.numbers import LEVEL_POSES
from pipeline.report import tables
from pipeline.report.render import template
from pipeline.report.result import Scores, ranked, read_scores
from pipeline.report.table import Table
from pipeline.studies.study import Study

SHOWN = (("cells", "recall_at_1"), ("cells", "auc_top1"), ("cells", "auroc"))
POSES = (
    ("within 2 m, 5°", "within_2m_5deg", 3),
    ("within 1 m, 10°", LEVEL_POSES, 3),
    ("within .5 m, 2°", "within_05m_2deg", 3),
    ("error [m]", "error_m", 2),
    ("error [°]", "error_deg", 2),
    ("accepted and right at .99", "recall_99", 3),
    ("wrong of accepted", "wrong_of_accepted_99", 3),
)


def document(results: pd.DataFrame, studies: Mapping[str, Study]) -> str:
    """All tables, recorded studies first; studies of viewpoints alone are left out."""
    filled_studies = [
        {"study": study, "grid": grid, "tables": list(_tables(scores))}
        for study in sorted(studies.values(), key=lambda study: study.simulated)
        for grid in study.grids
        if (scores := _scores(results, study, grid.name))
    ]
    return template("results.md.j2", studies=filled_studies)


def scores(results: pd.DataFrame, studies: Mapping[str, Study]) -> str:
    """The scorecard of each study alone, without the time of a query."""
    untimed = results[results["number"] != "query_ms"]
    return "\n".join(
        tables.scorecard(scores).markdown()
        for study in studies.values()
        for grid in study.grid_names
        if (scores := _scores(untimed, study, grid))
    )


def _scores(results: pd.DataFrame, study: Study, grid: str) -> list[Scores]:
    """The scores of the study at one cell size, the best model's first."""
    rows = results[(results["study"] == study.name) & (results["grid"] == grid)]
    scores = read_scores(rows, study.tests)
    return [score for group in ranked(scores).values() for score in group] if scores else []


def _tables(scores: Sequence[Scores]) -> Iterator[Table]:
    yield tables.scorecard(scores)
    for protocol, name in SHOWN:
        yield tables.over_days(f"by_{protocol}_{name}", scores, protocol, name)
    if posed := [score for score in scores if score.posed]:
        yield tables.of_poses("posed", ("method", "day"), posed, POSES)
        yield tables.of_poses("pose_answers", ("method", "day"), posed, tables.ANSWERS)
