"""The runs of a study of learning further days: one a strategy, model and order.

Their steps are the days learned.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline.evaluation.lifelong import CHANGE
from pipeline.studies.colours import PALETTE
from pipeline.studies.models import ModelName
from pipeline.tracking.datasets import used_sequences
from pipeline.tracking.page import COLOUR
from pipeline.tracking.records import Source
from pipeline.tracking.runs import RunRecord
from pipeline.tracking.texts import filled


def records(source: Source) -> Iterator[RunRecord]:
    """Runs from the study's rows in the table of results: means over the seeds, a point a step."""
    study = source.study
    rows = source.rows
    course_rows = rows[(rows["change"] == CHANGE) & np.isfinite(rows["value"])]
    strategies: list[str] = []
    data = "simulated" if study.simulated else "recorded"
    for (kind, method, variant), group in course_rows.groupby(
        ["kind", "method", "variant"], sort=False
    ):
        order, _, strategy = str(kind).partition(" ")
        strategies += [strategy] * (strategy not in strategies)
        model = ModelName(str(method), str(variant)).name
        seeds = sorted(set(group["seed"]))
        course = {
            "dataset": study.name,
            "grid": source.grid,
            "model": model,
            "order": order,
            "strategy": strategy,
        }
        params = {
            **course,
            "train": study.train_text,
            "seeds": len(seeds),
            "budget": study.budget,
        }
        steps = list(
            dict.fromkeys(group.loc[group["number"] == "places"].sort_values("level")["sequence"])
        )
        about = filled(
            "course.md.j2",
            **course,
            steps=steps,
            asked=study.tests,
            seeds=seeds,
            simulated=study.simulated,
        )
        learned = [step for step in steps if step in {*study.train, *study.learned, *study.updates}]
        inputs = used_sequences(replace(study, train=tuple(learned)), study.tests, source.lock)
        series = dict(_series(group))
        tags = {COLOUR: PALETTE[strategies.index(strategy) % len(PALETTE)], "data": data, **course}
        yield RunRecord(
            f"{source.run(model)} {order} {strategy}",
            tags,
            params,
            series,
            source.files(model),
            about=about,
            used=inputs,
        )


def _series(rows: pd.DataFrame) -> Iterator[tuple[str, list[tuple[int, float]]]]:
    """The points of each metric over the steps.

    Recall of each asked day or part has a group of its own.
    """
    asked_day = rows["sequence"].where(rows["number"] == "recall_at_1", "")
    for (protocol, number, day), group in rows.groupby(
        [rows["protocol"], rows["number"], asked_day], sort=False
    ):
        name = f"recall_by_{protocol}/{day}" if day else f"{protocol or 'cost'}/{number}"
        yield (
            name,
            [
                (int(step), float(value))
                for step, value in group.groupby("level")["value"].mean().items()
            ],
        )
