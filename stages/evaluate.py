"""A ranking and the true places → counts, curves, outcomes and numbers by both protocols, in each
case of the queries."""

import json
from dataclasses import asdict
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.evaluation.judge import judge_cases
from pipeline.evaluation.judgement import Evaluation, attrs, columns, metrics, summary
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
    kinds = {
        "rankings": schemas.ANSWERS,
        "labels": (schemas.LABELS,),
        "submaps": (schemas.SUBMAPS,),
    }
    name = f"{sequence}.zarr"
    artifacts = {kind: store.read(Path(cfg[kind], name), *schema) for kind, schema in kinds.items()}
    cases = judge_cases(
        **artifacts,
        distance=instantiate(cfg.tolerance.distance),
        bootstrap=instantiate(cfg.tolerance.bootstrap),
    )
    rules = {name: asdict(instantiate(cfg.tolerance[name])) for name in ("distance", "bootstrap")}
    sequence_attrs = {
        "sequence": sequence,
        "train": cfg.train,
        "wanted_precision": artifacts["rankings"].attrs["wanted_precision"],
    }
    with store.write(
        folder / name, schemas.EVALUATIONS, **attrs(cases), **rules, **sequence_attrs
    ) as out:
        for column, values in columns([*cases.values()]).items():
            out.put(column, values)
    return sequence, next(iter(cases.values()))


if __name__ == "__main__":
    main()
