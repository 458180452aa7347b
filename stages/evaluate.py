"""A ranking and the true places → counts, curves, outcomes and numbers by both protocols, in each case of the queries."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.evaluation.judge import judge_cases
from pipeline.evaluation.judgement import attrs, columns, summary
from pipeline.evaluation.numbers import line
from pipeline.evaluation.protocols import PROTOCOLS
from stages import stage


@stage("evaluate")
def main(cfg: DictConfig) -> str:
    numbers: dict[str, Any] = {}
    with instantiate(cfg.compute) as compute, store.replace(cfg.out) as folder:
        folder.mkdir()
        for found in compute.each(lambda sequence: evaluate(cfg, sequence, folder), cfg.sequences.split()):
            numbers |= found
    with store.replace(cfg.metrics) as metrics:
        metrics.write_text(json.dumps(numbers, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return "; ".join(f"{name}: " + ", ".join(f"by {by} {line(own[by])}" for by in PROTOCOLS) for name, own in numbers.items())


def evaluate(cfg: DictConfig, sequence: str, folder: Path) -> dict[str, dict[str, Any]]:
    """One sequence's evaluation in every case; returns its metrics as driven."""
    kinds, name = {"rankings": schemas.ANSWERS, "labels": (schemas.LABELS,), "submaps": (schemas.SUBMAPS,)}, f"{sequence}.zarr"
    artifacts = {kind: store.read(Path(cfg[kind], name), *one) for kind, one in kinds.items()}
    cases = judge_cases(**artifacts, distance=instantiate(cfg.tolerance.distance), bootstrap=instantiate(cfg.tolerance.bootstrap))
    rules = {name: asdict(instantiate(cfg.tolerance[name])) for name in ("distance", "bootstrap")}
    named = {"sequence": sequence, "train": cfg.train, "wanted_precision": artifacts["rankings"].attrs["wanted_precision"]}
    with store.write(folder / name, schemas.EVALUATIONS, **attrs(cases), **rules, **named) as out:
        for column, values in columns([*cases.values()]).items():
            out.put(column, values)
    return {sequence: summary(next(iter(cases.values())))}


if __name__ == "__main__":
    main()
