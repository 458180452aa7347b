"""Stage `evaluate`: compares a model's answers for each test sequence with the true places.

It reads rankings (with or without poses), labels and submaps. For each case of the queries, such as
unperturbed or turned, it writes outcomes and numbers by both protocols: an answer is right if it is
the query's cell, or if it is near enough.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from pipeline.core import schemas, store
from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.evaluations import Evaluations, line, metrics
from pipeline.evaluation.judge import judge_cases
from pipeline.evaluation.protocols import PROTOCOLS, Distance
from stages import EachSequence, each_sequence, stage


@dataclass(frozen=True)
class Tolerance:
    """The largest distance of a right answer, and how intervals are drawn: a file of
    conf/tolerance."""

    distance: Distance
    bootstrap: Bootstrap


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/evaluate.yaml."""

    train: str
    tolerance: Tolerance
    rankings: Path
    labels: Path
    submaps: Path
    metrics: Path
    """Folder for the numbers that `dvc metrics` shows."""


@stage("evaluate")
def main(settings: Settings) -> str:
    with store.replace(settings.metrics) as metrics_folder:
        metrics_folder.mkdir()

        def evaluate(sequence: str, folder: Path) -> str:
            """Write the evaluation of one sequence in every case, and its unperturbed metrics."""
            name = f"{sequence}.zarr"
            distance = settings.tolerance.distance
            bootstrap = settings.tolerance.bootstrap
            cases = judge_cases(
                store.read(settings.rankings / name, schemas.Rankings, schemas.Fixes),
                store.read(settings.labels / name, schemas.Labels),
                store.read(settings.submaps / name, schemas.Submaps),
                distance,
                bootstrap,
            )
            evaluations = Evaluations(
                evaluations=tuple(cases.values()),
                cases=[asdict(case) for case in cases],
                sequence=sequence,
                train=settings.train,
                distance=asdict(distance),
                bootstrap=asdict(bootstrap),
            )
            store.write(folder / name, evaluations)
            unperturbed = evaluations.case()
            text = json.dumps(metrics(unperturbed), indent=2, allow_nan=False)
            (metrics_folder / f"{sequence}.json").write_text(f"{text}\n", encoding="utf-8")
            by_protocol = [f"by {protocol} {line(unperturbed, protocol)}" for protocol in PROTOCOLS]
            return f"{sequence}: {', '.join(by_protocol)}"

        return each_sequence(settings, evaluate, "evaluate")


if __name__ == "__main__":
    main()
