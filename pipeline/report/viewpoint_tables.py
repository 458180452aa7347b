"""Tables of paper 2's protocol: its numbers over the headings, over the seeds, at every heading."""

import numpy as np
import pandas as pd

from pipeline.evaluation.viewpoints import NUMBERS
from pipeline.report.selection import indexed
from pipeline.report.study import Study
from pipeline.report.table import Table, count, spread, table

HEADINGS = ("ROC-AUC", "PR-AUC", "accuracy", "recall")


def over(study: Study) -> list[Table]:
    """A row a sequence and model: means over the headings, and over several seeds.

    Tables without rows are left out.
    """
    totals = indexed(_rows(study, "viewpoint of all"), "sequence", "model", "number")
    of_headings = []
    of_seeds = []
    for key, wide in _numbers(study).items():
        headings, seeds = (wide.groupby(level).mean() for level in ("level", "seed"))
        headings_with_auc = f"{int(np.isfinite(headings['roc_auc']).sum())} of {len(headings)}"
        queries, cost = (count(totals[(*key, name)][0]) for name in ("queries", "bytes_per_place"))
        of_headings.append(
            (
                *key,
                *(spread(headings[name], 3) for name in NUMBERS),
                headings_with_auc,
                queries,
                cost,
            )
        )
        if len(seeds) > 1:
            of_seeds.append(
                (*key, *(spread(seeds[name], 3) for name in NUMBERS), count(len(seeds)))
            )
    header = ("sequence", "model", *HEADINGS)
    last = ("headings with ROC-AUC", "queries", "bytes a place")
    candidates = (
        table("viewpoints_over_headings", (*header, *last), of_headings, words=2),
        table("viewpoints_over_seeds", (*header, "seeds"), of_seeds, words=2),
    )
    return [candidate for candidate in candidates if candidate.rows]


def every_heading(study: Study, name: str) -> Table:
    """One of paper 2's numbers: a column a heading, means over the seeds."""
    grouped = {key: wide.groupby("level")[name] for key, wide in _numbers(study).items()}
    degrees = sorted({deg for groups in grouped.values() for deg in groups.groups})
    rows = [
        (*key, *(spread(groups.get_group(deg), 3) for deg in degrees))
        for key, groups in grouped.items()
    ]
    header = ("sequence", "model", *(f"{deg:g}°" for deg in degrees))
    return table("every_heading", header, rows, words=2, title=HEADINGS[NUMBERS.index(name)])


def _rows(study: Study, change: str) -> pd.DataFrame:
    """The rows of a change, with a column `model`: the method, or a variant of it."""
    rows = study.rows[study.rows["change"] == change]
    model = rows["method"].where(rows["variant"] == "", rows["method"] + "-" + rows["variant"])
    return rows.assign(model=model)


def _numbers(study: Study) -> dict[tuple[str, str], pd.DataFrame]:
    """Map sequence and model to a table of numbers: a row a seed and heading (`level`)."""
    groups = _rows(study, "viewpoint").groupby(["sequence", "model"], sort=False)
    return {
        key: group.pivot(index=["seed", "level"], columns="number", values="value")
        for key, group in groups
    }
