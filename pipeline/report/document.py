"""The results of all studies as markdown, from the table of results alone."""

from collections.abc import Iterator, Mapping
from typing import Any

import pandas as pd

from pipeline.report.pose_tables import ANSWERS
from pipeline.report.render import template
from pipeline.report.result import NONE, Values, day
from pipeline.report.study import indexed
from pipeline.report.summary import Summary, scorecard
from pipeline.report.table import Cell, Table, number, table
from pipeline.studies.models import ModelName
from pipeline.studies.study import Study

SHOWN = (("cells", "recall_at_1"), ("cells", "auc_top1"), ("cells", "auroc"))
POSES = (
    ("within 2 m, 5°", "within_2m_5deg", 3),
    ("within .5 m, 2°", "within_05m_2deg", 3),
    ("error [m]", "error_m", 2),
    ("error [°]", "error_deg", 2),
    ("accepted and right at .99", "recall_99", 3),
    ("wrong of accepted", "wrong_of_accepted_99", 3),
)


def document(results: pd.DataFrame, studies: Mapping[str, Study]) -> str:
    """All tables, recorded studies first; studies of viewpoints alone are left out."""
    filled_studies = []
    for study in sorted(studies.values(), key=lambda study: study.simulated):
        for grid in study.grids:
            study_rows = results[(results["study"] == study.name) & (results["grid"] == grid.name)]
            if (summary := Summary.of(study_rows, study)).rows:
                filled_studies.append(
                    {
                        "study": study,
                        "grid": grid,
                        "tables": list(_tables(study_rows, summary)),
                    }
                )
    return template("results.md.j2", studies=filled_studies)


def scores(results: pd.DataFrame, studies: Mapping[str, Study]) -> str:
    """The scorecard of each study alone, without the time of a query."""
    tables = []
    for name, study in studies.items():
        for grid in study.grid_names:
            study_rows = results[
                (results["study"] == name)
                & (results["grid"] == grid)
                & (results["number"] != "query_ms")
            ]
            summary = Summary.of(study_rows, study)
            if summary.rows:
                tables.append(
                    scorecard(summary, [day(sequence) for sequence in summary.tests]).markdown()
                )
    return "\n".join(tables)


def _tables(study_rows: pd.DataFrame, summary: Summary) -> Iterator[Table]:
    dates = [day(sequence) for sequence in summary.tests]
    yield scorecard(summary, dates)
    driven = study_rows[
        (study_rows["change"] == "") & (study_rows["kind"] == "") & (study_rows["seed"] == 0)
    ]
    indexed_values = indexed(driven, "method", "variant", "protocol", "number", "sequence")
    values = {
        (ModelName(method, variant).name, *key): value
        for (method, variant, *key), value in indexed_values.items()
    }
    models = [row.model for row in summary.rows]
    for protocol, name in SHOWN:
        rows = [
            (model, *(_cell(values, model, protocol, name, test, 3) for test in summary.tests))
            for model in models
        ]
        yield table(f"by_{protocol}_{name}", ("method", *dates), rows)
    posed = [
        model for model in models if (model, "distance", POSES[0][1], summary.tests[-1]) in values
    ]
    for kind, columns in (("posed", POSES), ("pose_answers", ANSWERS)) if posed else ():
        rows = [
            (
                model,
                date,
                *(
                    _cell(values, model, "distance", name, test, digits)
                    for _, name, digits in columns
                ),
            )
            for model in posed
            for test, date in zip(summary.tests, dates, strict=True)
        ]
        yield table(kind, ("method", "day", *(heading for heading, _, _ in columns)), rows, words=2)


def _cell(
    values: Mapping[Any, Values], model: str, protocol: str, name: str, test: str, digits: int
) -> Cell:
    value, low, high = values.get((model, protocol, name, test), NONE)
    return number(value, digits, (low, high))
