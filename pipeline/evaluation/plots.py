"""The data that `dvc plots` draws, of the models' own recipes on the test sequences.

Wide: one row a point.
"""

import pandas as pd

from pipeline.evaluation.results import ResultsTable
from pipeline.studies.models import ModelName

YEAR = {
    "auc_top1": ("cells", "auc_top1"),
    "recall_at_1": ("cells", "recall_at_1"),
    "recall_at_1_by_distance": ("distance", "recall_at_1"),
    "oracle": ("cells", "oracle"),
}
"""Column to protocol and number."""


def year(table: pd.DataFrame) -> pd.DataFrame:
    """A row a method and test sequence: the days since training and the main numbers.

    By cells unless named otherwise.
    """
    rows_as_driven = table[
        (table["case"] == "")
        & (table["variant"] == "")
        & (table["seed"] == 0)
        & (table["stress"] == "")
    ]
    columns = {}
    for column, (protocol, number) in YEAR.items():
        rows = rows_as_driven[
            (rows_as_driven["protocol"] == protocol) & (rows_as_driven["number"] == number)
        ]
        columns[column] = rows.set_index(["method", "sequence", "days"])["value"]
    wide = pd.DataFrame(
        {name: values[~values.index.duplicated()] for name, values in columns.items()}
    ).dropna(subset="auc_top1")
    return wide.reset_index().sort_values(["method", "days", "sequence"])


def precision_recall(gathering: ResultsTable) -> pd.DataFrame:
    """A row a method, test sequence and threshold of the SCI paper's curve: top-1, by cells."""
    frames = []
    study = gathering.study
    for method in study.methods if study.asks_about_the_year else ():
        for sequence in study.tests:
            evaluation = gathering.evaluation(study.grids[0].name, ModelName(method.name), sequence)
            columns = {
                "threshold": evaluation.thresholds,
                "recall": evaluation.cells.recall[0],
                "precision": evaluation.cells.precision[0],
            }
            frames.append(pd.DataFrame({"method": method.name, "sequence": sequence, **columns}))
    return (
        pd.concat(frames)
        if frames
        else pd.DataFrame(columns=["method", "sequence", "threshold", "recall", "precision"])
    )
