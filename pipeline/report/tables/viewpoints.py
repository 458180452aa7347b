"""The tables on paper 2's protocol: a sequence matched with itself from other headings.

Paper 2 is IROS 2018's on unsupervised features of bird-views.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from pipeline.evaluation.rows import HEADING, VIEWPOINT
from pipeline.evaluation.viewpoints import NUMBERS
from pipeline.report.selection import indexed, pick
from pipeline.report.study import Study
from pipeline.report.table import Table, count, spread, table

# The paper's numbers and their headings.
TITLES = dict(zip(NUMBERS, ("ROC-AUC", "PR-AUC", "accuracy", "recall"), strict=True))


def over_headings(study: Study) -> list[Table]:
    """Paper 2's numbers, one row per sequence and model: means over headings, and over seeds.

    A table without rows is left out.
    """
    totals = indexed(pick(study.rows, ask=VIEWPOINT, of=""), "sequence", "model", "number")
    heading_rows = []
    seed_rows = []
    for (sequence, model), numbers in _by_heading(study):
        at_headings = numbers.groupby("at").mean()
        with_auc = int(np.isfinite(at_headings["roc_auc"]).sum())
        queries, *_ = totals[sequence, model, "queries"]
        bytes_per_place, *_ = totals[sequence, model, "bytes_per_place"]
        heading_rows.append(
            (
                sequence,
                model,
                *(spread(at_headings[name], 3) for name in TITLES),
                f"{with_auc} of {len(at_headings)}",
                count(queries),
                count(bytes_per_place),
            )
        )
        of_seeds = numbers.groupby("seed").mean()
        if len(of_seeds) > 1:
            means = (spread(of_seeds[name], 3) for name in TITLES)
            seed_rows.append((sequence, model, *means, count(len(of_seeds))))
    header = ("sequence", "model", *TITLES.values())
    heading_header = (*header, "headings with ROC-AUC", "queries", "bytes a place")
    seed_header = (*header, "seeds")
    candidates = (
        table("viewpoints_over_headings", heading_header, heading_rows, text_columns=2),
        table("viewpoints_over_seeds", seed_header, seed_rows, text_columns=2),
    )
    return [candidate for candidate in candidates if candidate.rows]


def every_heading(study: Study, name: str) -> Table:
    """One of paper 2's numbers: one column per heading, means over the seeds."""
    grouped = {key: numbers.groupby("at")[name] for key, numbers in _by_heading(study)}
    headings_deg = sorted({deg for groups in grouped.values() for deg in groups.groups})
    rows = [
        (sequence, model, *(spread(groups.get_group(deg), 3) for deg in headings_deg))
        for (sequence, model), groups in grouped.items()
    ]
    header = ("sequence", "model", *(f"{deg:g}°" for deg in headings_deg))
    return table("every_heading", header, rows, text_columns=2, title=TITLES[name])


def _by_heading(study: Study) -> Iterator[tuple[tuple[str, str], pd.DataFrame]]:
    """For each sequence and model a table of numbers, one row per seed and heading.

    The heading in degrees is the index `at`.
    """
    rows = pick(study.rows, ask=VIEWPOINT, of=HEADING)
    for key, group in rows.groupby(["sequence", "model"], sort=False):
        yield key, group.pivot(index=["seed", "at"], columns="number", values="value")
