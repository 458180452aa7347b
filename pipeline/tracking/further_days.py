"""The runs of a study of learning further days: one for each strategy of each model and order, over
the steps learned."""

from collections.abc import Iterator

import numpy as np
import pandas as pd

from pipeline.evaluation.lifelong import CHANGE
from pipeline.studies.colours import PALETTE
from pipeline.studies.expansion import ModelName
from pipeline.tracking.datasets import used
from pipeline.tracking.page import COLOUR
from pipeline.tracking.records import Source
from pipeline.tracking.runs import RunRecord
from pipeline.tracking.texts import filled


def records(source: Source) -> Iterator[RunRecord]:
    """From the study's rows in the table of results: means over the seeds, a point a step."""
    words = source.words
    rows = source.rows
    own = rows[(rows["change"] == CHANGE) & np.isfinite(rows["value"])]
    known: list[str] = []
    data = "simulated" if source.simulated else "recorded"
    for (kind, method, variant), group in own.groupby(["kind", "method", "variant"], sort=False):
        order, _, strategy = str(kind).partition(" ")
        known += [strategy] * (strategy not in known)
        model = ModelName(str(method), str(variant)).name
        seeds = sorted(set(group["seed"]))
        of = {
            "dataset": source.study,
            "grid": source.grid,
            "model": model,
            "order": order,
            "strategy": strategy,
        }
        params = {**of, "train": words["train"], "seeds": len(seeds), "budget": words["budget"]}
        steps = list(
            dict.fromkeys(group.loc[group["number"] == "places"].sort_values("level")["sequence"])
        )
        about = filled(
            "course.md.j2",
            **of,
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
        inputs = used(
            source.study, {**words, "train": " ".join(learned)}, words["tests"], source.lock
        )
        series = dict(_series(group))
        tags = {COLOUR: PALETTE[known.index(strategy) % len(PALETTE)], "data": data, **of}
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
    """Recall of each asked day or part in a group of its own; of a day by itself the number
    alone."""
    asked = rows["sequence"].where(rows["number"] == "recall_at_1", "")
    for (protocol, number, day), group in rows.groupby(
        [rows["protocol"], rows["number"], asked], sort=False
    ):
        name = f"recall_by_{protocol}/{day}" if day else f"{protocol or 'cost'}/{number}"
        yield (
            name,
            [
                (int(step), float(value))
                for step, value in group.groupby("level")["value"].mean().items()
            ],
        )
