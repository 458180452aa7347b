"""Tables of paper 2's protocol: its numbers over the headings, over the seeds, and at every heading."""

import numpy as np
import pandas as pd

from pipeline.evaluation.viewpoints import NUMBERS
from pipeline.report.study import Study
from pipeline.report.table import Cell, Table, count, spread, word

HEADINGS = ("ROC-AUC", "PR-AUC", "accuracy", "recall")


def over(study: Study, seeds: bool) -> Table | None:
    """Paper 2's numbers: over the headings, a row a sequence and method; or over seeds, None where there is one."""
    own = study.rows[study.rows["change"] == "viewpoint"]
    about = study.rows[study.rows["change"] == "viewpoint of all"].set_index(["method", "sequence", "number"])["value"]
    rows = []
    for (sequence, method), group in own.groupby(["sequence", "method"], sort=False):
        if seeds and group["seed"].nunique() < 2:
            continue
        by = "seed" if seeds else "level"
        wide = {name: group[group["number"] == name].groupby(by)["value"].mean() for name in NUMBERS}
        cells = [spread(list(wide[name]), 3) for name in NUMBERS]
        if seeds:
            rows.append((word(sequence), word(method), *cells, count(group["seed"].nunique())))
            continue
        queries, cost = (about[(method, sequence, name)] for name in ("queries", "bytes_per_place"))
        queries, cost = (one.iloc[0] if isinstance(one, pd.Series) else one for one in (queries, cost))
        there = f"{int(np.isfinite(wide['roc_auc']).sum())} of {len(wide['roc_auc'])}"
        rows.append((word(sequence), word(method), *cells, Cell(there), count(queries), count(cost)))
    last = ("seeds",) if seeds else ("headings with ROC-AUC", "queries", "bytes a place")
    header = ("sequence", "method", *HEADINGS, *last)
    return Table(f"viewpoints_over_{'seeds' if seeds else 'headings'}", header, tuple(rows), words=2) if rows else None


def every_heading(study: Study, name: str) -> Table:
    """One of paper 2's numbers, a column a heading; means over seeds."""
    own = study.rows[(study.rows["change"] == "viewpoint") & (study.rows["number"] == name)]
    degrees = sorted(own["level"].unique())
    rows = [
        (word(sequence), word(method), *(spread(list(group.loc[group["level"] == deg, "value"]), 3) for deg in degrees))
        for (sequence, method), group in own.groupby(["sequence", "method"], sort=False)
    ]
    values = {"title": HEADINGS[NUMBERS.index(name)]}
    return Table("every_heading", ("sequence", "method", *(f"{deg:g}°" for deg in degrees)), tuple(rows), words=2, values=values)
