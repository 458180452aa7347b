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
        store.replace(cfg.metrics) as shown,
    ):
        folder.mkdir()
        shown.mkdir()
        for sequence, driven in compute.each(
            lambda sequence: evaluate(cfg, sequence, folder), cfg.sequences.split()
        ):
            text = json.dumps(metrics(driven), indent=2, allow_nan=False)
            (shown / f"{sequence}.json").write_text(f"{text}\n", encoding="utf-8")
            numbers = summary(driven)
            lines.append(
                f"{sequence}: " + ", ".join(f"by {by} {line(numbers[by])}" for by in PROTOCOLS)
            )
    return "; ".join(lines)


def evaluate(cfg: DictConfig, sequence: str, folder: Path) -> tuple[str, Evaluation]:
    """One sequence's evaluation in every case; returns the one as driven."""
    kinds = {
        "rankings": schemas.ANSWERS,
        "labels": (schemas.LABELS,),
        "submaps": (schemas.SUBMAPS,),
    }
    name = f"{sequence}.zarr"
    artifacts = {kind: store.read(Path(cfg[kind], name), *one) for kind, one in kinds.items()}
    cases = judge_cases(
        **artifacts,
        distance=instantiate(cfg.tolerance.distance),
        bootstrap=instantiate(cfg.tolerance.bootstrap),
    )
    rules = {name: asdict(instantiate(cfg.tolerance[name])) for name in ("distance", "bootstrap")}
    named = {
        "sequence": sequence,
        "train": cfg.train,
        "wanted_precision": artifacts["rankings"].attrs["wanted_precision"],
    }
    with store.write(folder / name, schemas.EVALUATIONS, **attrs(cases), **rules, **named) as out:
        for column, values in columns([*cases.values()]).items():
            out.put(column, values)
    return sequence, next(iter(cases.values()))


if __name__ == "__main__":
    main()
