"""The results of all studies as markdown, from the table of results alone.

In: the table of results. Out: `document`, which docs/RESULTS.md shows, and `scores`, one table per
study, which is compared between kinds of processor.
"""

from collections.abc import Iterator, Mapping, Sequence

import pandas as pd

from pipeline.evaluation.numbers import LEVEL_POSES
from pipeline.report import tables
from pipeline.report.render import template
from pipeline.report.result import Scores, ranked, read_scores
from pipeline.report.selection import pick
from pipeline.report.table import Table
from pipeline.report.tables import Column
from pipeline.studies.study import Study

# Protocol and number of the tables over the test days that follow the scorecard.
SHOWN = (("cells", "recall_at_1"), ("cells", "auc_top1"), ("cells", "auroc"))
POSES = (
    Column("within 2 m, 5°", "within_2m_5deg", 3),
    Column("within 1 m, 10°", LEVEL_POSES, 3),
    Column("within .5 m, 2°", "within_05m_2deg", 3),
    Column("error [m]", "error_m", 2),
    Column("error [°]", "error_deg", 2),
    Column("accepted and right at .99", "recall_99", 3),
    Column("wrong of accepted", "wrong_of_accepted_99", 3),
)


def document(results: pd.DataFrame, studies: Mapping[str, Study]) -> str:
    """All tables, recorded studies first; studies of viewpoints alone are left out."""
    entries = []
    for study in sorted(studies.values(), key=lambda study: study.simulated):
        for grid in study.grids:
            if scores := _scores(results, study, grid.name):
                entries.append({"study": study, "grid": grid, "tables": list(_tables(scores))})
    return template("results.md.j2", studies=entries)


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
    scores = read_scores(pick(results, study=study.name, grid=grid), study.tests)
    return [score for group in ranked(scores).values() for score in group] if scores else []


def _tables(scores: Sequence[Scores]) -> Iterator[Table]:
    """The tables of one study at one cell size."""
    yield tables.scorecard(scores)
    for protocol, name in SHOWN:
        yield tables.over_days(f"by_{protocol}_{name}", scores, protocol, name)
    if posed := [score for score in scores if score.posed]:
        yield tables.of_poses("posed", ("method", "day"), posed, POSES)
        yield tables.of_poses("pose_answers", ("method", "day"), posed, tables.ANSWERS)
