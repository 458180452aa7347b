"""A ranking and the true places → counts, curves, outcomes and numbers by both protocols, in each
case of the queries."""

import json
from dataclasses import asdict
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.evaluation.judge import judge_cases
from pipeline.evaluation.judgement import Evaluation, Evaluations, metrics, summary
from pipeline.evaluation.numbers import line
from pipeline.evaluation.protocols import PROTOCOLS
from stages import stage


@stage("evaluate")
def main(cfg: DictConfig) -> str:
    lines = []
    with (
        instantiate(cfg.compute) as compute,
        store.replace(cfg.out) as folder,
        store.replace(cfg.metrics) as metrics_path,
    ):
        folder.mkdir()
        metrics_path.mkdir()
        for sequence, as_driven in compute.each(
            lambda sequence: evaluate(cfg, sequence, folder), cfg.sequences.split()
        ):
            text = json.dumps(metrics(as_driven), indent=2, allow_nan=False)
            (metrics_path / f"{sequence}.json").write_text(f"{text}\n", encoding="utf-8")
            numbers = summary(as_driven)
            by_protocol = [f"by {protocol} {line(numbers[protocol])}" for protocol in PROTOCOLS]
            lines.append(f"{sequence}: {', '.join(by_protocol)}")
    return "; ".join(lines)


def evaluate(cfg: DictConfig, sequence: str, folder: Path) -> tuple[str, Evaluation]:
    """One sequence's evaluation in every case; returns the one as driven."""
    name = f"{sequence}.zarr"
    distance = instantiate(cfg.tolerance.distance)
    bootstrap = instantiate(cfg.tolerance.bootstrap)
    cases = judge_cases(
        store.read(Path(cfg.rankings, name), schemas.Rankings, schemas.Fixes),
        store.read(Path(cfg.labels, name), schemas.Labels),
        store.read(Path(cfg.submaps, name), schemas.Submaps),
        distance,
        bootstrap,
    )
    evaluations = Evaluations(
        evaluations=tuple(cases.values()),
        cases=[asdict(case) for case in cases],
        sequence=sequence,
        train=cfg.train,
        distance=asdict(distance),
        bootstrap=asdict(bootstrap),
    )
    store.write(folder / name, evaluations)
    return sequence, evaluations.case()


if __name__ == "__main__":
    main()
