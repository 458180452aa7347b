"""Stage `viewpoints`: evaluates how well a model recognises places from other headings.

It queries a model of bird-views with each place of a test sequence as a turned robot sees it, like
the paper on DOM and PFL (IROS 2018). It writes the matches and their mean numbers by heading.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.core import store
from pipeline.core.building import build, parsed
from pipeline.core.settings import Count, Names
from pipeline.evaluation.viewpoint_matches import line, means
from pipeline.matching.ranking import Rows
from stages import METHODS, ProgressBar, stage


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/viewpoints.yaml."""

    model: Path
    views: Path
    sequences: Names
    tests: Count
    """Number of the sequences that are queried, from the first on."""
    viewpoints: Any
    out: Path
    metrics: Path
    """Folder for the numbers that `dvc metrics` shows."""


@stage("viewpoints")
def main(settings: Settings) -> str:
    recipe = {name: parsed(value) for name, value in store.read_recipe(settings.model).items()}
    method = build(recipe, METHODS)
    model = store.read_model(settings.model)
    sequences = settings.sequences[: settings.tests]
    lines = []
    with store.replace(settings.out) as folder, store.replace(settings.metrics) as metrics_folder:
        folder.mkdir()
        metrics_folder.mkdir()
        for sequence in ProgressBar().track(sequences, len(sequences), "judge turned robots"):
            views = Rows.read(settings.views / f"{sequence}.zarr")
            matches = settings.viewpoints.judge(method, model, views)
            store.write(folder / f"{sequence}.zarr", matches)
            numbers = matches.by_heading()
            text = json.dumps(means(numbers), indent=2, allow_nan=False)
            (metrics_folder / f"{sequence}.json").write_text(f"{text}\n", encoding="utf-8")
            lines.append(f"{sequence}: {line(numbers)}")
    return "; ".join(lines)


if __name__ == "__main__":
    main()
