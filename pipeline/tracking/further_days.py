"""The runs of a study of learning further days: one a strategy, model and order.

Their steps are the days learned.
"""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from pipeline.evaluation.lifelong import CHANGE
from pipeline.studies.colours import PALETTE
from pipeline.studies.expansion import ModelName
from pipeline.tracking.datasets import used_sequences
from pipeline.tracking.page import COLOUR
from pipeline.tracking.records import Source
from pipeline.tracking.runs import RunRecord
from pipeline.tracking.texts import filled


def records(source: Source) -> Iterator[RunRecord]:
    """Runs from the study's rows in the table of results: means over the seeds, a point a step."""
    words = source.words
    rows = source.rows
    course_rows = rows[(rows["change"] == CHANGE) & np.isfinite(rows["value"])]
    strategies: list[str] = []
    data = "simulated" if source.simulated else "recorded"
    for (kind, method, variant), group in course_rows.groupby(
        ["kind", "method", "variant"], sort=False
    ):
        order, _, strategy = str(kind).partition(" ")
        strategies += [strategy] * (strategy not in strategies)
        model = ModelName(str(method), str(variant)).name
        seeds = sorted(set(group["seed"]))
        course = {
            "dataset": source.study,
            "grid": source.grid,
            "model": model,
            "order": order,
            "strategy": strategy,
        }
        params = {**course, "train": words["train"], "seeds": len(seeds), "budget": words["budget"]}
        steps = list(
            dict.fromkeys(group.loc[group["number"] == "places"].sort_values("level")["sequence"])
        )
        about = filled(
            "course.md.j2",
            **course,
            steps=steps,
            asked=words["tests"],
            seeds=seeds,
            simulated=source.simulated,
        )
        learned = [
            step
            for step in steps
            if step in {words["train"], *words["learned"], *words.get("updates", ())}
        ]
        inputs = used_sequences(
            source.study, {**words, "train": " ".join(learned)}, words["tests"], source.lock
        )
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
