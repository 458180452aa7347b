"""Stage `lifelong`: lets a model learn further days, and queries it with all query days after each.

An order says which days are learned in which sequence. A strategy says how they are learned, such
as by adding to the database or by training the network further. The stage writes the answers after
each step of learning, and the cost of each step.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pipeline.core import store
from pipeline.core.replacing import write_text
from pipeline.core.settings import Names, Positive
from pipeline.evaluation.protocols import Distance
from pipeline.lifelong.courses import Order, learned
from pipeline.lifelong.steps import line, record
from pipeline.matching.ranking import Rows
from pipeline.online.pack import Packing, Trained
from pipeline.studies.models import ModelName
from stages import ROOT, ProgressBar, stage, within_budget


@dataclass(frozen=True)
class Strategy:
    """How a model learns a further day: a file of conf/strategy."""

    name: str
    way: Any
    """The object that learns a day: of a class in pipeline.lifelong."""


@dataclass(frozen=True)
class Tolerance:
    """The settings of a file of conf/tolerance that this stage uses."""

    distance: Distance


@dataclass(frozen=True)
class Budget:
    """The settings of a file of conf/budget for the method that is trained."""

    share: Positive
    """The share of the method's full training to run."""


@dataclass(frozen=True)
class Settings:
    """The stage's settings: the keys of conf/lifelong.yaml."""

    method: Any
    strategy: Strategy
    tolerance: Tolerance
    budget: Budget
    study: str
    simulated: bool
    cells: str
    """A file of conf/grid."""
    name: ModelName
    """The model's method, variant and seed."""
    order: Order
    """What is learned in each step."""
    train: str
    """The day that the model learned first."""
    later_days: Names
    """The days that are learned after the first."""
    query_days: Names
    """The days whose submaps the model is queried with after each step."""
    view_name: str
    """The method's view: a file of conf/view."""
    model: Path
    """The model of the first day."""
    labels: Path
    views: Path
    scans: Path
    submaps: Path
    map: Path
    """Folder of the first day's map, which only the order `self_training` reads; it makes the map
    if the folder lacks it."""
    out: Path
    timing: Path
    """File for the CPU time of each step."""


@stage("lifelong", within_budget)
def main(settings: Settings) -> str:
    first_day = f"{settings.train}.zarr"
    progress = ProgressBar(float(settings.budget.share))
    queries = {name: Rows.read(settings.views / f"{name}.zarr") for name in settings.query_days}
    trained = Trained(
        name=f"{settings.study}/{settings.cells}/{settings.name.name}",
        simulated=settings.simulated,
        train=settings.train,
        view=settings.view_name,
        model=settings.model,
        labels=settings.labels / first_day,
        scans=settings.scans / first_day,
        submaps=settings.submaps / first_day,
        views=settings.views / first_day,
        map=settings.map / first_day,
    )
    with TemporaryDirectory() as scratch:
        # a generator: the model learns step by step as `record` takes the steps
        steps = learned(
            settings.order,
            trained,
            settings.later_days,
            strategy=settings.strategy.way,
            method=settings.method,
            packing=Packing(ROOT / "conf"),
            scratch=Path(scratch),
            progress=progress,
        )
        lifelong, cpu_s_of_steps = record(
            steps,
            queries,
            report_line=progress.tell,
            order=settings.order,
            strategy=settings.strategy.name,
            correct_m=float(settings.tolerance.distance.correct_m),
        )
    store.write(settings.out, lifelong)
    columns = {
        "study": settings.study,
        "dataset": settings.study,
        "simulated": settings.simulated,
        "grid": settings.cells,
        **settings.name.columns,
    }
    timing = {"place": columns, **lifelong.attrs, "cpu_s": cpu_s_of_steps}
    write_text(settings.timing, json.dumps(timing, allow_nan=False) + "\n")
    return line(lifelong)


if __name__ == "__main__":
    main()
