"""The data of the plots that `dvc plots show` draws: tables with one row per plotted point.

They have the numbers of each method with its own settings and seed 0, on the test sequences, at the
study's first cell size.
"""

import pandas as pd

from pipeline.evaluation.results import ResultsTable
from pipeline.evaluation.rows import UNPERTURBED, pick
from pipeline.studies.models import ModelName

YEAR_COLUMNS = {
    "auc_top1": ("cells", "auc_top1"),
    "recall_at_1": ("cells", "recall_at_1"),
    "recall_at_1_by_distance": ("distance", "recall_at_1"),
    "oracle": ("cells", "oracle"),
}
"""Column of the plot to the protocol and number in the table of results."""


def year(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each method and test sequence: the days since training and the main numbers.

    `table` is the table of results; the study's first grid is the one that it names first.
    """
    grids = table.loc[table["grid"] != "", "grid"].unique()
    own_rows = table[table["grid"].isin(grids[:1])]
    plain_rows = pick(own_rows, ask=UNPERTURBED, variant="", seed=0)
    columns = {}
    for column, (protocol, number) in YEAR_COLUMNS.items():
        rows = pick(plain_rows, protocol=protocol, number=number)
        columns[column] = rows.set_index(["method", "sequence", "days"])["value"]
    wide = pd.DataFrame(columns).dropna(subset="auc_top1")
    return wide.reset_index().sort_values(["method", "days", "sequence"])


def precision_recall(results_table: ResultsTable) -> pd.DataFrame:
    """A row for each method, test sequence and threshold of the SCI paper's curve.

    The paper is Kim, Park and Kim, RA-L 2019. Precision and recall are of the first answers, by
    cells.
    """
    frames = []
    study = results_table.study
    first_grid = study.grids[0].name
    methods = study.methods if study.tests_over_days else ()
    for method in methods:
        for sequence in study.tests:
            evaluation = results_table.evaluation(first_grid, ModelName(method.name), sequence)
            precision, recall = evaluation.curve("cells", evaluation.thresholds)
            columns = {
                "threshold": evaluation.thresholds,
                "recall": recall,
                "precision": precision,
            }
            frames.append(pd.DataFrame({"method": method.name, "sequence": sequence, **columns}))
    if not frames:
        return pd.DataFrame(columns=["method", "sequence", "threshold", "recall", "precision"])
    return pd.concat(frames)
